"""How late the frames are: what was put in comes out, as sure as it says, and nothing where there is no turning."""

import numpy as np
import pytest

from distloc.calibration.pose_trail import PoseTrail
from distloc.calibration.time_offset import TimeOffset, aim_residuals, estimate_time_offset, turn_residuals, vee
from distloc.geometry.rotations import R_cam_from_enu, matrix_from_euler, matrix_from_rotation_vector
from distloc.simulation.paths import Wobble
from distloc.types import CameraPose, FloatArray

MOUNT = matrix_from_euler(np.radians(-75.0), np.radians(-5.0), 0.0)
LANDMARK_ENU_M = np.array([300.0, 2000.0, 60.0])
STAMPS_S = np.arange(2.0, 58.0, 0.25)
NOISE_RAD = np.radians(0.05)


def true_pose(wobble: Wobble, stamp_s: float) -> CameraPose:
    yaw, pitch, roll = np.array([np.pi / 2, 0.0, 0.0]) + wobble.at(stamp_s)
    position = np.array([10.0 * (stamp_s - 30.0), 0.0, 120.0])
    return CameraPose(stamp_s, position, R_cam_from_enu(matrix_from_euler(yaw, pitch, roll), MOUNT))


def trail_of(wobble: Wobble, white_rad: float = 0.0, seed: int = 0) -> PoseTrail:
    """A pose every 20 ms, with an error of the heading that lasts (what the mount does not hold) and a white one."""
    rng = np.random.default_rng(seed)
    poses = []
    for stamp_s in np.arange(0.0, 60.0, 0.02):
        pose = true_pose(wobble, float(stamp_s))
        wrong = matrix_from_rotation_vector(np.array([0.0, 0.0, 0.01]) + white_rad * rng.standard_normal(3))
        poses.append(CameraPose(pose.stamp_s, pose.position_enu_m, pose.R_cam_from_enu @ wrong.T))
    return PoseTrail(poses)


def rays(wobble: Wobble, late_s: float, rng: np.random.Generator) -> FloatArray:
    """Of the landmark, in frames stamped `late_s` late."""
    out = []
    for stamp_s in STAMPS_S:
        pose = true_pose(wobble, float(stamp_s) - late_s)
        line = pose.R_cam_from_enu @ (LANDMARK_ENU_M - pose.position_enu_m)
        out.append(line / np.linalg.norm(line) + NOISE_RAD * rng.standard_normal(3))
    return np.stack(out)


def turns(wobble: Wobble, late_s: float, rng: np.random.Generator) -> FloatArray:
    R = np.stack([true_pose(wobble, float(stamp_s) - late_s).R_cam_from_enu for stamp_s in STAMPS_S])
    return vee(R[1:] @ np.swapaxes(R[:-1], 1, 2)) + NOISE_RAD * rng.standard_normal((len(STAMPS_S) - 1, 3))


def by_aim(wobble: Wobble, late_s: float, seed: int, white_rad: float = 0.0) -> TimeOffset:
    seen = rays(wobble, late_s, np.random.default_rng(seed))
    return estimate_time_offset(aim_residuals(trail_of(wobble, white_rad), STAMPS_S, seen, LANDMARK_ENU_M), STAMPS_S)


def by_turns(wobble: Wobble, late_s: float, seed: int, white_rad: float = 0.0) -> TimeOffset:
    shown = turns(wobble, late_s, np.random.default_rng(seed))
    residuals = turn_residuals(trail_of(wobble, white_rad), STAMPS_S[:-1], STAMPS_S[1:], shown)
    return estimate_time_offset(residuals, STAMPS_S[1:])


@pytest.mark.parametrize("estimate", [by_aim, by_turns])
@pytest.mark.parametrize("late_s", [-0.15, 0.0, 0.08, 0.4])
def test_what_was_put_in_comes_out(estimate: type[TimeOffset], late_s: float) -> None:
    found = estimate(Wobble(0.06, 1), late_s, 5)  # type: ignore[arg-type, call-arg]
    assert found.offset_s is not None
    assert found.offset_s == pytest.approx(late_s, abs=4.0 * found.sigma_s)
    assert 0.001 < found.sigma_s < 0.006
    assert found.used > 0.9 * len(STAMPS_S)


@pytest.mark.thorough
@pytest.mark.parametrize("estimate", [by_aim, by_turns])
def test_errors_are_as_large_as_the_sigmas_say(estimate: type[TimeOffset]) -> None:
    squared = []
    for seed in range(20):
        found = estimate(Wobble(0.03, seed), 0.05, 100 + seed)  # type: ignore[arg-type, call-arg]
        assert found.offset_s is not None
        squared.append(((found.offset_s - 0.05) / found.sigma_s) ** 2)
    assert 0.3 < np.mean(squared) < 2.2  # of 20: 1 +- 0.32, and some for the neighbours


@pytest.mark.parametrize("estimate", [by_aim, by_turns])
@pytest.mark.parametrize("white_rad", [0.0, np.radians(0.1)])
def test_no_turning_no_number(estimate: type[TimeOffset], white_rad: float) -> None:
    for seed in range(5):
        found = estimate(Wobble(0.0005, seed), 0.05, seed, white_rad)  # type: ignore[arg-type, call-arg]
        assert found.offset_s is None


def test_outliers_do_not_move_it() -> None:
    wobble = Wobble(0.06, 1)
    seen = rays(wobble, 0.08, np.random.default_rng(5))
    seen[::15] += np.array([0.05, -0.03, 0.0])
    found = estimate_time_offset(aim_residuals(trail_of(wobble), STAMPS_S, seen, LANDMARK_ENU_M), STAMPS_S)
    assert found.offset_s == pytest.approx(0.08, abs=0.01)
    assert found.used < len(STAMPS_S) - len(seen[::15]) // 2


def test_beyond_the_range_or_with_few_frames_no_number() -> None:
    assert by_aim(Wobble(0.06, 1), 0.8, 5).offset_s is None
    wobble = Wobble(0.06, 1)
    few = STAMPS_S[:20]
    seen = rays(wobble, 0.0, np.random.default_rng(5))[:20]
    found = estimate_time_offset(aim_residuals(trail_of(wobble), few, seen, LANDMARK_ENU_M), few)
    assert (found.offset_s, found.used) == (None, 20)
    assert found.sigma_s == np.inf


def test_trail_knows_where_it_has_no_pose() -> None:
    wobble = Wobble(0.06, 1)
    poses = [true_pose(wobble, float(stamp_s)) for stamp_s in np.arange(0.0, 2.0, 0.02)]
    trail = PoseTrail([*poses[:30], *poses[60:]])  # none from 0.58 to 1.2 s
    stamps_s = np.array([-0.01, 0.313, 0.8, 1.507, 1.99])
    R, positions_m, is_known = trail.at(stamps_s)
    assert is_known.tolist() == [False, True, False, True, False]
    for i in (1, 3):
        expected = true_pose(wobble, float(stamps_s[i]))
        assert R[i] == pytest.approx(expected.R_cam_from_enu, abs=2e-5)
        assert positions_m[i] == pytest.approx(expected.position_enu_m)
    with pytest.raises(ValueError, match="at least 2 poses"):
        PoseTrail(poses[:1])
