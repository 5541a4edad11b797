"""Fires of two drones that may be one: those whose ellipses overlap, as points that lie in both say."""

import numpy as np
import pytest

from distloc.types import FloatArray
from service.ground.picture.fused.twins import MOST_EACH, overlap
from service.ground.picture.marks import Mark
from service.ground.picture.picture import Picture
from tests.support.ground_samples import NOW_S, ellipse, report_bytes

LAT_DEG, LON_DEG = 47.42774, 8.60559
NORTH_DEG = 1.0 / 111_190.0  # a metre


def matrices(major: FloatArray, minor: FloatArray, azimuth: FloatArray) -> FloatArray:
    east, north = np.sin(azimuth), np.cos(azimuth)
    return np.stack(
        [
            major**2 * east**2 + minor**2 * north**2,
            (major**2 - minor**2) * east * north,
            major**2 * north**2 + minor**2 * east**2,
        ]
    )


def test_overlap_is_as_points_of_one_in_the_other_say() -> None:
    """300 pairs of any shape; by the points of a fine grid in the one, of which some are or none is in the other."""
    rng = np.random.default_rng(5)
    major, share, azimuth = (
        rng.uniform(20.0, 500.0, (2, 300)),
        rng.uniform(0.02, 1.0, (2, 300)),
        rng.uniform(0, 3, (2, 300)),
    )
    away = rng.uniform(-600.0, 600.0, (2, 300))
    first, second = (matrices(major[i], major[i] * share[i], azimuth[i]) for i in (0, 1))
    turn, radius = (part.ravel() for part in np.meshgrid(np.linspace(0, 2 * np.pi, 720), np.linspace(0, 1, 60)))
    said = overlap(first, second, away)
    assert 60 < said.sum() < 240
    for n in range(300):
        lengths = np.stack([major[0, n] * radius * np.cos(turn), major[0, n] * share[0, n] * radius * np.sin(turn)])
        s, c = np.sin(azimuth[0, n]), np.cos(azimuth[0, n])
        x, y = np.array([[s, c], [c, -s]]) @ lengths - away[:, n : n + 1]
        xx, xy, yy = second[:, n]
        least = ((yy * x * x - 2 * xy * x * y + xx * y * y) / (xx * yy - xy * xy)).min()
        if not 0.97 < least < 1.03:  # they but touch, and the grid has its grain
            assert said[n] == (least < 1.0), n


def told(picture: Picture) -> dict[str, list[str]]:
    picture.compare(NOW_S)
    return {one.id: one.may_be for one in picture.whole(NOW_S).fires if one.may_be}


# Without a range nothing is fused: what is fused is no pair any more.
def hear(picture: Picture, vehicle: str, target: int = 3, north_m: float = 0.0, **said: object) -> None:
    lat_deg = LAT_DEG + north_m * NORTH_DEG
    payload = report_bytes(
        target, vehicle, lat_deg=lat_deg, **({"ellipse95": ellipse(200.0, 50.0, 90.0), "range_m": None} | said)
    )
    assert picture.hear(f"distloc/{vehicle}/targets/{target}", payload, NOW_S)


@pytest.mark.parametrize(
    ("north_m", "said", "is_one"),
    [
        (90.0, {}, True),
        (110.0, {}, False),
        (240.0, {"ellipse95": ellipse(200.0, 50.0, 0.0)}, True),
        (90.0, {"state": "coasting"}, True),
        (90.0, {"state": "dismissed"}, False),
        (90.0, {"ellipse95": ellipse(None, None, None)}, False),
        (90.0, {"ellipse95": ellipse(1e9, 1e9, 0.0)}, False),  # nothing is known of where it is
        (90.0, {"ellipse95": ellipse(50.0, -1.0, 0.0)}, False),
        (90.0, {"ellipse95": ellipse(50.0, 50.0, 1e308)}, False),
    ],
)
def test_fires_of_two_drones_whose_ellipses_overlap_may_be_one(north_m: float, said: dict, is_one: bool) -> None:  # type: ignore[type-arg]
    picture = Picture()
    hear(picture, "drone1")
    hear(picture, "drone2", 4, north_m, **said)
    assert told(picture) == ({"drone1/3": ["drone2/4"], "drone2/4": ["drone1/3"]} if is_one else {})


def test_two_fires_of_one_drone_are_two() -> None:
    picture = Picture()
    hear(picture, "drone1", 3)
    hear(picture, "drone1", 4)
    assert told(picture) == {}


def test_it_is_news_when_they_part_and_no_fire_is_none() -> None:
    picture = Picture()
    hear(picture, "drone1")
    hear(picture, "drone2")
    assert len(told(picture)) == 2
    picture.changed()
    picture.compare(NOW_S)
    assert not picture.changed()  # nothing new
    picture.mark(Mark(vehicle="drone2", target=3, time_s=0.0, verdict="not_a_fire"), NOW_S)
    picture.changed()
    picture.compare(NOW_S)
    assert picture.changed().fires == {"drone1/3", "drone2/3"}
    assert told(picture) == {}


def test_a_crowd_in_one_place_is_bounded() -> None:
    picture = Picture()
    for number in range(30):
        for target in range(20):
            hear(picture, f"d{number}", target)
    found = told(picture)
    assert found and all(len(one) == MOST_EACH for one in found.values())


def test_over_the_date_line_it_is_one_too() -> None:
    picture = Picture()
    for vehicle, lon_deg in (("drone1", 179.9999), ("drone2", -179.9999)):
        payload = report_bytes(1, vehicle, lat_deg=0.0, lon_deg=lon_deg, range_m=None)
        picture.hear(f"distloc/{vehicle}/targets/1", payload, NOW_S)
    assert told(picture) == {"drone1/1": ["drone2/1"], "drone2/1": ["drone1/1"]}
