"""The picture: what it keeps, what it refuses, what it says is new, and that it is bounded."""

import json
from typing import Any

import msgspec
import pytest

from service.ground.picture.fires import MOST_FIRES, MOST_FIRES_EACH
from service.ground.picture.fleet import MOST_DRONES
from service.ground.picture.marks import Mark
from service.ground.picture.picture import Picture
from tests.support.ground_samples import NOW_S, report, report_bytes, status_bytes, vehicle_bytes

KEY = "distloc/drone1/targets/3"


@pytest.fixture
def picture() -> Picture:
    return Picture()


def test_what_is_heard_is_news_once(picture: Picture) -> None:
    assert picture.hear(KEY, report_bytes(), NOW_S)
    assert picture.hear("distloc/drone1/vehicle", vehicle_bytes(), NOW_S)
    news = picture.changes(NOW_S)
    (fire,), (drone,) = news.fires, news.drones
    assert (fire.id, fire.state, drone.name, drone.heading_deg) == ("drone1/3", "confirmed", "drone1", 70.0)
    assert (fire.ellipse95, fire.region95) == (report().properties.ellipse95, report().properties.region95)
    assert fire.place is not None and fire.place.minutes == "47° 25.664' N  008° 36.335' E"
    assert not picture.changed()
    assert [one.id for one in picture.whole(NOW_S).fires] == ["drone1/3"]


@pytest.mark.parametrize("behind_s", [0.0, 3600.0, -3600.0])
def test_times_are_the_grounds_whatever_the_drones_clock(picture: Picture, behind_s: float) -> None:
    drone_s = NOW_S - behind_s
    picture.hear(KEY, report_bytes(at_s=drone_s - 600.0), NOW_S)  # the cache's, ten minutes old: a late joiner
    picture.hear("distloc/drone1/status", status_bytes(at_s=drone_s), NOW_S)
    (fire,) = picture.changes(NOW_S).fires
    assert fire.seen_s == pytest.approx(NOW_S - 601.0, abs=0.01)
    (drone,) = picture.whole(NOW_S).drones
    assert drone.clock_behind_s == pytest.approx(behind_s, abs=0.01)


@pytest.mark.parametrize("delay_s", [0.3, 5.0, 20.0, 60.0])
def test_a_slow_link_makes_nothing_fresh(picture: Picture, delay_s: float) -> None:
    """Its delay and a clock that is behind look alike: the older of the two readings is shown, and that is said."""
    picture.hear("distloc/drone1/status", status_bytes(at_s=NOW_S - delay_s), NOW_S)
    picture.hear(KEY, report_bytes(at_s=NOW_S - delay_s), NOW_S)
    whole = picture.whole(NOW_S)
    assert whole.fires[0].seen_s == pytest.approx(NOW_S - delay_s - 1.0, abs=0.01)
    assert whole.drones[0].may_be_delay
    picture.hear("distloc/drone1/preview", b"\xff\xd8\xff", NOW_S)  # as late as the report: the fire is in it
    assert picture.whole(NOW_S).fires[0].preview_s == NOW_S


@pytest.mark.parametrize("step_s", [-3600.0, 7200.0])
def test_nothing_gets_older_or_fresher_where_the_grounds_clock_is_set(picture: Picture, step_s: float) -> None:
    def ages_s(now_s: float) -> list[float]:
        whole = picture.whole(now_s)
        (fire,), (one,) = whole.fires, whole.drones
        times_s = (fire.told_s, fire.seen_s, fire.first_s, fire.preview_s, one.heard_s, one.preview_s)
        return [now_s - (each or 0.0) for each in times_s]

    for kind, payload in (("status", status_bytes()), ("targets/3", report_bytes()), ("preview", b"\xff\xd8\xff")):
        picture.hear(f"distloc/drone1/{kind}", payload, NOW_S + 0.1)
    before, _ = ages_s(NOW_S + 50.0), picture.changed()
    picture.set_clock_on(step_s)
    assert ages_s(NOW_S + 50.0 + step_s) == pytest.approx(before, abs=1e-3)
    assert picture.changed() == ({"drone1/3"}, {"drone1"})
    picture.hear(KEY, report_bytes(at_s=NOW_S + 51.0), NOW_S + 51.0 + step_s)
    (fire,) = picture.whole(NOW_S + 51.0 + step_s).fires
    assert fire.seen_s == pytest.approx(NOW_S + 50.0 + step_s, abs=0.2)


