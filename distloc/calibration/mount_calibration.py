"""The mount's angles from sights of a landmark whose place is known; `calibrate` calls it.

All sights are fitted at once by Gauss-Newton. Unknown are the mount (3 angles), one offset of the positions against the
landmark, the attitude's error in proportion to the body's tilt, and at each sight its slow error about east, north and
up, a Gauss-Markov process as in the filter.
While the body is level an error of the heading is the same as one of the mount's yaw, and only the priors tell them
apart; they part as it tilts, for the mount turns with the body and the heading's error does not. Tilt errors, fixed to
the earth, and the mount's pitch and roll part as the heading changes.
"""

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from distloc.calibration.chain import solve_chain
from distloc.calibration.pose_trail import PoseTrail
from distloc.geometry.rotations import R_FRD_FROM_CAM, matrix_from_rotation_vector
from distloc.sights.sight import Sight
from distloc.types import BoolArray, CameraPose, FloatArray, PoseErrors

LEAST_SIGHTS = 20
MOUNT_SIGMA_RAD = float(np.radians(10.0))  # a mount set by eye or with a protractor, on each axis
LANDMARK_SIGMA_M = 3.0  # a mast's place read off a map, on each axis; GNSS adds its own
# Attitude error by tilt, about each axis: scales and cross axes of the sensors, the lens. The five SITL recordings'
# yaws are 0.2 to 0.7 deg off without it, all to the same side: 1 % of the tilt about another axis is 0.6 deg of yaw.
GAIN_SIGMA = 0.01
_HUBER = 2.5  # in standard deviations of two components: 4 % of good sights are beyond
_REJECTED = 4.0  # 0.03 % of good sights are beyond
_STEPS = 40
_LEAST_STEP = 1e-5  # radians, a hundredth of the surest sigma
_MEDIAN_SQUARE = 2.0 * np.log(2.0)  # median of a chi-square with two degrees of freedom


@dataclass(frozen=True, slots=True)
class LandmarkSight:
    """A sight of the landmark, and how the mount's base (the body or the gimbal) was turned by report.

    `sight.axes` are as the pose with the old mount had them. `R_enu_from_base` is (3, 3).
    """

    sight: Sight
    R_enu_from_base: FloatArray
    errors: PoseErrors


@dataclass(frozen=True, slots=True)
class MountCalibration:
    """The mount as found.

    `angles_rad` (3,) are yaw, pitch and roll, `covariance_rad2` (3, 3) is theirs. `residuals_rad` (N, 2) are what is
    left of each sight to the right and up, its slow error taken off; `used` (N,) is False where it was an outlier.
    `white_scale` is how many times larger the sights' white errors were than said, 1 if they were not.
    """

    R_base_from_mount: FloatArray
    angles_rad: FloatArray
    covariance_rad2: FloatArray
    residuals_rad: FloatArray
    used: BoolArray
    white_scale: float

    @property
    def sigmas_rad(self) -> FloatArray:
        """One standard deviation (3,) of yaw, pitch and roll."""
        return np.sqrt(np.diag(self.covariance_rad2))


def landmark_sight(sight: Sight, pose: CameraPose, errors: PoseErrors, R_base_from_mount: FloatArray) -> LandmarkSight:
    """A sight made with `pose`, which had the mount's old angles in it."""
    return LandmarkSight(sight, pose.R_cam_from_enu.T @ R_FRD_FROM_CAM.T @ R_base_from_mount.T, errors)


def shifted(
    candidates: Sequence[Sequence[LandmarkSight]], trail: PoseTrail, offset_s: float, R_base_from_mount: FloatArray
) -> list[list[LandmarkSight]]:
    """The candidates with the poses of `offset_s` before their stamps; frames without one are left out.

    `R_base_from_mount` is the old mount, which the trail's poses have.
    """
    firsts = [frame[0] for frame in candidates]
    R_cam, positions_m, is_known = trail.at(np.array([one.sight.stamp_s for one in firsts]) - offset_s)
    R_cam_from_base = R_FRD_FROM_CAM.T @ R_base_from_mount.T
    out = []
    for i in np.flatnonzero(is_known).tolist():
        turn = R_cam[i].T @ R_cam_from_base @ firsts[i].R_enu_from_base.T
        out.append([_moved(one, turn, positions_m[i]) for one in candidates[i]])
    return out


