"""The mount's angles from what the scenery says of the attitude."""

import numpy as np
import pytest

from distloc.calibration.scenery_mount import LEAST_KEYFRAMES, AttitudeSight, mount_from_scenery
from distloc.geometry.rotations import R_cam_from_enu, matrix_from_euler
from distloc.simulation.errors import GaussMarkov
from distloc.types import CameraPose, PoseErrors

TOLD = PoseErrors(
    heading_bias_rad=float(np.radians(2.0)),
    tilt_bias_rad=float(np.radians(0.5)),
    attitude_white_rad=float(np.radians(0.1)),
    position_m=1.0,
    bias_time_constant_s=120.0,
)
OLD_DEG, TRUE_DEG = np.array([-75.0, -6.0, 0.0]), np.array([-72.5, -5.0, 1.0])


def flight(seed: int, turns: float, count: int = 120) -> list[AttitudeSight]:
    rng = np.random.default_rng(seed)
    half = 0.5**0.5
    sizes = np.array([TOLD.tilt_bias_rad, TOLD.tilt_bias_rad, TOLD.heading_bias_rad])
    slow, of_body = GaussMarkov(half * sizes, 120.0, rng), half * sizes * rng.standard_normal(3)
    sights = []
    for number in range(count):
        stamp_s = 2.0 * number
        slow.advance(stamp_s)
        R_ned_from_body = matrix_from_euler(2.0 * np.pi * turns * number / count, 0.02, 0.1 * np.sin(number))
        reported = R_cam_from_enu(R_ned_from_body, matrix_from_euler(*np.radians(OLD_DEG)))
        true = R_cam_from_enu(R_ned_from_body, matrix_from_euler(*np.radians(TRUE_DEG)))
        wrong = reported.T @ true
        mount_rad = np.array([wrong[2, 1] - wrong[1, 2], wrong[0, 2] - wrong[2, 0], wrong[1, 0] - wrong[0, 1]]) / 2.0
        frd = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]]) @ R_ned_from_body
        sigma = np.radians([0.2, 0.2, 0.15])
        error = mount_rad + slow.value + frd @ of_body + sigma * rng.standard_normal(3)
        pose = CameraPose(stamp_s, np.zeros(3), reported)
        sights.append(AttitudeSight(pose, TOLD, error, np.diag(sigma**2)))
    return sights


@pytest.mark.parametrize("turns", [0.0, 1.0])
def test_the_mount_is_found_within_what_is_told(turns: float) -> None:
    R_old = matrix_from_euler(*np.radians(OLD_DEG))
    off = []
    for seed in range(40):
        found = mount_from_scenery(flight(seed, turns), R_old)
        off.append((np.degrees(found.angles_rad) - TRUE_DEG) / np.degrees(found.sigmas_rad))
    rms = np.sqrt(np.square(off).mean(axis=0))
    assert (rms > 0.5).all() and (rms < 1.5).all(), rms


def test_a_turn_tells_pitch_and_roll_better() -> None:
    R_old = matrix_from_euler(*np.radians(OLD_DEG))
    straight, round_ = (mount_from_scenery(flight(1, turns), R_old).sigmas_rad for turns in (0.0, 1.0))
    assert (round_[1:] < straight[1:]).all()


def test_too_few_keyframes_are_refused() -> None:
    with pytest.raises(ValueError, match=f"in {LEAST_KEYFRAMES - 1} keyframes, {LEAST_KEYFRAMES} are needed"):
        mount_from_scenery(flight(1, 1.0, LEAST_KEYFRAMES - 1), np.eye(3))