def test_a_late_copy_does_not_replace_the_newer_and_a_clock_set_back_does(picture: Picture) -> None:
    picture.hear(KEY, report_bytes(at_s=NOW_S), NOW_S)
    picture.hear(KEY, report_bytes(at_s=NOW_S - 2.0, state="tentative"), NOW_S)
    assert picture.whole(NOW_S).fires[0].state == "confirmed"
    picture.hear(KEY, report_bytes(at_s=NOW_S - 4000.0, state="coasting"), NOW_S)
    assert picture.whole(NOW_S).fires[0].state == "coasting"


BAD: list[tuple[str, bytes, str]] = [
    (KEY, b"{}", "not readable"),
    (KEY, b"\xff\xfe", "not readable"),
    (KEY, b'{"a":' * 10_000, "not readable"),
    (KEY, b" " * 100_000, "too large"),
    (KEY, report_bytes(lat_deg=91.0), "not readable"),
    (KEY, report_bytes().replace(b"47.42774", b"NaN"), "not readable"),
    (KEY, report_bytes().replace(b"47.42774", b"1e999"), "not readable"),
    (KEY, report_bytes(vehicle="drone2"), "of another name than its key"),
    (KEY, report_bytes(target=4), "of another name than its key"),
    ("distloc/drone1/status", b"[" * 50_000, "not readable"),
    ("distloc/drone1/preview", b"<html>", "not readable"),
    ("distloc/drone1/preview", b"\xff\xd8\xff" + b"0" * 1_000_000, "too large"),
    ("distloc/drone1/what", b"{}", "of no known kind"),
]


@pytest.mark.parametrize(("key", "payload", "reason"), BAD)
def test_what_is_wrong_is_counted_by_drone_and_changes_nothing(
    picture: Picture, key: str, payload: bytes, reason: str
) -> None:
    picture.hear(KEY, report_bytes(), NOW_S)
    before = picture.whole(NOW_S).fires
    assert not picture.hear(key, payload, NOW_S)
    assert picture.whole(NOW_S).drones[0].refused == {reason: 1}
    assert picture.whole(NOW_S).fires == before


def test_a_fire_and_a_mark_not_readable_leave_no_drone_behind(picture: Picture) -> None:
    mark = json.dumps({"vehicle": "x", "target": 1, "time_s": NOW_S}).encode()
    for payload in (
        b"{}",
        b"[" * 90_000,
        mark + b" " * 64_000 + b"}",
        json.dumps({"vehicle": "x", "target": 1, "time_s": 1e300}).encode(),
    ):
        assert not picture.hear("distloc/x/marks/1", payload, NOW_S)
    assert not picture.whole(NOW_S).drones


FOUL = "\x1b[2J</script><img src=x onerror=alert(1)>\u202e\n"


def test_every_string_is_printable_and_short(picture: Picture) -> None:
    name = FOUL.replace("/", "")
    picture.hear(f"distloc/{name}/targets/1", report_bytes(1, name, degraded=[FOUL * 5] * 50, aim=FOUL), NOW_S)
    picture.hear(f"distloc/{name}/status", status_bytes(name, degraded=(FOUL,) * 1000), NOW_S)
    picture.hear(f"distloc/{name}/vehicle", vehicle_bytes(name), NOW_S)
    whole = picture.whole(NOW_S)
    picture.mark(Mark(vehicle=whole.fires[0].vehicle, target=1, time_s=0.0, name=FOUL), NOW_S)

    def strings(value: Any) -> list[str]:
        if isinstance(value, str):
            return [value]
        parts = value.values() if isinstance(value, dict) else value if isinstance(value, list) else ()
        return [one for part in parts for one in strings(part)]

    found = strings(msgspec.to_builtins(picture.whole(NOW_S)))
    assert any("onerror" in one for one in found)  # it is shown as what it is
    assert all(one.isprintable() and len(one) < 700 for one in found)


