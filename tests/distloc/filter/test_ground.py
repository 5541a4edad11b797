"""Heights of the ground in the local axes: hand-computed values, the earth's curvature, what is not known."""

import tracemalloc

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from distloc.filter.ground import FlatGround, GridGround, Ground, NoGround, ground_prior
from distloc.geometry.geodesy import LocalFrame

# rows go north: (0, 0) is at east -100, north 50; a step is 10 m
HEIGHTS = np.array([[10.0, 20.0, 30.0], [40.0, 60.0, np.nan], [0.0, 8.0, 16.0]])
GRID = GridGround(HEIGHTS, -100.0, 50.0, 10.0, 15.0)


def height(ground: Ground, east_m: float, north_m: float) -> float | None:
    up_m, known = ground.heights_m(np.array([east_m]), np.array([north_m]))
    assert up_m.dtype == np.float32 and (known[0] or up_m[0] == 0.0)
    return float(up_m[0]) if known[0] else None


@pytest.mark.parametrize(
    ("east_m", "north_m", "up_m"),
    [
        (-100.0, 50.0, 10.0),  # the corners
        (-80.0, 50.0, None),  # its cell has the void
        (-100.0, 70.0, 0.0),
        (-90.0, 60.0, None),  # a corner of the void's cell; the cell to the north-east is the one that answers
        (-95.0, 50.0, 15.0),
        (-100.0, 55.0, 25.0),
        (-97.5, 54.0, 0.6 * 12.5 + 0.4 * 45.0),
        (-95.0, 65.0, 27.0),  # the mean of 40, 60, 0, 8
        (-92.0, 69.0, 0.1 * 56.0 + 0.9 * 6.4),
        (-85.0, 55.0, None),
        (-85.0, 65.0, None),
        (-100.01, 55.0, None),  # outside on each side
        (-79.99, 55.0, None),
        (-95.0, 49.99, None),
        (-95.0, 70.01, None),
        (float("nan"), 55.0, None),
        (-95.0, float("inf"), None),
    ],
)
def test_a_grid_between_its_nodes(east_m: float, north_m: float, up_m: float | None) -> None:
    assert height(GRID, east_m, north_m) == (None if up_m is None else pytest.approx(up_m, abs=1e-4))


def test_the_far_corner_of_a_grid_is_on_it() -> None:
    grid = GridGround([[1.0, 2.0], [3.0, 4.0]], 0.0, 0.0, 30.0, 1.0)
    assert [height(grid, *place) for place in ((0, 0), (30, 0), (0, 30), (30, 30))] == [1.0, 2.0, 3.0, 4.0]


@given(
    st.lists(st.tuples(st.floats(-1000, 1000), st.floats(-1000, 1000)), min_size=1, max_size=20),
    st.floats(-1, 1),
    st.floats(-1, 1),
)
def test_a_plane_comes_back_as_it_is(places: list[tuple[float, float]], by_east: float, by_north: float) -> None:
    axis = np.linspace(-1000.0, 1000.0, 41)
    grid = GridGround(by_east * axis + by_north * axis[:, None], -1000.0, -1000.0, 50.0, 1.0)
    east, north = np.array(places).T
    up, known = grid.heights_m(east, north)
    assert known.all() and up == pytest.approx(by_east * east + by_north * north, abs=1e-2)


def test_blocks_of_float32_answer_as_float64_does_and_allocate_little() -> None:
    rng = np.random.default_rng(0)
    grid = GridGround(rng.normal(0.0, 1.0, (1201, 1201)), -30_000.0, -30_000.0, 50.0, 15.0)
    east, north = rng.uniform(-31_000.0, 31_000.0, (2, 8192))
    wide, wide_known = grid.heights_m(east, north)
    tracemalloc.start()
    up, known = grid.heights_m(east.astype(np.float32), north.astype(np.float32))
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert np.mean(known == wide_known) > 0.999 and 0.9 < known.mean() < 0.97  # (60 / 62)^2 is 0.937
    assert up == pytest.approx(wide, abs=2e-3)
    assert peak < 16 * 4 * 8192


