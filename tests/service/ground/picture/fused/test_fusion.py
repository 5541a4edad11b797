"""The fused layer in the picture: one fire of several drones and a tower, its marks, its name, what it tells."""

import json
import math

import msgspec
import pytest

from service.ground.picture.fused.fusion import compared
from service.ground.picture.fused.topic import FusedTopic
from service.ground.picture.fused.towers import MOST_SECTORS, MOST_TOWERS, Alert, Towers
from service.ground.picture.marks import Mark
from service.ground.picture.picture import Picture
from service.ground.picture.views import FireView
from service.publish.exchange.fire import SharedFire
from service.publish.parts import AdviceReport
from service.publish.wire import utc_text
from tests.support.ground_samples import NOW_S, ellipse, report_bytes, vehicle_bytes

LAT_DEG, LON_DEG = 47.42774, 8.60559
NORTH_DEG, EAST_DEG = 1.0 / 111_190.0, 1.0 / (111_320.0 * math.cos(math.radians(LAT_DEG)))
LATER_S = NOW_S + 20.0  # when what was told at NOW_S is no longer new


def hear(
    picture: Picture,
    vehicle: str,
    towards_deg: float,
    north_m: float = 0.0,
    east_m: float = 0.0,
    target: int = 1,
    **said: object,
) -> None:
    told = {"ellipse95": ellipse(150.0, 50.0, towards_deg % 180.0), "range_m": 2_000.0, "bearing_deg": towards_deg}
    place = {"lat_deg": LAT_DEG + north_m * NORTH_DEG, "lon_deg": LON_DEG + east_m * EAST_DEG}
    payload = report_bytes(target, vehicle, **{**told, **place, **said})
    assert picture.hear(f"distloc/{vehicle}/targets/{target}", payload, NOW_S)


def seen(picture: Picture, at_s: float = LATER_S) -> dict[str, FireView]:
    picture.compare(at_s)
    return {one.id: one for one in picture.whole(at_s).fires}


def two() -> Picture:
    picture = Picture()
    hear(picture, "drone1", 0.0, 20.0)
    hear(picture, "drone2", 90.0, 0.0, 20.0, target=4)
    return picture


def test_two_drones_fires_become_one_that_is_surer_and_lists_both() -> None:
    found = seen(two())
    one = found["fused/drone1/1"]
    assert one.made_of is not None and one.made_of.contributors == ["drone1/1", "drone2/4"]
    assert one.ellipse95.semi_major_m is not None and 40.0 < one.ellipse95.semi_major_m < 75.0
    assert (found["drone1/1"].fused, found["drone2/4"].fused) == ("fused/drone1/1", "fused/drone1/1")
    assert one.lat_deg == pytest.approx(LAT_DEG, abs=15.0 * NORTH_DEG)
    assert one.lon_deg == pytest.approx(LON_DEG, abs=15.0 * EAST_DEG)
    assert one.observations == sum(found[name].observations for name in ("drone1/1", "drone2/4"))
    assert [one.may_be for one in found.values()] == [[], [], []]


def test_the_answer_is_the_same_whoever_was_heard_first() -> None:
    other = Picture()
    hear(other, "drone2", 90.0, 0.0, 20.0, target=4)
    hear(other, "drone1", 0.0, 20.0)
    first, second = seen(two())["fused/drone1/1"], seen(other)["fused/drone1/1"]
    assert first == second


def test_a_drones_later_report_replaces_its_own_and_is_counted_once() -> None:
    picture = two()
    before = seen(picture)["fused/drone1/1"].ellipse95
    for _ in range(5):
        hear(picture, "drone1", 0.0, 20.0)
    assert seen(picture)["fused/drone1/1"].ellipse95 == before