def test_the_picture_is_bounded_and_the_urgent_stays(picture: Picture) -> None:
    picture.hear("distloc/d0/targets/999", report_bytes(999, "d0"), NOW_S)
    for target in range(MOST_FIRES_EACH + 5):
        picture.hear(f"distloc/d0/targets/{target}", report_bytes(target, "d0", "tentative"), NOW_S + target)
    fires = picture.whole(NOW_S).fires
    assert len(fires) == MOST_FIRES_EACH and "d0/999" in {one.id for one in fires}
    for number in range(MOST_DRONES + 10):
        for target in range(20):
            picture.hear(f"distloc/d{number}/targets/{target}", report_bytes(target, f"d{number}"), NOW_S)
    whole = picture.whole(NOW_S)
    assert len(whole.drones) == MOST_DRONES and len(whole.fires) <= MOST_FIRES
    assert whole.ground.left_out > 0
    assert {one.vehicle for one in whole.fires} <= {one.name for one in whole.drones}


def test_a_flood_of_names_takes_no_place_of_a_drone_that_goes_on_telling(picture: Picture) -> None:
    """Neither junk nor reports: names that anybody can make up; who joins takes the place of one that told nothing."""
    names = {f"d{number}" for number in range(MOST_DRONES - 1)}
    for name in names:
        picture.hear(f"distloc/{name}/targets/1", report_bytes(1, name), NOW_S)
    for number in range(3 * MOST_DRONES):
        picture.hear(f"distloc/junk{number}/status", b"{", NOW_S + 1.0)
        picture.refuse(f"more{number}", "more than can be read", 1, NOW_S + 1.0)
        picture.alive(f"distloc/there{number}/alive", True, NOW_S + 1.0)
    assert names < {one.name for one in picture.whole(NOW_S).drones}
    assert picture.hear("distloc/late/targets/1", report_bytes(1, "late"), NOW_S + 2.0)
    for number in range(3 * MOST_DRONES):
        assert not picture.hear(f"distloc/new{number}/targets/1", report_bytes(1, f"new{number}"), NOW_S + 3.0)
    whole = picture.whole(NOW_S + 3.0)
    assert {one.name for one in whole.drones} == names | {"late"} == {one.vehicle for one in whole.fires}
    assert whole.ground.left_out > 3 * MOST_DRONES
    assert picture.hear("distloc/new/targets/1", report_bytes(1, "new"), NOW_S + 100.0)  # the others fell silent


def test_what_went_is_told(picture: Picture) -> None:
    for number in range(MOST_DRONES):
        picture.hear(f"distloc/d{number}/targets/1", report_bytes(1, f"d{number}"), NOW_S)
    picture.alive("distloc/d7/alive", False, NOW_S)
    picture.changes(NOW_S)
    picture.alive("distloc/new/alive", True, NOW_S)
    news = picture.changes(NOW_S)
    assert (news.gone_drones, news.gone_fires) == (["d7"], ["d7/1"])  # who is gone gives way first


def test_two_drones_of_one_name_are_told_and_one_that_restarted_is_not(picture: Picture) -> None:
    def is_twice(*senders: str) -> bool:
        one = Picture()
        for index, sender in enumerate(senders):
            one.hear("distloc/drone1/vehicle", vehicle_bytes(), NOW_S + index, sender)
        return one.whole(NOW_S + len(senders)).drones[0].is_twice

    assert is_twice("a", "b", "a", "b")
    assert not is_twice("a", "a", "b", "b", "b")


def test_marks_are_kept_told_and_the_later_holds(picture: Picture) -> None:
    picture.hear(KEY, report_bytes(), NOW_S)
    mark = Mark(vehicle="drone1", target=3, time_s=0.0, name="Mill fire")
    told = picture.mark(mark, NOW_S)
    assert told is not None and told.time_s == NOW_S
    ahead = Mark(vehicle="drone1", target=3, time_s=NOW_S + 3600.0, verdict="not_a_fire")
    assert picture.hear("distloc/drone1/marks/3", json.dumps(_plain(ahead)).encode(), NOW_S)
    assert picture.whole(NOW_S).fires[0].mark == ahead
    assert not picture.hear("distloc/drone1/marks/3", json.dumps(_plain(told)).encode(), NOW_S)
    again = picture.mark(mark, NOW_S + 1.0)  # a ground whose clock is an hour ahead does not have the last word
    assert again is not None and again.time_s > ahead.time_s
    assert picture.whole(NOW_S).fires[0].mark == again
    assert picture.mark(Mark(vehicle="drone1", target=9, time_s=0.0), NOW_S) is None


def _plain(mark: Mark) -> dict[str, Any]:
    return {name: getattr(mark, name) for name in mark.__struct_fields__}