@pytest.mark.parametrize(("distance_m", "drop_m"), [(0.0, 0.0), (1000.0, 0.0785), (10_000.0, 7.848), (30_000.0, 70.63)])
def test_flat_ground_falls_away_as_the_earth_curves(distance_m: float, drop_m: float) -> None:
    ground = FlatGround(-50.0, 30.0)
    for east, north in ((distance_m, 0.0), (0.0, -distance_m), (0.6 * distance_m, 0.8 * distance_m)):
        assert height(ground, east, north) == pytest.approx(-50.0 - drop_m, abs=0.01)


@pytest.mark.parametrize("lat_deg", [0.0, -35.3, 62.0])
def test_flat_ground_is_level_on_the_ellipsoid(lat_deg: float) -> None:
    frame = LocalFrame(lat_deg, 25.0, 300.0)
    ground = FlatGround(120.0 - 300.0, 30.0)
    for place in ((0.0, 0.27), (0.2, -0.1), (-0.1, 0.0)):
        east, north, up = frame.enu_from_geodetic(lat_deg + place[0], 25.0 + place[1], 120.0)
        assert height(ground, east, north) == pytest.approx(up, abs=0.6)


def test_flat_ground_has_no_height_where_there_is_no_place() -> None:
    assert height(FlatGround(5.0, 1.0), float("nan"), 0.0) is None
    assert height(FlatGround(5.0, 1.0), 0.0, float("-inf")) is None


def test_no_ground_knows_nothing() -> None:
    up, known = NoGround().heights_m(np.zeros(4), np.zeros(4))
    assert up.tolist() == [0.0] * 4 and not known.any() and NoGround().sigma_m == float("inf")


@pytest.mark.parametrize("sigma_m", [0.0, -1.0, float("nan"), float("inf")])
def test_sigma_must_be_positive(sigma_m: float) -> None:
    with pytest.raises(ValueError, match="sigma_m must be > 0"):
        FlatGround(0.0, sigma_m)
    with pytest.raises(ValueError, match="sigma_m must be > 0"):
        GridGround(np.zeros((2, 2)), 0.0, 0.0, 1.0, sigma_m)


def test_a_grid_must_be_one() -> None:
    with pytest.raises(ValueError, match="2 or more of each"):
        GridGround(np.zeros((1, 5)), 0.0, 0.0, 1.0, 1.0)
    with pytest.raises(ValueError, match="step_m > 0"):
        GridGround(np.zeros((2, 2)), 0.0, 0.0, 0.0, 1.0)
    with pytest.raises(ValueError, match="up_m must be finite"):
        FlatGround(float("nan"), 1.0)


def test_land_is_less_surely_flat_the_farther_from_home() -> None:
    east, north = np.array([0.0, 300.0, 30_000.0]), np.array([0.0, 400.0, 0.0])
    assert FlatGround(0.0, 30.0, slope=0.1).sigmas_m(east, north) == pytest.approx(
        [30.0, np.hypot(30.0, 50.0), np.hypot(30.0, 500.0)]
    )
    assert FlatGround(0.0, 30.0, slope=0.0).sigmas_m(east, north) == pytest.approx([30.0] * 3)
    assert NoGround().sigmas_m(east, north).tolist() == [np.inf] * 3
    with pytest.raises(ValueError, match="slope must be >= 0"):
        FlatGround(0.0, 30.0, slope=-0.1)


def test_flat_ground_by_itself_leaves_the_range_open_where_a_slope_may_be() -> None:
    camera_enu_m = np.array([0.0, 0.0, 100.0])
    along = np.array([0.0, 1.0, -0.05])  # at the ground after 2 km
    points_enu_m = camera_enu_m[:, None] + along[:, None] * np.array([1000.0, 2000.0, 3500.0])
    weights = []
    for slope in (0.0, 0.08):
        prior = ground_prior(FlatGround(0.0, 30.0, slope), camera_enu_m, 0.0)
        assert prior is not None
        weights.append(np.exp(prior(points_enu_m)))
    level, hilly = weights
    assert level[[0, 2]].max() < 0.4 * level[1]
    assert hilly.min() > 0.7 * hilly.max()