def _moved(one: LandmarkSight, turn: FloatArray, position_enu_m: FloatArray) -> LandmarkSight:
    sight = dataclasses.replace(one.sight, position_enu_m=position_enu_m, axes=one.sight.axes @ turn.T)
    return LandmarkSight(sight, turn @ one.R_enu_from_base, one.errors)


def nearest_sights(
    candidates: Sequence[Sequence[LandmarkSight]],
    landmark_enu_m: FloatArray,
    R_base_from_old: FloatArray,
    gate_rad: float,
) -> list[LandmarkSight]:
    """Of each frame's candidates the one nearest to the landmark, if it is within the gate.

    `R_base_from_old` (3, 3) turns the old mount to the one that is believed: R_base_from_mount new @ old'.
    """
    chosen = []
    for frame in candidates:
        off_rad = [_off_rad(one, landmark_enu_m, R_base_from_old) for one in frame]
        if off_rad and min(off_rad) < gate_rad:
            chosen.append(frame[int(np.argmin(off_rad))])
    return chosen


def _off_rad(one: LandmarkSight, landmark_enu_m: FloatArray, R_base_from_old: FloatArray) -> float:
    line = one.R_enu_from_base.T @ (landmark_enu_m - one.sight.position_enu_m)
    return angle_rad(one.R_enu_from_base @ (R_base_from_old.T @ line), one.sight.axes[2])


def angle_rad(one: FloatArray, other: FloatArray) -> float:
    """Between two vectors (3,)."""
    return float(np.arctan2(np.linalg.norm(np.cross(one, other)), one @ other))


def calibrate_mount(
    sights: Sequence[LandmarkSight], landmark_enu_m: FloatArray, R_base_from_mount: FloatArray
) -> MountCalibration:
    """The mount from sights in order of time, the old angles as a prior that is `MOUNT_SIGMA_RAD` wide.

    Outliers are weighed down (Huber), then left out. Raises ValueError with fewer than `LEAST_SIGHTS` sights, before or
    after that, or if something is not finite.
    """
    fit = _Fit(sights, landmark_enu_m)
    everything = np.ones(len(sights), dtype=bool)
    fit.run(everything, is_robust=True)
    scale = fit.white_scale(everything)
    used = fit.distance() < _REJECTED * scale
    for _ in range(3):
        if used.sum() < LEAST_SIGHTS:
            break
        fit.scale = scale = fit.white_scale(used)
        fit.run(used, is_robust=False)
        before, used = used, fit.distance() < _REJECTED
        if (before == used).all():
            break
    if used.sum() < LEAST_SIGHTS:
        raise ValueError(f"at least {LEAST_SIGHTS} sights that agree are needed, got {used.sum()} of {len(sights)}")
    fit.run(used, is_robust=False)
    R_new = fit.R_base_from_old @ R_base_from_mount
    by_turn = _angles_by_turn(R_new)
    return MountCalibration(
        R_base_from_mount=R_new,
        angles_rad=euler_from_matrix(R_new),
        covariance_rad2=by_turn @ fit.covariance[:3, :3] @ by_turn.T,
        residuals_rad=-fit.tangents(),
        used=used,
        white_scale=scale,
    )


def euler_from_matrix(R: FloatArray) -> FloatArray:
    """Yaw, pitch, roll (3,) of `matrix_from_euler`; straight up or down, where yaw and roll are one, roll is 0."""
    pitch = float(np.arcsin(np.clip(-R[2, 0], -1.0, 1.0)))
    if abs(R[2, 0]) > 1.0 - 1e-9:
        return np.array([np.arctan2(-R[0, 1], R[1, 1]), pitch, 0.0])
    return np.array([np.arctan2(R[1, 0], R[0, 0]), pitch, np.arctan2(R[2, 1], R[2, 2])])


