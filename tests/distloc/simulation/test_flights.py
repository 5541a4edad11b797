import numpy as np
import pytest

from distloc.simulation.flights import GEOMETRIES, SPEED_MPS, Flight, Geometry, flight_past, paper_flight
from distloc.types import FloatArray
from tests.support.cube_samples import CAMERA, R_NORTH

TARGET = np.array([700.0, -300.0, 40.0])
HEIGHT_M = 120.0
RANGES_M = (500.0, 1000.0, 3000.0, 10_000.0)


def positions(flight: Flight) -> FloatArray:
    return np.array([flight.pose_at(float(stamp_s)).position_enu_m for stamp_s in flight.stamps_s])


def from_target(flight: Flight) -> FloatArray:
    return positions(flight) - TARGET


def past(geometry: Geometry, range_m: float = 1000.0, step_m: float = 10.0, wobble_rad: float = 0.0) -> Flight:
    return flight_past(geometry, TARGET, range_m, 0.5 * range_m, step_m, HEIGHT_M, wobble_rad)


def target_px(flight: Flight, stamp_s: float) -> tuple[FloatArray, bool]:
    pose = flight.pose_at(stamp_s)
    pixels, is_visible = CAMERA.project(pose.R_cam_from_enu @ (TARGET - pose.position_enu_m)[:, None])
    return pixels[:, 0], bool(is_visible[0])


def test_the_papers_flight() -> None:
    flight = paper_flight()
    places = positions(flight)
    assert places.shape == (101, 3)
    assert places[0] == pytest.approx([0.0, 0.0, 0.0]) and places[-1] == pytest.approx([1000.0, 0.0, 0.0])
    assert np.diff(places, axis=0) == pytest.approx(np.tile([10.0, 0.0, 0.0], (100, 1)))
    for stamp_s in flight.stamps_s:
        assert flight.pose_at(float(stamp_s)).R_cam_from_enu == pytest.approx(R_NORTH, abs=1e-12)
    assert paper_flight(50.0).stamps_s == pytest.approx(np.arange(21) * 5.0)


@pytest.mark.parametrize("range_m", RANGES_M)
@pytest.mark.parametrize("geometry", GEOMETRIES)
def test_flights_have_their_length_start_and_stamps(geometry: Geometry, range_m: float) -> None:
    step_m = range_m / 500.0
    flight = past(geometry, range_m, step_m)
    places = positions(flight)
    flown_m = np.linalg.norm(np.diff(places, axis=0), axis=1).sum()
    assert flown_m == pytest.approx(0.0 if geometry == "hover" else 0.5 * range_m, rel=6e-3)
    west_m = {"perpendicular": 0.25, "lawnmower": 0.053125}.get(geometry, 0.0) * range_m
    assert places[0] == pytest.approx([TARGET[0] - west_m, TARGET[1] - range_m, HEIGHT_M], abs=1e-6)
    assert flight.stamps_s[0] == 0.0 and flight.stamps_s[-1] == pytest.approx(0.05 * range_m)
    assert np.diff(flight.stamps_s) == pytest.approx(step_m / 10.0)
    assert places[:, 2] == pytest.approx(HEIGHT_M)


@pytest.mark.parametrize("wobble_rad", [0.0, 0.02])
@pytest.mark.parametrize("range_m", RANGES_M)
@pytest.mark.parametrize("geometry", GEOMETRIES)
def test_the_target_is_in_view_all_the_way(geometry: Geometry, range_m: float, wobble_rad: float) -> None:
    flight = past(geometry, range_m, range_m / 50.0, wobble_rad)
    seen = [target_px(flight, float(stamp_s)) for stamp_s in flight.stamps_s]
    assert all(is_visible for _, is_visible in seen)
    assert np.array([v for (_, v), _ in seen[:1]]) == pytest.approx(539.5, abs=70.0)  # the camera is pitched at it


def test_perpendicular_has_the_target_abeam_half_way() -> None:
    flight = past("perpendicular")
    away = from_target(flight)
    assert away[:, 1] == pytest.approx(-1000.0)
    assert away[:, 0] == pytest.approx(np.linspace(-250.0, 250.0, 51))
    assert target_px(flight, 25.0)[0][0] == pytest.approx(959.5, abs=1e-6)


def test_oblique_is_45_degrees_off_the_line_of_sight() -> None:
    flight = past("oblique")
    away = from_target(flight)[:, :2]
    course = np.diff(away, axis=0)
    assert course == pytest.approx(np.full((50, 2), 10.0 * np.sqrt(0.5)))
    cosine = -(course[0] @ away[0]) / (np.linalg.norm(course[0]) * np.linalg.norm(away[0]))
    assert np.degrees(np.arccos(cosine)) == pytest.approx(45.0)
    assert target_px(flight, 25.0)[0][0] == pytest.approx(959.5, abs=1e-6)


