"""One sighting and the ground: the ranges that it allows, what a crest hides included."""

import math

import numpy as np

from distloc.batch.locate import locate
from distloc.batch.sighting import Sighting, direction_from_azimuth
from distloc.filter.ground import FlatGround, GridGround
from distloc.geometry.geodesy import LocalFrame
from tests.support.sightings import tower_errors


def test_flat_ground_bounds_the_range_of_one_sighting() -> None:
    one = Sighting(47.0, 8.0, 500.0, direction_from_azimuth(0.0, math.radians(-6.0)))
    (place,) = locate([one], ground=lambda frame: FlatGround(200.0 - frame.origin[2], 30.0, slope=0.0)).places
    low_m, high_m = place.bearing.range95_m
    # 300 m over 2,854 m; the tilt's half a degree moves that by 240 m, the ground's 30 m by 286
    assert 1900.0 < low_m < 2400.0 and 3400.0 < high_m < 4200.0
    assert place.ellipse95 is not None


def test_a_ground_that_the_sighting_contradicts_is_not_believed() -> None:
    up = Sighting(47.0, 8.0, 500.0, direction_from_azimuth(0.0, math.radians(10.0)))
    located = locate([up], ground=lambda frame: FlatGround(400.0 - frame.origin[2], 10.0, slope=0.0))
    assert not located.places[0].is_bounded and "the ground is over" in located.notes[0]


def with_crest(frame: LocalFrame) -> GridGround:
    """Land 300 m under the camera, a crest across at 2.5 km that is 120 m high, hills from 6 km on."""
    axis_m = np.arange(-70e3, 70e3 + 1.0, 100.0)
    north_m = axis_m[:, None] + 0.0 * axis_m
    up_m = -300.0 + 120.0 * np.exp(-0.5 * np.square((north_m - 2500.0) / 150.0))
    up_m += np.clip(0.1 * (north_m - 6000.0), 0.0, 600.0)
    return GridGround(up_m, -70e3, -70e3, 100.0, 5.0)


def parts_of(elevation_deg: float) -> tuple[tuple[float, float], ...]:
    errors = tower_errors(0.05, 2.0)
    one = Sighting(47.0, 8.0, 500.0, direction_from_azimuth(0.0, math.radians(elevation_deg)), errors=errors)
    (place,) = locate([one], ground=with_crest).places
    return place.bearing.parts95_m


def test_a_foot_on_the_ground_before_the_crest_is_there() -> None:
    ((low_m, high_m),) = parts_of(-8.0)
    assert low_m > 1900.0 and high_m < 2400.0  # 300 m down at 8 degrees: 2,134 m


def test_smoke_over_the_crest_may_rise_from_behind_it() -> None:
    # the crest's line is at -4.1 degrees: the fire is on the crest or anywhere behind it that it hides
    parts = parts_of(-4.1)
    assert parts[0][0] < 2600.0
    assert parts[-1][1] > 3500.0
    # the line meets open ground again at 300 / tan 4.1: nothing is hidden beyond that
    assert parts[-1][1] < 5000.0


def test_a_foot_beyond_the_crest_is_not_on_it() -> None:
    parts = parts_of(-2.5)
    assert parts[0][0] > 5500.0 and parts[-1][1] < 8000.0  # the line meets the hills at 6.3 km
