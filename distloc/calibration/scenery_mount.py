"""The mount's angles from what the scenery says of the reported attitude over a flight; `calibrate` calls it.

What the attitude is wrong by is the mount's part, which turns with the body, and the autopilot's. Half of the latter's
variance turns with the body as well, as a compass that is set wrong and levels that are off do: that looks like the
mount's, and the sigmas hold it. The other half is a Gauss-Markov process about east, north and up. All are linear in
small angles, so the mount's part is a weighted mean (generalised least squares).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from distloc.calibration.mount_calibration import MOUNT_SIGMA_RAD, euler_from_matrix
from distloc.geometry.rotations import R_FRD_FROM_CAM, matrix_from_rotation_vector
from distloc.types import CameraPose, FloatArray, PoseErrors

LEAST_KEYFRAMES = 20
_MOST_KEYFRAMES = 200  # spread over the flight: more tell little and cost much
_STEP_RAD = 1e-6
_TURNS_WITH_BODY = 0.5  # of the autopilot's variance


@dataclass(frozen=True, slots=True)
class AttitudeSight:
    """What the scenery says at a keyframe: the reported pose, its error about east, north and up (3,), (3, 3)."""

    pose: CameraPose
    errors: PoseErrors
    error_rad: FloatArray
    covariance_rad2: FloatArray


@dataclass(frozen=True, slots=True)
class SceneryMount:
    """The mount as found: yaw, pitch and roll (3,) with one standard deviation of each, and by how many keyframes."""

    angles_rad: FloatArray
    sigmas_rad: FloatArray
    used: int


def mount_from_scenery(sights: Sequence[AttitudeSight], R_base_from_mount: FloatArray) -> SceneryMount:
    """The mount's angles; `R_base_from_mount` (3, 3) is what the poses were made with.

    ValueError where there are fewer than LEAST_KEYFRAMES.
    """
    if len(sights) < LEAST_KEYFRAMES:
        raise ValueError(f"the scenery told the attitude in {len(sights)} keyframes, {LEAST_KEYFRAMES} are needed")
    held = [sights[i] for i in np.linspace(0, len(sights) - 1, min(len(sights), _MOST_KEYFRAMES)).round().astype(int)]
    R_enu_from_base = [one.pose.R_cam_from_enu.T @ R_FRD_FROM_CAM.T @ R_base_from_mount.T for one in held]
    by_mount = np.concatenate(R_enu_from_base)  # of the error about the base's axes
    solved = np.linalg.solve(
        _covariance(held), np.column_stack([by_mount, np.concatenate([s.error_rad for s in held])])
    )
    information = np.eye(3) / MOUNT_SIGMA_RAD**2 + by_mount.T @ solved[:, :3]
    vector_rad = np.linalg.solve(information, by_mount.T @ solved[:, 3])
    angles_rad = _angles(R_base_from_mount, vector_rad)
    steps = np.stack(
        [_angles(R_base_from_mount, vector_rad + _STEP_RAD * axis) - angles_rad for axis in np.eye(3)], axis=1
    )
    turning = _TURNS_WITH_BODY * np.mean([one.errors.bias_variance for one in held], axis=0)
    covariance = (steps / _STEP_RAD) @ (np.linalg.inv(information) + turning) @ (steps / _STEP_RAD).T
    return SceneryMount(angles_rad, np.sqrt(np.diag(covariance)), len(held))


def _covariance(sights: Sequence[AttitudeSight]) -> FloatArray:
    """Of all keyframes' errors but for the mount's part (3n, 3n): the autopilot's, and the scenery's own.

    The scenery's errors are as alike from keyframe to keyframe as the autopilot's, for GNSS' drift makes both.
    """
    stamps_s = np.array([one.pose.stamp_s for one in sights])
    time_constant_s = np.array([one.errors.bias_time_constant_s for one in sights])
    apart_s = np.abs(stamps_s[:, None] - stamps_s)
    alike = np.exp(-apart_s / np.minimum(time_constant_s[:, None], time_constant_s))
    roots = [
        (
            np.sqrt((1.0 - _TURNS_WITH_BODY) * one.errors.bias_variance),
            np.linalg.cholesky(one.covariance_rad2 + 1e-12 * np.eye(3)),
        )
        for one in sights
    ]
    n = len(sights)
    total = np.zeros((n, 3, n, 3))
    for part in range(2):
        stacked = np.stack([root[part] for root in roots])
        total += np.einsum("iab,jcb,ij->iajc", stacked, stacked, alike)
    white = np.array([one.errors.attitude_white_rad**2 for one in sights])
    flat = total.reshape(3 * n, 3 * n)
    return np.asarray(flat + np.diag(np.repeat(white, 3)))


def _angles(R_base_from_mount: FloatArray, vector_rad: FloatArray) -> FloatArray:
    return euler_from_matrix(matrix_from_rotation_vector(-vector_rad) @ R_base_from_mount)
