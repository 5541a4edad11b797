"""Interpolation of poses, its limits and its fixed memory."""

import numpy as np
import pytest

from distloc.geometry.rotations import quaternion_from_euler
from distloc.types import RejectReason
from service.autopilot.poses import PoseHistory

MS = 1_000_000
VELOCITY = np.array([10.0, -4.0, 1.0])


def filled(count: int = 50, step_ms: int = 20, **limits: int) -> PoseHistory:
    """Yaw at 1 rad/s, every other quaternion with its sign turned; constant velocity."""
    poses = PoseHistory(**limits)
    for index in range(count):
        t_ns = (1000 + index * step_ms) * MS
        sign = 1 if index % 2 else -1
        assert poses.add_attitude(t_ns, sign * quaternion_from_euler(t_ns * 1e-9, 0.0, 0.0))
        assert poses.add_position(t_ns, VELOCITY * (t_ns * 1e-9), VELOCITY)
    return poses


@pytest.mark.parametrize("t_ms", [1000.0, 1007.3, 1500.0, 1979.9, 2030.0])
def test_pose_between_and_just_after_the_samples(t_ms: float) -> None:
    found = filled().lookup(int(t_ms * MS), 10_000 * MS)
    assert isinstance(found, tuple)
    q, position_enu_m = found
    assert abs(q @ quaternion_from_euler(t_ms * 1e-3, 0.0, 0.0)) == pytest.approx(1.0, abs=1e-9)
    np.testing.assert_allclose(position_enu_m, VELOCITY * t_ms * 1e-3, atol=1e-6)


def test_hermite_is_exact_for_a_cubic() -> None:
    poses = PoseHistory()
    for t_s in (1.0, 1.8):
        poses.add_position(int(t_s * 1e9), np.array([t_s**3, 0, 0]), np.array([3 * t_s**2, 0, 0]))
        poses.add_attitude(int(t_s * 1e9), np.array([1.0, 0, 0, 0]))
    position = poses.positions.at(1_300 * MS, 9_000 * MS)
    assert isinstance(position, np.ndarray) and position[0] == pytest.approx(1.3**3, abs=1e-9)


def test_waits_for_a_later_sample_then_extrapolates_then_gives_up() -> None:
    poses = filled()
    assert poses.lookup(2050 * MS, 2100 * MS) is None
    assert isinstance(poses.lookup(2050 * MS, 2250 * MS), tuple)
    assert poses.lookup(2081 * MS, 2300 * MS) is RejectReason.STALE_POSE
    assert poses.lookup(9000 * MS, 2000 * MS) is RejectReason.STALE_POSE


def test_gaps_and_empty_history() -> None:
    slow = filled(count=5, step_ms=201)
    assert slow.lookup(1100 * MS, 9000 * MS) is RejectReason.POSE_GAP
    assert isinstance(filled(5, 201, attitude_gap_ns=300 * MS).lookup(1100 * MS, 9000 * MS), tuple)
    assert PoseHistory().lookup(0, 9000 * MS) is RejectReason.NO_POSE
    assert filled().lookup(999 * MS, 9000 * MS) is RejectReason.NO_POSE


def test_memory_is_fixed_and_old_frames_are_named() -> None:
    poses = filled(count=5000, attitude_capacity=64, position_capacity=64)
    assert poses.attitude_count == poses.position_count == 64
    assert poses.attitudes._values.shape == (128, 4)
    assert poses.lookup(1001 * MS, 200_000 * MS) is RejectReason.FRAME_TOO_OLD
    assert isinstance(poses.lookup(100_000 * MS, 200_000 * MS), tuple)


def test_duplicates_are_refused_and_clear_empties() -> None:
    poses = filled()
    assert not poses.add_attitude(1500 * MS, np.array([1.0, 0, 0, 0]))
    assert not poses.add_position(1980 * MS, VELOCITY, VELOCITY)
    poses.clear()
    assert poses.latest == (None, None)
