"""The mount's angles from what the scenery says of the attitude."""

from dataclasses import replace

import numpy as np
import pytest

from distloc.calibration.mount_calibration import MOUNT_SIGMA_RAD, euler_from_matrix
from distloc.calibration.scenery_mount import LEAST_KEYFRAMES, AttitudeSight, MountEstimator, mount_from_scenery
from distloc.geometry.rotations import R_FRD_FROM_CAM, R_cam_from_enu, matrix_from_euler, matrix_from_rotation_vector
from distloc.scenery.compass import Compass
from distloc.simulation.errors import GaussMarkov
from distloc.simulation.flights import Geometry
from distloc.types import CameraPose, FloatArray, PoseErrors
from tests.distloc.scenery.flown import CAMERA, flown
from tests.distloc.scenery.flown import TOLD as FLOWN_TOLD

TOLD = PoseErrors(
    heading_bias_rad=float(np.radians(2.0)),
    tilt_bias_rad=float(np.radians(0.5)),
    attitude_white_rad=float(np.radians(0.1)),
    position_m=1.0,
    bias_time_constant_s=120.0,
)
OLD_DEG, TRUE_DEG = np.array([-75.0, -6.0, 0.0]), np.array([-72.5, -5.0, 1.0])


def flight(seed: int, turns: float, count: int = 120, own_time_constant_s: float = 1e-3) -> list[AttitudeSight]:
    rng = np.random.default_rng(seed)
    half = 0.5**0.5
    sizes = np.array([TOLD.tilt_bias_rad, TOLD.tilt_bias_rad, TOLD.heading_bias_rad])
    slow, of_body = GaussMarkov(half * sizes, 120.0, rng), half * sizes * rng.standard_normal(3)
    sigma = np.radians([0.2, 0.2, 0.15])
    own = GaussMarkov(sigma, own_time_constant_s, rng)
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
        own.advance(stamp_s)
        error = mount_rad + slow.value + frd @ of_body + own.value
        pose = CameraPose(stamp_s, np.zeros(3), reported)
        P = np.diag(1.0 / (sigma**-2 + sizes**-2))  # what the window tells holds what was told before
        sights.append(AttitudeSight(pose, TOLD, P @ (error / sigma**2), P))
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