def test_head_on_gets_nearer_with_the_bearing_constant() -> None:
    flight = past("head-on")
    away = from_target(flight)
    assert np.diff(np.linalg.norm(away[:, :2], axis=1)) == pytest.approx(-10.0)
    assert away[:, 0] == pytest.approx(0.0, abs=1e-9)
    assert [target_px(flight, float(t))[0][0] for t in flight.stamps_s] == pytest.approx([959.5] * 51)
    assert target_px(flight, 0.0)[0][1] == pytest.approx(539.5, abs=1e-6)


def test_orbit_keeps_the_distance_and_looks_inwards() -> None:
    flight = past("orbit")
    away = from_target(flight)
    assert np.hypot(away[:, 0], away[:, 1]) == pytest.approx(1000.0)
    turned = np.unwrap(np.arctan2(away[:, 0], away[:, 1]))
    assert abs(turned[-1] - turned[0]) == pytest.approx(0.5)
    assert [target_px(flight, float(t))[0][0] for t in flight.stamps_s] == pytest.approx([959.5] * 51)


def test_hover_stays_for_as_long_as_the_others_fly() -> None:
    flight = past("hover")
    assert np.ptp(positions(flight), axis=0) == pytest.approx(0.0)
    assert np.array_equal(flight.stamps_s, past("orbit").stamps_s)
    assert target_px(flight, 20.0)[0] == pytest.approx([959.5, 539.5], abs=1e-6)


def test_lawnmower_flies_four_legs_each_nearer() -> None:
    flight = past("lawnmower", step_m=1.0)
    away = from_target(flight)
    steps = np.diff(away, axis=0)
    across = np.abs(steps[:, 0]) > 0.5
    signs = np.sign(steps[across, 0])
    assert np.count_nonzero(np.diff(signs)) == 3
    assert signs[:: signs.size // 4].tolist() == [1.0, -1.0, 1.0, -1.0]
    assert np.unique(np.round(away[1:][across, 1])).tolist() == [-1000.0, -975.0, -950.0, -925.0]
    assert (away[:, 0].min(), away[:, 0].max()) == pytest.approx((-53.125, 53.125), abs=1.0)


@pytest.mark.parametrize("share", [0.1, 0.5, 1.0, 2.0])
def test_a_lawnmowers_legs_make_up_its_length(share: float) -> None:
    flight = flight_past("lawnmower", TARGET, 1000.0, share * 1000.0, 1.0, HEIGHT_M)
    last = from_target(flight)[-1]
    assert last[:2] == pytest.approx([-0.10625 * share * 1000.0, (0.15 * share - 1.0) * 1000.0], abs=1.0)


@pytest.mark.parametrize("geometry", GEOMETRIES)
def test_another_speed_flies_the_same_way_in_another_time(geometry: Geometry) -> None:
    usual = flight_past(geometry, TARGET, 1000.0, 500.0, height_m=HEIGHT_M)
    fast = flight_past(geometry, TARGET, 1000.0, 500.0, height_m=HEIGHT_M, speed_mps=25.0)
    np.testing.assert_allclose(fast.stamps_s * 25.0, usual.stamps_s * SPEED_MPS)
    np.testing.assert_allclose(from_target(fast), from_target(usual), atol=1e-6)


def test_wobble_turns_the_camera_by_seed_and_leaves_its_place() -> None:
    flights = [flight_past("oblique", TARGET, 1000.0, 500.0, wobble_rad=0.02, seed=seed) for seed in (1, 1, 2)]
    first, same, other = (flight.pose_at(7.0) for flight in flights)
    calm = flight_past("oblique", TARGET, 1000.0, 500.0).pose_at(7.0)
    assert np.array_equal(first.R_cam_from_enu, same.R_cam_from_enu)
    assert not np.allclose(first.R_cam_from_enu, other.R_cam_from_enu, atol=1e-4)
    cosine = (np.trace(first.R_cam_from_enu @ calm.R_cam_from_enu.T) - 1.0) / 2.0
    assert 1e-4 < np.arccos(cosine) < 0.02 * np.sqrt(3.0)
    assert first.position_enu_m == pytest.approx(calm.position_enu_m)


def test_an_unknown_geometry_and_bad_sizes_raise() -> None:
    with pytest.raises(ValueError, match="speed_mps must be > 0"):
        flight_past("orbit", TARGET, 1000.0, 500.0, speed_mps=0.0)
    with pytest.raises(ValueError, match="spiral"):
        flight_past("spiral", TARGET, 1000.0, 500.0)  # type: ignore[arg-type]
    for sizes in ((0.0, 500.0, 10.0), (1000.0, -1.0, 10.0), (1000.0, 500.0, 0.0), (np.nan, 500.0, 10.0)):
        for geometry in GEOMETRIES:
            with pytest.raises(ValueError, match="must be > 0"):
                flight_past(geometry, TARGET, *sizes)
