"""The mount's angles from what the scenery says of the reported attitude; the service in flight and `calibrate` use it.

What the attitude is wrong by is the mount's part, which turns with the body, and the autopilot's. Half of the latter's
variance turns with the body as well, as a compass that is set wrong and levels that are off do: that looks like the
mount's, and the sigmas hold it. The other half is a Gauss-Markov process about east, north and up, and so is the
scenery's own error, for GNSS' drift makes both. All are linear in small angles: a Kalman filter of nine states, whose
answer is that of generalised least squares over all keyframes.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from distloc.calibration.mount_calibration import MOUNT_SIGMA_RAD, euler_from_matrix, wrapped_rad
from distloc.geometry.rotations import R_FRD_FROM_CAM, matrix_from_rotation_vector
from distloc.types import CameraPose, FloatArray, PoseErrors

LEAST_KEYFRAMES = 20
_STEP_RAD = 1e-6
_LEAST_GAIN = 0.05  # of what was told: the scenery tells nothing about an axis
_TURNS_WITH_BODY = 0.5  # of the autopilot's variance
_LEAST_VARIANCE = 1e-12
_MOST_LEFT_OUT = 5
_CONTRADICTS = 25.0  # squared distance of three components, as large as the errors are: once in 70,000


@dataclass(frozen=True, slots=True)
class AttitudeSight:
    """What the scenery says at a keyframe: the reported pose, its error about east, north and up (3,), (3, 3)."""

    pose: CameraPose
    errors: PoseErrors
    error_rad: FloatArray
    covariance_rad2: FloatArray


@dataclass(frozen=True, slots=True)
class SceneryMount:
    """The mount as found: yaw, pitch and roll (3,) with one standard deviation of each, and by how many keyframes.

    `turned_rad` is how far apart the craft's headings were, without end where it circles: on one heading a compass
    that is off looks like the mount's yaw.
    """

    angles_rad: FloatArray
    sigmas_rad: FloatArray
    used: int
    turned_rad: float


class MountEstimator:
    """The mount's part of the errors so far, keyframe by keyframe; `R_base_from_mount` (3, 3) is what the poses have.

    States are the mount's error about the base's axes in radians, the autopilot's slow error and the scenery's, both in
    standard deviations. A keyframe that contradicts all before is left out; where a few in a row do, the reported
    attitude has stepped: what was held was not the mount's, and all begins anew.
    """

    def __init__(self, R_base_from_mount: FloatArray) -> None:
        self._R_base_from_mount = R_base_from_mount
        self._begin()

    def _begin(self) -> None:
        self._state, self._covariance = np.zeros(9), np.diag([MOUNT_SIGMA_RAD**2] * 3 + [1.0] * 6)
        self._stamp_s: float | None = None
        self.count, self._distance, self._bias_variance = 0, 0.0, np.zeros((3, 3))
        self._left_out = 0  # in a row
        self._heading_rad, self._headings_rad = 0.0, (np.inf, -np.inf)

    def add(self, sight: AttitudeSight) -> None:
        """A keyframe, later than the one before; one that isn't has a slow error of its own. LinAlgError as below."""
        errors = sight.errors
        elapsed_s = -1.0 if self._stamp_s is None else sight.pose.stamp_s - self._stamp_s
        kept = float(np.exp(-elapsed_s / errors.bias_time_constant_s)) if elapsed_s >= 0.0 else 0.0
        R_enu_from_base = sight.pose.R_cam_from_enu.T @ R_FRD_FROM_CAM.T @ self._R_base_from_mount.T
        slow = np.sqrt((1.0 - _TURNS_WITH_BODY) * errors.bias_variance)
        error_rad, covariance_rad2 = _measured(sight)
        own = np.linalg.cholesky(covariance_rad2 + _LEAST_VARIANCE * np.eye(3))
        H = np.concatenate([R_enu_from_base, slow, own], axis=1)
        white = (errors.attitude_white_rad**2 + _LEAST_VARIANCE) * np.eye(3)
        if not self._take(H, error_rad, white, kept):
            self._left_out += 1
            if self._left_out < _MOST_LEFT_OUT:
                return
            self._begin()
            self._take(H, error_rad, white, 0.0)
        self._left_out = 0
        self._stamp_s = sight.pose.stamp_s
        self.count += 1
        self._bias_variance = self._bias_variance + (errors.bias_variance - self._bias_variance) / self.count
        self._turn(sight.pose.heading_rad, R_enu_from_base)

    def _take(self, H: FloatArray, error_rad: FloatArray, white: FloatArray, kept: float) -> bool:
        """Predict and update; False, and nothing done, where not even a new slow error explains it."""
        if self._off(H, error_rad, white, 0.0)[1] > _CONTRADICTS * self._scale:
            return False
        state, P = self._predicted(kept)
        off, distance = self._off(H, error_rad, white, kept)
        S = H @ P @ H.T + white
        K = np.linalg.solve(S, H @ P).T
        P = P - K @ S @ K.T
        self._state, self._covariance = state + K @ off, (P + P.T) / 2.0
        self._distance += distance
        return True

    def _predicted(self, kept: float) -> tuple[FloatArray, FloatArray]:
        F = np.diag([1.0] * 3 + [kept] * 6)
        return F @ self._state, F @ self._covariance @ F + np.diag([0.0] * 3 + [1.0 - kept**2] * 6)

    def _off(self, H: FloatArray, error_rad: FloatArray, white: FloatArray, kept: float) -> tuple[FloatArray, float]:
        """The innovation (3,) and its squared distance."""
        state, P = self._predicted(kept)
        off = error_rad - H @ state
        return off, float(off @ np.linalg.solve(H @ P @ H.T + white, off))

    @property
    def _scale(self) -> float:
        """How many times larger than told the errors' variances are, 1 where they are not."""
        return max(1.0, self._distance / (3.0 * max(self.count, 1)))

    def _turn(self, heading_rad: float | None, R_enu_from_base: FloatArray) -> None:
        """The craft's heading, by its base's where it is not known, unwound."""
        if heading_rad is None:
            heading_rad = float(np.arctan2(R_enu_from_base[0, 0], R_enu_from_base[1, 0]))
        self._heading_rad += float(wrapped_rad(np.array(heading_rad - self._heading_rad)))
        low_rad, high_rad = self._headings_rad
        self._headings_rad = min(low_rad, self._heading_rad), max(high_rad, self._heading_rad)

    def mount(self) -> SceneryMount:
        """The mount so far; ValueError where there are fewer than LEAST_KEYFRAMES.

        Sigmas are larger where the errors are than was told.
        """
        if self.count < LEAST_KEYFRAMES:
            raise ValueError(f"the scenery told the attitude in {self.count} keyframes, {LEAST_KEYFRAMES} are needed")
        vector_rad = self._state[:3]
        angles_rad = self._angles(vector_rad)
        steps = [wrapped_rad(self._angles(vector_rad + _STEP_RAD * axis) - angles_rad) for axis in np.eye(3)]
        J = np.stack(steps, axis=1) / _STEP_RAD
        of_base = self._scale * self._covariance[:3, :3] + _TURNS_WITH_BODY * self._bias_variance
        sigmas_rad = np.sqrt(np.diag(J @ of_base @ J.T))
        low_rad, high_rad = self._headings_rad
        return SceneryMount(angles_rad, sigmas_rad, self.count, high_rad - low_rad)

    def _angles(self, vector_rad: FloatArray) -> FloatArray:
        return euler_from_matrix(matrix_from_rotation_vector(-vector_rad) @ self._R_base_from_mount)


