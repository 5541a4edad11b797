import numpy as np
import pytest

from distloc.simulation.errors import AutopilotErrors
from distloc.simulation.paths import VehicleTruth, arc, named_path, straight

START = np.array([0.0, 0.0, 120.0])
TARGET = np.array([0.0, 2000.0, 0.0])


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


@pytest.mark.parametrize("name", ["straight", "arc", "hover"])
def test_velocity_is_the_derivative_of_position(name: str) -> None:
    path = named_path(name, START, TARGET, seed=3)
    before, now, after = (path.state(t_s) for t_s in (9.999, 10.0, 10.001))
    slope = (after.position_enu_m - before.position_enu_m) / 0.002
    assert slope == pytest.approx(now.velocity_enu_mps, abs=1e-4)
    assert path.state(0.0).position_enu_m == pytest.approx(START, abs=1e-6)
    assert abs(path.state(0.0).yaw_rad) < 0.011  # north, where the target is


def test_wobble_is_small_there_and_repeats_by_seed() -> None:
    first, same, other = (named_path("hover", START, TARGET, wobble_rad=0.02, seed=seed) for seed in (1, 1, 2))
    rolls = np.array([first.state(t_s).roll_rad for t_s in np.arange(0.0, 100.0, 0.5)])
    assert 0.003 < rolls.std() < 0.02 >= np.abs(rolls).max()
    assert first.state(3.3).pitch_rad == same.state(3.3).pitch_rad != other.state(3.3).pitch_rad


def test_an_unknown_path_and_a_bad_place_are_named() -> None:
    with pytest.raises(ValueError, match="spiral"):
        named_path("spiral", START, TARGET)
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
