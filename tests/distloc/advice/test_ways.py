"""Where ways lead, and what a fixed camera sees on them."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from distloc.advice.ways import HEADINGS, STOPS, Craft, arcs_of, ways_along, ways_of

NORTH = np.array([0.0, 2000.0])


def test_legs_go_all_round_and_end_where_there_is_time_for() -> None:
    ways = ways_of(Craft(speed_mps=10.0, flight_s=60.0), NORTH)
    assert len(ways) == 2 * HEADINGS and set(ways.kinds) == {"leg"}
    ends = ways.places_m[:, -1]
    assert np.hypot(*ends.T) == pytest.approx(ways.length_m) and set(ways.length_m) == {300.0, 600.0}
    assert np.arctan2(*ends.T) % (2.0 * np.pi) == pytest.approx(ways.heading_rad, abs=1e-9)


@given(st.floats(-3.0, 3.0), st.floats(200.0, 3000.0), st.floats(50.0, 900.0), st.sampled_from([-1.0, 1.0]))
def test_an_arc_keeps_its_distance_and_its_length(bearing: float, range_m: float, length_m: float, side: float) -> None:
    target = range_m * np.array([np.sin(bearing), np.cos(bearing)])
    heading = bearing - side * np.pi / 2.0
    way = ways_along(np.array([heading]), np.array([length_m]), np.array([side * length_m / range_m]), target)
    places = np.concatenate([np.zeros((1, 2)), way.places_m[0]])
    assert np.hypot(*(places - target).T) == pytest.approx(range_m, rel=1e-9)
    steps = np.diff(places, axis=0)
    assert np.hypot(*steps.T).sum() == pytest.approx(length_m, rel=0.01 + 0.1 * (length_m / range_m / STOPS) ** 2)
    first = np.arctan2(*steps[0])
    assert abs(np.angle(np.exp(1j * (first - heading)))) < 0.6 * length_m / range_m / STOPS + 1e-9


def test_arcs_only_where_they_are_no_legs() -> None:
    assert len(arcs_of(Craft(), np.array([0.0, 10_000.0]))) == 0
    arcs = arcs_of(Craft(), np.array([0.0, 1000.0]))
    assert set(arcs.kinds) == {"arc"} and len(arcs) == 4
    right = np.sin(arcs.courses_rad[:, -1] - arcs.heading_rad) > 0.0
    assert np.degrees(arcs.heading_rad[right]) == pytest.approx(270.0)  # it turns right, the target on its right


def test_what_a_fixed_camera_sees() -> None:
    craft = Craft(keeps_target=False, half_view_rad=0.5, camera_yaw_rad=np.pi / 2.0)
    off = np.array([np.pi / 2.0, np.pi / 2.0 + 0.4, np.pi / 2.0 + 0.6, 0.0, -3.0 * np.pi / 2.0])
    assert craft.sees(off).tolist() == [True, True, False, False, True]


@pytest.mark.parametrize("wrong", [{"speed_mps": 0.0}, {"flight_s": float("inf")}, {"half_view_rad": -1.0}])
def test_a_craft_that_cannot_fly_is_refused(wrong: dict[str, float]) -> None:
    with pytest.raises(ValueError, match="must be > 0 and finite"):
        Craft(**wrong)