def test_what_was_compared_meanwhile_does_no_harm_to_what_is_gone_or_new() -> None:
    """A thread compares what was there when it was asked; the picture goes on."""
    picture = two()
    asked = picture.to_compare(LATER_S)
    hear(picture, "drone2", 90.0, 0.0, 20.0, target=4, state="dismissed")
    hear(picture, "drone3", 180.0, 10.0)
    picture.take_compared(compared(asked))
    assert set(picture.fusion.fused_of) == {"drone1/1", "drone2/4"}
    shown = {one.id: one for one in picture.whole(LATER_S).fires}
    assert shown["drone3/1"].fused == "" and len(picture.shared(LATER_S).fires) >= 1
    made_of = seen(picture)["fused/drone1/1"].made_of
    assert made_of is not None and made_of.contributors == ["drone1/1", "drone3/1"]


def test_over_the_date_line_two_are_one_as_well() -> None:
    picture = Picture()
    for vehicle, lon_deg, towards_deg in (("drone1", 179.9999, 0.0), ("drone2", -179.9999, 90.0)):
        hear(picture, vehicle, towards_deg, lat_deg=0.0, lon_deg=lon_deg)
    one = seen(picture)["fused/drone1/1"]
    assert abs(abs(one.lon_deg or 0.0) - 180.0) < 1e-4


def test_what_was_not_seen_for_long_counts_for_less() -> None:
    picture = two()
    fresh, old = (seen(picture, at_s)["fused/drone1/1"].ellipse95 for at_s in (LATER_S, NOW_S + 900.0))
    assert old.semi_major_m is not None and fresh.semi_major_m is not None
    assert old.semi_major_m > 2.0 * fresh.semi_major_m


def test_a_mark_of_a_part_holds_for_the_whole_and_what_is_no_fire_leaves_it() -> None:
    picture = two()
    seen(picture)
    picture.mark(Mark(vehicle="drone2", target=4, time_s=0.0, is_acknowledged=True, name="Mill"), LATER_S)
    assert picture.changed().fires >= {"drone2/4", "fused/drone1/1"}
    whole = seen(picture)["fused/drone1/1"].mark
    assert whole is not None and (whole.name, whole.is_acknowledged) == ("Mill", True)
    picture.mark(Mark(vehicle="drone2", target=4, time_s=0.0, verdict="not_a_fire"), LATER_S + 1.0)
    found = seen(picture)
    assert found["fused/drone1/1"].made_of is not None
    assert found["fused/drone1/1"].made_of.contributors == ["drone1/1"]  # its name stays with the other
    assert found["drone2/4"].fused == ""


def test_others_are_told_of_one_and_what_became_part_of_it_is_gone_until_it_parts() -> None:
    picture = two()
    own = [one.uid for one in picture.shared_news(picture.changed(), NOW_S).fires]
    assert len(own) == 2
    picture.compare(LATER_S)
    told = picture.shared_news(picture.changed(), LATER_S)
    (one,) = told.fires
    assert sorted(told.gone) == sorted(own) and one.made_of is not None
    assert [fire.uid for fire in picture.shared(LATER_S).fires] == [one.uid]
    assert one.report.properties.ellipse95 == seen(picture)["fused/drone1/1"].ellipse95
    assert picture.shared_news(picture.changed(), LATER_S).gone == ()

    hear(picture, "drone2", 90.0, 3_000.0, 20.0, target=4)  # it looks at another fire now
    picture.compare(LATER_S)
    told = picture.shared_news(picture.changed(), LATER_S)
    assert {fire.uid for fire in told.fires} == {one.uid, next(uid for uid in own if "drone2" in uid)}
    for number, vehicle in ((1, "drone1"), (4, "drone2")):
        hear(picture, vehicle, 0.0, target=number, state="dismissed")
    picture.compare(LATER_S)
    assert picture.shared_news(picture.changed(), LATER_S).gone == (one.uid,)
    assert all(fire.is_withdrawn for fire in picture.shared(LATER_S).fires)


def test_a_fused_fires_uid_is_the_same_at_another_ground_and_after_a_restart() -> None:
    (one,), (other,) = (seen_by_others(picture) for picture in (two(), two()))
    assert one.uid == other.uid == "distloc.fused.drone1.1.20270115T0800"


