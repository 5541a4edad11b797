"""Smoke is not its fire: with a told offset the places hold the fire, without one they hold the smoke."""

import math
from dataclasses import replace

import numpy as np
import pytest

from distloc.batch.locate import locate
from distloc.batch.sighting import Sighting
from distloc.filter.uncertainty import ellipse_holds
from distloc.types import FloatArray, PoseErrors
from tests.support.sightings import FRAME, seen

TOWERS_ENU_M = np.array([[-9e3, -6e3, 700.0], [8e3, -7e3, 600.0], [1e3, 9e3, 800.0]])
FIRE_ENU_M = np.array([500.0, 300.0, 200.0])
NORTH_M, STRAIGHT = np.array([0.0, 1e3, 0.0]), np.zeros(3)
ERRORS = PoseErrors(math.radians(0.3), math.radians(0.3), math.radians(0.1), 1.0, 1e9)


def looks(rng: np.random.Generator, at_enu_m: FloatArray, offset_m: float) -> list[Sighting]:
    """Each of three well-kept towers looks five times at one point."""
    return [
        replace(
            seen(tower, at_enu_m, bias + rng.normal(0.0, 2e-3, 3), platform=f"t{number}", stamp_s=60.0 * look),
            errors=ERRORS,
            smoke_offset_m=offset_m,
        )
        for number, (tower, bias) in enumerate(
            zip(TOWERS_ENU_M, rng.normal(0.0, ERRORS.heading_bias_rad, (3, 3)), strict=True)
        )
        for look in range(5)
    ]


def share_held(offset_m: float, seeds: range) -> float:
    held = 0
    for seed in seeds:
        rng = np.random.default_rng([77, seed])
        smoke_enu_m = FIRE_ENU_M + np.append(rng.normal(0.0, 300.0, 2), 0.0)
        place = locate(looks(rng, smoke_enu_m, offset_m)).places[0]
        assert place.ellipse95 is not None and place.lat_deg is not None and place.lon_deg is not None
        assert place.smoke_offset_m >= offset_m
        beside_m = FIRE_ENU_M - FRAME.enu_from_geodetic(place.lat_deg, place.lon_deg, place.height_m or 0.0)
        held += ellipse_holds(place.ellipse95, beside_m[:2])
    return held / len(seeds)


def test_a_told_offset_holds_the_fire_and_none_does_not() -> None:
    assert share_held(300.0, range(60)) >= 0.9
    assert share_held(0.0, range(20)) < 0.6


def test_intervals_widen_with_the_region() -> None:
    mark, smoke = (locate(looks(np.random.default_rng(3), FIRE_ENU_M, m)).places[0] for m in (0.0, 400.0))
    assert mark.ellipse95 is not None and smoke.ellipse95 is not None
    assert smoke.ellipse95.semi_minor_m == pytest.approx(
        math.hypot(mark.ellipse95.semi_minor_m, 2.448 * smoke.smoke_offset_m), rel=0.01
    )
    assert mark.covariance_enu_m2 is not None and smoke.covariance_enu_m2 is not None
    grown = smoke.covariance_enu_m2 - mark.covariance_enu_m2
    assert grown == pytest.approx(np.diag([smoke.smoke_offset_m**2] * 2 + [0.0]), rel=1e-6)
    near, far = smoke.bearing.range95_m
    assert near < mark.bearing.range95_m[0] - 300.0 and far > mark.bearing.range95_m[1] + 300.0
    assert smoke.bearing.parts95_m[0][0] == pytest.approx(near, abs=200.0)
    assert smoke.bearing.azimuth95_rad > math.atan(1.96 * 400.0 / far)


def test_a_bearing_alone_is_wider_too() -> None:
    one = looks(np.random.default_rng(3), FIRE_ENU_M, 0.0)[0]
    mark = locate([one]).places[0]
    smoke = locate([replace(one, smoke_offset_m=500.0)]).places[0]
    assert mark.position_enu_m is None and smoke.position_enu_m is None
    assert smoke.bearing.azimuth95_rad > mark.bearing.azimuth95_rad
    assert math.isinf(smoke.bearing.range95_m[1])


@pytest.mark.parametrize("offset_m", [-1.0, math.nan, math.inf, 1e6])
def test_an_offset_that_cannot_be_is_refused(offset_m: float) -> None:
    with pytest.raises(ValueError, match="smoke_offset_m must be 0 to 20000 metres"):
        replace(looks(np.random.default_rng(3), FIRE_ENU_M, 0.0)[0], smoke_offset_m=offset_m)


def test_two_against_one_is_disputed_and_every_crossing_told() -> None:
    """Any two bearings cross: which tower is wrong cannot be known."""
    rng = np.random.default_rng(5)
    elsewhere = FIRE_ENU_M + 6.0 * NORTH_M
    whole = [
        *(one for one in looks(rng, FIRE_ENU_M, 0.0) if one.platform != "t1"),
        *(one for one in looks(rng, elsewhere, 0.0) if one.platform == "t1"),
    ]
    bearings = [replace(one, target="oak", sigma_rad=(2e-3, math.radians(10.0))) for one in whole]
    places = locate(bearings).places
    assert len(places) >= 2 and all(place.is_disputed for place in places)
    assert {place.target for place in places} == {"oak"}
    beside_m = [FRAME.enu_from_geodetic(p.lat_deg or 0.0, p.lon_deg or 0.0, 0.0)[:2] - FIRE_ENU_M[:2] for p in places]
    assert min(float(np.hypot(*one)) for one in beside_m) < 500.0


def test_three_against_one_are_believed_and_who_differs_is_named() -> None:
    rng = np.random.default_rng(6)
    fourth = np.array([-8e3, 6e3, 500.0])
    beside = FIRE_ENU_M + 8.0 * NORTH_M
    astray = [
        replace(seen(fourth, beside, STRAIGHT, platform="t9", stamp_s=60.0 * look), errors=ERRORS, target="a")
        for look in range(5)
    ]
    (place,) = locate([*(replace(one, target="a") for one in looks(rng, FIRE_ENU_M, 0.0)), *astray]).places
    assert place.against == ("t9",) and not place.is_disputed


def test_a_craft_that_saw_it_from_many_places_is_not_disputed_by_a_stray_bearing() -> None:
    craft = [
        seen(np.array([200.0 * i - 1e3, -2e3, 300.0]), FIRE_ENU_M, STRAIGHT, platform="d", stamp_s=10.0 * i)
        for i in range(12)
    ]
    stray = seen(TOWERS_ENU_M[0], FIRE_ENU_M + 6.0 * NORTH_M, STRAIGHT, platform="t0", stamp_s=5.0)
    places = locate([*craft, stray]).places
    assert not places[0].is_disputed