class _Fit:
    """The unknowns and their improvement; n sights."""

    def __init__(self, sights: Sequence[LandmarkSight], landmark_enu_m: FloatArray) -> None:
        if len(sights) < LEAST_SIGHTS:
            raise ValueError(f"at least {LEAST_SIGHTS} sights are needed, got {len(sights)}")
        self._axes = np.stack([one.sight.axes for one in sights])
        self._base = np.stack([one.R_enu_from_base for one in sights])
        self._lines_m = landmark_enu_m - np.stack([one.sight.position_enu_m for one in sights])
        self._roots = np.linalg.cholesky(np.linalg.inv(np.stack([one.sight.covariance for one in sights])))
        errors = [one.errors for one in sights]
        self._bias_sigma = np.array([[one.tilt_bias_rad, one.tilt_bias_rad, one.heading_bias_rad] for one in errors])
        stamps_s = np.array([one.sight.stamp_s for one in sights])
        taus_s = np.array([one.bias_time_constant_s for one in errors])
        # two sights at once would have no process noise between them
        self._kept = np.exp(-np.maximum(np.diff(stamps_s), 1e-3) / taus_s[1:])
        if not all(np.isfinite(part).all() for part in (self._axes, self._base, self._lines_m, self._kept)):
            raise ValueError("landmark, positions, attitudes and stamps must be finite numbers")
        offset_m = np.hypot(LANDMARK_SIGMA_M, np.median([one.position_m for one in errors]))
        self._prior = np.diag([MOUNT_SIGMA_RAD**-2] * 3 + [offset_m**-2] * 3 + [GAIN_SIGMA**-2] * 6)
        self.R_base_from_old = np.eye(3)
        self._offset_m = np.zeros(3)
        self._tilt = self._base[:, 2, :2]  # the sines of pitch and roll
        self._gain = np.zeros((3, 2))
        self._bias = np.zeros((len(sights), 3))  # in standard deviations
        self.covariance = np.zeros_like(self._prior)
        self.scale = 1.0

    def tangents(self) -> FloatArray:
        """Where the landmark is expected (n, 2), to the right and up of the measured ray."""
        seen = np.einsum("nij,nj->ni", self._axes, self._expected()[2])
        ahead = np.where(np.abs(seen[:, 2:]) > 1e-9, seen[:, 2:], 1e-9)
        return np.asarray(seen[:, :2] / ahead)

    def distance(self) -> FloatArray:
        """Each residual's length (n,) in its standard deviations."""
        return np.asarray(np.linalg.norm(np.einsum("nji,nj->ni", self._roots, self.tangents()), axis=1) / self.scale)

    def white_scale(self, used: BoolArray) -> float:
        """How many times larger than said the white errors are, by their median; outliers do not move it."""
        return float(max(1.0, self.scale * np.sqrt(np.median(self.distance()[used] ** 2) / _MEDIAN_SQUARE)))

    def run(self, used: BoolArray, is_robust: bool) -> None:
        """Improve until nothing moves."""
        for _ in range(_STEPS):
            weights = used / self.scale**2
            if is_robust:
                weights = weights * _HUBER / np.maximum(self.distance(), _HUBER)
            if self._step(weights) < _LEAST_STEP:
                return

    def _expected(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Lines of sight (n, 3) in the base, with the attitude's slow error in ENU, and as the old mount shows them."""
        turned = _turned(self._bias_sigma * self._bias, self._lines_m + self._offset_m)
        in_base = _turned(-self._tilt @ self._gain.T, np.einsum("nji,nj->ni", self._base, turned))
        return in_base, turned, np.einsum("nij,nj->ni", self._base, in_base @ self.R_base_from_old)

    def _step(self, weights: FloatArray) -> float:
        """One step of Gauss-Newton; the largest change of an angle in radians."""
        by_all, residuals = self._linearised()
        weighted = by_all * weights[:, None, None]
        H = np.einsum("nki,nkj->nij", weighted, by_all)
        g = -np.einsum("nki,nk->ni", weighted, residuals)
        turn = _rotation_vector(self.R_base_from_old)
        m = len(self._prior)
        shared = H[:, :m, :m].sum(axis=0) + self._prior
        shared_g = g[:, :m].sum(axis=0) - self._prior @ np.concatenate([turn, self._offset_m, self._gain.ravel()])
        change, bias_change, self.covariance = solve_chain(
            shared, shared_g, H[:, :m, m:], H[:, m:, m:], g[:, m:], self._kept, self._bias
        )
        if not np.isfinite(change).all():
            raise ValueError("the sights cannot be fitted: a landmark at the camera's own place?")
        self.R_base_from_old = matrix_from_rotation_vector(change[:3]) @ self.R_base_from_old
        self._offset_m = self._offset_m + change[3:6]
        self._gain = self._gain + change[6:].reshape(3, 2)
        self._bias = self._bias + bias_change
        return float(max(np.abs(change[:3]).max(), np.abs(bias_change * self._bias_sigma).max()))

    def _linearised(self) -> tuple[FloatArray, FloatArray]:
        """Whitened: the derivative (n, 2, 15) by mount, offset, gain and slow error; the residuals (n, 2)."""
        in_base, turned, seen_enu = self._expected()
        seen = np.einsum("nij,nj->ni", self._axes, seen_enu)
        ahead = np.where(np.abs(seen[:, 2]) > 1e-9, seen[:, 2], 1e-9)
        tangents = seen[:, :2] / ahead[:, None]
        by_seen = (self._axes[:, :2] - tangents[:, :, None] * self._axes[:, 2:]) / ahead[:, None, None]
        by_base = np.einsum("nij,njk,lk->nil", by_seen, self._base, self.R_base_from_old)
        by_turned = np.einsum("nij,nkj->nik", by_base, self._base)
        by_mount = by_base @ _cross(in_base)
        by_gain = (by_mount[:, :, :, None] * self._tilt[:, None, None, :]).reshape(len(tangents), 2, 6)
        by_bias = -by_turned @ _cross(turned) * self._bias_sigma[:, None, :]
        whiten = np.swapaxes(self._roots, 1, 2)
        by_all = whiten @ np.concatenate([by_mount, by_turned, by_gain, by_bias], axis=2)
        return by_all, np.einsum("nij,nj->ni", whiten, tangents)


def _angles_by_turn(R_base_from_mount: FloatArray) -> FloatArray:
    """Derivative (3, 3) of yaw, pitch and roll by a small turn about the base's axes."""
    step = 1e-5
    turns = [matrix_from_rotation_vector(step * axis) for axis in np.eye(3)]
    ends = [
        euler_from_matrix(turn @ R_base_from_mount) - euler_from_matrix(turn.T @ R_base_from_mount) for turn in turns
    ]
    return wrapped_rad(np.stack(ends, axis=1)) / (2.0 * step)


def wrapped_rad(angles_rad: FloatArray) -> FloatArray:
    """Angles within half a turn of 0."""
    return np.asarray((angles_rad + np.pi) % (2.0 * np.pi) - np.pi)


def _rotation_vector(R: FloatArray) -> FloatArray:
    sine = np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]]) / 2.0
    length = float(np.linalg.norm(sine))
    angle = float(np.arctan2(length, (np.trace(R) - 1.0) / 2.0))
    return sine if length < 1e-9 else sine * (angle / length)


def _turned(vectors_rad: FloatArray, lines: FloatArray) -> FloatArray:
    """Each line (n, 3) turned about its own rotation vector (n, 3) (Rodrigues)."""
    angles = np.linalg.norm(vectors_rad, axis=1, keepdims=True)
    axes = vectors_rad / np.maximum(angles, 1e-12)
    along = np.sum(axes * lines, axis=1, keepdims=True) * axes
    return np.asarray(along + np.cos(angles) * (lines - along) + np.sin(angles) * np.cross(axes, lines))


def _cross(vectors: FloatArray) -> FloatArray:
    """Matrices (n, 3, 3): `_cross(v)[i] @ w` is v[i] x w."""
    out = np.zeros((len(vectors), 3, 3))
    out[:, [2, 0, 1], [1, 2, 0]] = vectors
    out[:, [1, 2, 0], [2, 0, 1]] = -vectors
    return out