def seen_by_others(picture: Picture) -> list[SharedFire]:
    picture.compare(LATER_S)
    return picture.shared(LATER_S).fires


def test_one_drones_no_is_not_yet_the_no_of_all() -> None:
    picture = two()
    picture.compare(LATER_S)
    picture.mark(Mark(vehicle="drone2", target=4, time_s=0.0, verdict="not_a_fire"), LATER_S)
    assert [one.is_no_fire for one in picture.shared(LATER_S).fires] == [False]
    picture.mark(Mark(vehicle="drone1", target=1, time_s=0.0, verdict="not_a_fire"), LATER_S)
    assert [one.is_no_fire for one in picture.shared(LATER_S).fires] == [True]


def test_a_drones_advice_is_told_where_it_makes_the_fused_fire_surer() -> None:
    for half_m, is_told in ((40.0, True), (140.0, False)):
        advice = AdviceReport(kind="leg", heading_deg=40.0, length_m=400.0, seconds=50.0, half_length_m=half_m)
        picture = Picture()
        for vehicle, towards_deg in (("drone1", 0.0), ("drone2", 90.0)):
            hear(picture, vehicle, towards_deg, advice=advice)
        assert (seen(picture)["fused/drone1/1"].advice is not None) == is_told


def test_a_fire_that_is_given_up_by_all_is_gone_from_the_page_and_said_so_once() -> None:
    picture, topic = two(), FusedTopic("ground1")
    picture.compare(LATER_S)
    ((key, payload),) = topic.messages(picture.fused(LATER_S), LATER_S)
    assert key == "distloc/ground1/fused/drone1/1"
    said = json.loads(payload)
    assert said["properties"]["contributors"] == ["drone1/1", "drone2/4"]
    assert said["geometry"]["coordinates"] == pytest.approx([LON_DEG, LAT_DEG], abs=3e-4)
    assert topic.messages(picture.fused(LATER_S), LATER_S) == []
    picture.changed()
    hear(picture, "drone1", 0.0, 20.0, state="dismissed")
    hear(picture, "drone2", 90.0, 0.0, 20.0, target=4, state="dismissed")
    picture.compare(LATER_S)
    assert "fused/drone1/1" in picture.changes(LATER_S).gone_fires
    ((_, payload),) = topic.messages(picture.fused(LATER_S), LATER_S)
    assert json.loads(payload)["properties"]["state"] == "ended"
    assert topic.messages(picture.fused(LATER_S), LATER_S) == []


@pytest.mark.parametrize(
    "said",
    [
        {"motion": "moving"},
        {"state": "dismissed"},
        {"state": "tentative", "ellipse95": ellipse(3_000.0, 60.0, 90.0)},
        {"bearing_deg": None},
        {"range_m": None},
        {"range_m": 1e12},
        {"bearing_deg": 1e300},
    ],
)
def test_what_is_no_place_of_a_fire_is_not_fused(said: dict) -> None:  # type: ignore[type-arg]
    picture = Picture()
    hear(picture, "drone1", 0.0, 20.0)
    hear(picture, "drone2", 90.0, 0.0, 20.0, target=4, **said)
    assert not any(one.made_of for one in seen(picture).values())


def test_no_name_makes_a_key_that_zenoh_would_not_take() -> None:
    picture = Picture()
    for vehicle in ("a b/*", "$x?"):
        hear(picture, vehicle.replace("/", ""), 0.0 if vehicle[0] == "a" else 90.0)
    picture.compare(LATER_S)
    ((key, _),) = FusedTopic("").messages(picture.fused(LATER_S), LATER_S)
    assert key == "distloc/ground/fused/_x_/1"


def test_a_thousand_fires_in_one_place_are_bounded_and_the_ground_goes_on() -> None:
    picture = Picture()
    for n in range(100):
        for target in range(4):
            hear(picture, f"d{n}", (37.0 * n) % 360.0, 0.1 * n, 400.0 * target, target)
    found = seen(picture)
    assert any(one.made_of for one in found.values())
    assert picture.whole(LATER_S).ground.left_out > 0  # more than are compared with each other


