import numpy as np
import pytest

from distloc.simulation.errors import AutopilotErrors
from distloc.simulation.paths import FlightPath, VehicleTruth, arc, legs, straight
from distloc.types import FloatArray

START = np.array([0.0, 0.0, 120.0])
CORNERS = np.array([[0.0, 300.0, 300.0, 300.0], [0.0, 0.0, 200.0, 350.0], [0.0, 0.0, 0.0, 200.0]])  # 300, 200, 250 m


def test_straight_east_moves_east_only() -> None:
    state = straight(START, np.pi / 2, 12.0, wobble_rad=0.0).state(10.0)
    assert state.position_enu_m == pytest.approx([120.0, 0.0, 120.0], abs=1e-9)
    assert state.velocity_enu_mps == pytest.approx([12.0, 0.0, 0.0], abs=1e-9)
    assert (state.yaw_rad, state.pitch_rad, state.roll_rad) == pytest.approx((np.pi / 2, 0.0, 0.0))


def test_arc_keeps_its_radius_and_faces_the_centre() -> None:
    path = arc(np.array([5.0, 6.0, 120.0]), 500.0, 0.3, 15.0, wobble_rad=0.0)
    for t_s in (0.0, 7.0, 100.0):
        state = path.state(t_s)
        to_centre = np.array([5.0, 6.0, 120.0]) - state.position_enu_m
        assert np.linalg.norm(to_centre) == pytest.approx(500.0)
        assert np.array([np.sin(state.yaw_rad), np.cos(state.yaw_rad)]) * 500.0 == pytest.approx(to_centre[:2])


@pytest.mark.parametrize(
    "path",
    [
        straight(START, 1.0, 12.0, heading_rad=0.0, seed=3),
        straight(START, 0.0, 0.0, heading_rad=0.0, seed=3),
        arc(np.array([0.0, 2000.0, 120.0]), 2000.0, np.pi, 12.0, seed=3),
        arc(np.array([0.0, 2000.0, 120.0]), 2000.0, np.pi, -12.0, seed=3),
        legs(START[:, None] + CORNERS, 12.0, 0.0, seed=3),
    ],
    ids=["straight", "hover", "clockwise", "anticlockwise", "legs"],
)
def test_velocity_is_the_derivative_of_position(path: FlightPath) -> None:
    before, now, after = (path.state(t_s) for t_s in (9.999, 10.0, 10.001))
    slope = (after.position_enu_m - before.position_enu_m) / 0.002
    assert slope == pytest.approx(now.velocity_enu_mps, abs=1e-4)
    assert path.state(0.0).position_enu_m == pytest.approx(START, abs=1e-6)
    assert abs(path.state(0.0).yaw_rad) < 0.011  # north


def test_legs_pass_their_corners_in_time_and_go_on() -> None:
    path = legs(CORNERS, 10.0, 0.5, wobble_rad=0.0)
    expected = {-1.0: [-10, 0, 0], 0.0: [0, 0, 0], 30.0: [300, 0, 0], 50.0: [300, 200, 0], 75.0: [300, 350, 200]}
    for t_s, place in expected.items():
        assert path.state(t_s).position_enu_m == pytest.approx(place, abs=1e-9)
    assert path.state(80.0).position_enu_m == pytest.approx([300.0, 380.0, 240.0])
    velocities = {15.0: [10.0, 0.0, 0.0], 30.0: [0.0, 10.0, 0.0], 49.99: [0.0, 10.0, 0.0], 60.0: [0.0, 6.0, 8.0]}
    for t_s, velocity in velocities.items():
        assert path.state(t_s).velocity_enu_mps == pytest.approx(velocity, abs=1e-9)
        assert path.state(t_s).yaw_rad == pytest.approx(0.5)


@pytest.mark.parametrize("t_s", [1.0, 29.0, 31.0, 48.0, 51.0, 74.0, 90.0])
def test_legs_velocity_is_the_derivative_of_position(t_s: float) -> None:
    path = legs(CORNERS, 10.0, 0.0)
    slope = (path.state(t_s + 1e-3).position_enu_m - path.state(t_s - 1e-3).position_enu_m) / 2e-3
    assert slope == pytest.approx(path.state(t_s).velocity_enu_mps, abs=1e-6)
    assert np.linalg.norm(slope) == pytest.approx(10.0)


def test_legs_keep_their_own_corners() -> None:
    corners = CORNERS.copy()
    path = legs(corners, 10.0, 0.0)
    corners[:] = 0.0
    assert path.state(30.0).position_enu_m == pytest.approx([300.0, 0.0, 0.0])


@pytest.mark.parametrize(
    ("corners", "speed_mps", "named"),
    [
        (CORNERS[:, :1], 10.0, "K >= 2"),
        (CORNERS[:2], 10.0, "K >= 2"),
        (CORNERS[:, 0], 10.0, "K >= 2"),
        (np.where(CORNERS > 250.0, np.nan, CORNERS), 10.0, "finite"),
        (CORNERS[:, [0, 1, 1]], 10.0, "every leg"),
        (CORNERS, 0.0, "speed_mps"),
        (CORNERS, np.nan, "speed_mps"),
    ],
)
def test_bad_legs_raise(corners: FloatArray, speed_mps: float, named: str) -> None:
    with pytest.raises(ValueError, match=named):
        legs(corners, speed_mps, 0.0)


def test_wobble_is_small_there_and_repeats_by_seed() -> None:
    first, same, other = (straight(START, 0.0, 0.0, wobble_rad=0.02, seed=seed) for seed in (1, 1, 2))
    rolls = np.array([first.state(t_s).roll_rad for t_s in np.arange(0.0, 100.0, 0.5)])
    assert 0.003 < rolls.std() < 0.02 >= np.abs(rolls).max()
    assert first.state(3.3).pitch_rad == same.state(3.3).pitch_rad != other.state(3.3).pitch_rad


def test_a_bad_place_and_a_bad_radius_are_named() -> None:
    with pytest.raises(ValueError, match="3 finite"):
        straight(np.array([0.0, np.nan, 0.0]), 0.0, 1.0)
    with pytest.raises(ValueError, match="radius_m"):
        arc(START, 0.0, 0.0, 1.0)


def _truth() -> VehicleTruth:
    return straight(START, 0.0, 0.0, wobble_rad=0.0).state(0.0)


def test_error_sizes_and_correlation_are_those_asked_for() -> None:
    yaws = []
    for seed in range(400):
        errors = AutopilotErrors(np.random.default_rng(seed), heading_bias_rad=0.03, heading_white_rad=0.0, tau_s=60.0)
        yaws.append([errors.perturb(_truth(), 0.0).yaw_rad, errors.perturb(_truth(), 60.0).yaw_rad])
    first, later = np.array(yaws).T
    assert 0.027 < first.std() < 0.033 and 0.027 < later.std() < 0.033
    assert 0.27 < np.corrcoef(first, later)[0, 1] < 0.47  # exp(-1) = 0.37


def test_no_error_gives_the_truth_and_leaves_it_alone() -> None:
    truth = _truth()
    same = AutopilotErrors(np.random.default_rng(0), 0.0, 0.0, 0.0, 0.0, 0.0, 0.0).perturb(truth, 1.0)
    assert same.position_enu_m == pytest.approx(truth.position_enu_m) and same.yaw_rad == truth.yaw_rad
    assert same.position_enu_m is not truth.position_enu_m
    with pytest.raises(ValueError, match="tau_s"):
        AutopilotErrors(np.random.default_rng(0), tau_s=0.0)