def _measured(sight: AttitudeSight) -> tuple[FloatArray, FloatArray]:
    """The error (3,) as the scenery alone has it, and its covariance (3, 3): what was told of it before is taken out.

    What was told holds the error back towards none, the more the less the scenery says, and a mount's part with it.
    Raises numpy.linalg.LinAlgError for a covariance that is none.
    """
    told_rad = np.sqrt(np.diag(sight.errors.bias_variance))
    values, vectors = np.linalg.eigh(np.linalg.inv(sight.covariance_rad2 / np.outer(told_rad, told_rad)))
    if not values.min() > 0.0:
        raise np.linalg.LinAlgError("the scenery's covariance is none")
    axes = told_rad[:, None] * vectors
    gained = np.maximum(values - 1.0, _LEAST_GAIN)
    error = axes @ ((1.0 + 1.0 / gained) * (vectors.T @ (sight.error_rad / told_rad)))
    return error, (axes / gained) @ axes.T


def mount_from_scenery(sights: Sequence[AttitudeSight], R_base_from_mount: FloatArray) -> SceneryMount:
    """The mount's angles by keyframes in order of time; as `MountEstimator` has it."""
    estimator = MountEstimator(R_base_from_mount)
    for sight in sights:
        estimator.add(sight)
    return estimator.mount()