def alert(azimuth_deg: float = 180.0, **said: object) -> bytes:
    told = {
        "platform": "tower1",
        "lat_deg": LAT_DEG + 6_000.0 * NORTH_DEG,
        "lon_deg": LON_DEG,
        "azimuth_deg": azimuth_deg,
        "opening_deg": 2.0,
        "sigma_deg": 0.3,
        "time_utc": utc_text(NOW_S),
    }
    return json.dumps(told | said).encode()


def test_a_tower_tightens_the_fire_and_is_told_what_its_mount_is_off_by() -> None:
    picture = two()
    before = seen(picture)["fused/drone1/1"]
    assert picture.hear("distloc/tower1/alerts", alert(181.0), NOW_S)
    one = seen(picture)["fused/drone1/1"]
    assert one.made_of is not None and one.made_of.towers == ["tower1"]
    (tower,) = picture.whole(LATER_S).towers
    assert tower.error_deg == pytest.approx(1.0, abs=0.4)
    assert [sector.fire for sector in tower.sectors] == ["fused/drone1/1"]
    assert (one.ellipse95.semi_minor_m or 0.0) <= (before.ellipse95.semi_minor_m or 0.0)
    assert seen(picture, NOW_S + 700.0)["fused/drone1/1"].made_of.towers == []  # type: ignore[union-attr]


def test_a_tower_and_one_drone_are_a_fused_fire_as_well() -> None:
    picture = Picture()
    hear(picture, "drone1", 90.0)
    picture.hear("distloc/tower1/alerts/180", alert(), NOW_S)
    assert seen(picture)["fused/drone1/1"].made_of.towers == ["tower1"]  # type: ignore[union-attr]


@pytest.mark.parametrize(
    ("payload", "reason"),
    [
        (b"{", "not readable: a JSON object is expected"),
        (b"[" * 4_000, "not readable: a JSON object is expected"),
        (b"[1]", "not readable: a JSON object is expected"),
        (b"{}", "lacks platform: letters, digits, '.', '_' and '-', 64 at most"),
        (b"{" * 5_000, "too large"),
        (alert(math.nan), "azimuth_deg must be a number from -360 to 360"),
        (alert(400.0), "azimuth_deg must be a number from -360 to 360"),
        (alert(lat_deg="47"), "lat_deg must be a number from -90 to 90"),
        (alert(lat_deg=95.0, lon_deg=95.0), "lat_deg must be a number from -90 to 90"),
        (alert(lon_deg=math.inf), "lon_deg must be a number from -180 to 180"),
        (alert(lon_deg=None), "lon_deg must be a number from -180 to 180"),
        (alert(opening_deg=-3.0), "opening_deg must be a number over 0, 120 at most"),
        (alert(sigma_deg=0), "sigma_deg must be a number over 0, 45 at most"),
        (alert(mount_sigma_deg=-1), "mount_sigma_deg must be a number over 0, 45 at most"),
        (alert(altitude_msl_m=9e5), "altitude_msl_m must be a number from -500 to 9000"),
        (alert(platform="a b"), "platform must be letters, digits, '.', '_' and '-', 64 at most"),
        (alert(schema="distloc/alert/2"), "schema must be distloc/alert/1, or left out"),
        (alert(time_utc=5), "time_utc must be a time in UTC, as 2026-11-28T15:47:12Z"),
        (alert(lat_deg=LON_DEG, lon_deg=LAT_DEG), "latitude and longitude swapped"),
        (alert(lat_deg=-33.0, lon_deg=151.0), "over 200 km from all others"),
        (alert(time_utc=utc_text(NOW_S + 9e7)), "of the future"),
        (alert(time_utc=utc_text(NOW_S - 4e3)), "over an hour old"),
        (alert(time_utc="yesterday"), "time_utc must be a time in UTC, as 2026-11-28T15:47:12Z"),
        (alert(platform="tower2"), "of another name than its key"),
    ],
)
def test_an_alert_that_cannot_be_is_counted_by_one_reason(payload: bytes, reason: str) -> None:
    picture = Picture()
    picture.hear("distloc/drone1/vehicle", vehicle_bytes(), NOW_S)
    assert not picture.hear("distloc/tower1/alerts", payload, NOW_S)
    assert picture.whole(NOW_S).ground.alerts_refused == {reason: 1}
    assert picture.whole(NOW_S).towers == []