def by_least_squares(sights: list[AttitudeSight], R_base_from_mount: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The slow twin: all keyframes at once, their errors' covariance in full; the vector (3,) and its own (3, 3)."""
    R = [one.pose.R_cam_from_enu.T @ R_FRD_FROM_CAM.T @ R_base_from_mount.T for one in sights]
    n, by_mount = len(sights), np.concatenate(R)
    own = [np.linalg.inv(np.linalg.inv(one.covariance_rad2) - np.linalg.inv(TOLD.bias_variance)) for one in sights]
    errors = [R @ np.linalg.solve(one.covariance_rad2, one.error_rad) for R, one in zip(own, sights, strict=True)]
    V = TOLD.attitude_white_rad**2 * np.eye(3 * n)
    for i in range(n):
        for j in range(n):
            alike = np.exp(-abs(sights[i].pose.stamp_s - sights[j].pose.stamp_s) / TOLD.bias_time_constant_s)
            both = np.sqrt(np.abs(own[i])) @ np.sqrt(np.abs(own[j]))
            V[3 * i : 3 * i + 3, 3 * j : 3 * j + 3] += alike * (0.5 * TOLD.bias_variance + both)
    solved = np.linalg.solve(V, np.column_stack([by_mount, np.concatenate(errors)]))
    covariance = np.linalg.inv(np.eye(3) / MOUNT_SIGMA_RAD**2 + by_mount.T @ solved[:, :3])
    return covariance @ by_mount.T @ solved[:, 3], covariance


def test_keyframe_by_keyframe_is_all_at_once() -> None:
    R_old = matrix_from_euler(*np.radians(OLD_DEG))
    sights = flight(3, 0.7, 60, 120.0)
    estimator = MountEstimator(R_old)
    for sight in sights:
        estimator.add(sight)
    vector_rad, covariance = by_least_squares(sights, R_old)
    np.testing.assert_allclose(estimator._state[:3], vector_rad, atol=1e-7)
    np.testing.assert_allclose(estimator._covariance[:3, :3], covariance, rtol=1e-4, atol=1e-10)


def test_the_turn_is_that_of_the_heading() -> None:
    R_old = matrix_from_euler(*np.radians(OLD_DEG))
    turned = [mount_from_scenery(flight(1, turns), R_old).turned_rad for turns in (0.0, 1.0, -2.5)]
    np.testing.assert_allclose(np.degrees(turned), [0.0, 360.0 * 119 / 120, 900.0 * 119 / 120], atol=2.0)


def test_a_step_of_the_heading_is_no_mount() -> None:
    R_old = matrix_from_euler(*np.radians(OLD_DEG))
    by_rad = np.radians([0.0, 0.0, 15.0])
    sights = flight(4, 0.0, own_time_constant_s=120.0)
    stepped = [
        replace(
            one,
            pose=replace(one.pose, R_cam_from_enu=one.pose.R_cam_from_enu @ matrix_from_rotation_vector(-by_rad)),
            error_rad=one.error_rad + by_rad,
        )
        for one in sights[:60]
    ]
    found = mount_from_scenery([*stepped, *sights[60:]], R_old)
    assert LEAST_KEYFRAMES < found.used < 80  # what was before is forgotten
    off = (np.degrees(found.angles_rad) - TRUE_DEG) / np.degrees(found.sigmas_rad)
    assert np.abs(off).max() < 3.0


def test_a_keyframe_that_is_far_off_is_left_out() -> None:
    R_old = matrix_from_euler(*np.radians(OLD_DEG))
    sights = flight(4, 0.3, own_time_constant_s=120.0)
    wild = [replace(one, error_rad=one.error_rad + (0.2 if i % 40 == 39 else 0.0)) for i, one in enumerate(sights)]
    found, without = mount_from_scenery(wild, R_old), mount_from_scenery(sights, R_old)
    assert (found.used, without.used) == (117, 120)
    assert np.abs(found.angles_rad - without.angles_rad).max() < np.radians(0.1)


def test_errors_that_are_larger_than_told_make_it_less_sure() -> None:
    R_old = matrix_from_euler(*np.radians(OLD_DEG))
    rng = np.random.default_rng(5)
    sights = flight(5, 0.0)
    shaken = [replace(one, error_rad=one.error_rad + np.radians(0.5) * rng.standard_normal(3)) for one in sights]
    calm, wild = mount_from_scenery(sights, R_old), mount_from_scenery(shaken, R_old)
    assert (wild.sigmas_rad > calm.sigmas_rad).all()


def test_nothing_grows() -> None:
    estimator = MountEstimator(matrix_from_euler(*np.radians(OLD_DEG)))
    sights = flight(6, 1.0)
    estimator.add(sights[0])
    held = {name: np.shape(value) for name, value in vars(estimator).items()}
    for sight in sights[1:]:
        estimator.add(sight)
    assert {name: np.shape(value) for name, value in vars(estimator).items()} == held


@pytest.mark.thorough
@pytest.mark.parametrize("geometry", ["perpendicular", "orbit"])
def test_what_the_compass_measures_tells_the_mount_within_what_is_told(geometry: Geometry) -> None:
    """A mount that is off by a degree about each axis, which is twice what was told of tilt."""
    off = []
    for seed in range(10):
        estimator, compass = MountEstimator(np.eye(3)), Compass(CAMERA, 5.0, 1.0)
        mount_rad = np.radians(np.random.default_rng(seed).normal(0.0, 1.0, 3))
        for frame in flown(seed, geometry, steps=60, range_m=3000.0):
            by_enu_rad = frame.pose.R_cam_from_enu.T @ R_FRD_FROM_CAM.T @ mount_rad
            turned = frame.pose.R_cam_from_enu @ matrix_from_rotation_vector(-by_enu_rad)
            pose = replace(frame.pose, R_cam_from_enu=turned)
            compass.step(pose, FLOWN_TOLD, frame.corners)
            said = compass.state
            if said is not None and said.stamp_s == pose.stamp_s:
                estimator.add(AttitudeSight(pose, FLOWN_TOLD, said.error_rad, said.covariance_rad2))
        found = estimator.mount()
        true_rad = euler_from_matrix(matrix_from_rotation_vector(-mount_rad))
        off.append((found.angles_rad - true_rad) / found.sigmas_rad)
    rms = np.sqrt(np.square(off).mean(axis=0))
    assert (rms > 0.1).all() and (rms < 1.3).all(), rms