def test_a_tower_stands_and_its_alerts_are_bounded() -> None:
    towers = Towers()
    for n in range(2 * MOST_SECTORS):
        assert towers.hear("tower1", alert(20.0 * n), NOW_S, [])
    assert len(towers.views()[0].sectors) == MOST_SECTORS
    assert not towers.hear("tower1", alert(lat_deg=LAT_DEG), NOW_S, [])
    assert towers.refused == {"a tower in two places": 1}
    for n in range(2 * MOST_TOWERS):
        assert towers.hear(f"t{n}", alert(platform=f"t{n}"), NOW_S, [])
    assert len(towers.views()) == MOST_TOWERS
    towers.forget(NOW_S + 601.0)
    assert towers.views() == []


def test_a_swapped_tower_that_came_before_the_drones_goes_when_they_are_known() -> None:
    picture = Picture()
    assert picture.hear("distloc/tower1/alerts", alert(lat_deg=LON_DEG, lon_deg=LAT_DEG), NOW_S)
    picture.compare(NOW_S)
    assert len(picture.whole(NOW_S).towers) == 1  # nobody knows better
    picture.hear("distloc/drone1/vehicle", vehicle_bytes(), NOW_S)
    picture.compare(NOW_S)
    assert picture.whole(NOW_S).towers == []
    assert picture.whole(NOW_S).ground.alerts_refused == {"latitude and longitude swapped": 1}
    assert picture.hear("distloc/tower1/alerts", alert(), NOW_S)  # as it is mended
    picture.compare(NOW_S)
    assert len(picture.whole(NOW_S).towers) == 1


def test_where_drones_are_known_a_swapped_tower_keeps_no_right_one_out() -> None:
    towers, drones = Towers(), [(LAT_DEG, LON_DEG)]
    assert towers.hear("tower1", alert(lat_deg=LON_DEG, lon_deg=LAT_DEG), NOW_S, [])
    assert towers.hear("tower2", alert(platform="tower2"), NOW_S, drones)


@pytest.mark.parametrize(("here", "is_taken"), [((46.0, 47.1), False), ((47.1, 46.0), True), ((46.0, 46.9), True)])
def test_coordinates_that_are_swapped_to_nearby_are_known_by_who_would_see_nothing_there(
    here: tuple[float, float], is_taken: bool
) -> None:
    """By a drone at 47.3 north, 46 east: 170 km away where swapped, and 22 km where not."""
    said = alert(lat_deg=here[0], lon_deg=here[1])
    drone = (47.3, 46.0) if here != (46.0, 46.9) else (46.0, 46.2)
    assert Towers().hear("tower1", said, NOW_S, [drone]) is is_taken


def test_an_alert_replaces_its_like_and_a_late_copy_does_not() -> None:
    towers = Towers()
    for azimuth_deg, at_s in ((90.0, 0.0), (91.0, 10.0), (90.5, 5.0), (200.0, 1.0)):
        assert towers.hear("tower1", alert(azimuth_deg, time_utc=utc_text(NOW_S + at_s)), NOW_S + 20.0, [])
    assert sorted(one.azimuth_deg for one in towers.views()[0].sectors) == [91.0, 200.0]


def test_an_alerts_key_tells_directions_apart() -> None:
    assert msgspec.json.decode(alert(359.7), type=Alert).key == "distloc/tower1/alerts/0"
