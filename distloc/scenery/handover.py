"""Whose attitude the targets go by, and what they are told of its error from step to step; the compass has one."""

from dataclasses import replace
from typing import Literal

import numpy as np

from distloc.geometry.rotations import matrix_from_rotation_vector
from distloc.scenery.aided import Answer
from distloc.types import AttitudeError, CameraPose, FloatArray, PoseErrors

_LEAST_NEW = float(np.radians(0.01)) ** 2
_BETTER, _NO_BETTER = 0.3, 0.6  # of the told heading's sigma: to take the scenery's, to leave it
_FAR_LESS = 0.5  # of the heading's variance
_CONTRADICTS = 3.0  # standard deviations between the two
_APART = -0.5  # cosine of two courses: at 120 degrees and more the same drift cannot look alike on both
_ALIKE = 1.0 / 3.0  # of an error
_LEAST_STEP_M = 2.0


class Handover:
    """Holds what was handed on last: the source, the error taken off and the covariance of what is left (3, 3)."""

    def __init__(self) -> None:
        self.is_scenery = False
        self._error_rad = np.zeros(3)
        self._covariance = np.zeros((3, 3))
        self._since = np.zeros((3, 3))  # what came in since the last keyframe

    def is_surer(self, error_rad: FloatArray, covariance: FloatArray, told: PoseErrors) -> bool:
        """Whether to go by the scenery: it is surer, or what it says contradicts what was told."""
        limit, told_rad2 = _NO_BETTER if self.is_scenery else _BETTER, told.heading_bias_rad**2
        contradicts = error_rad[2] ** 2 > _CONTRADICTS**2 * (told_rad2 + covariance[2, 2])
        return bool(covariance[2, 2] < limit**2 * told_rad2 or contradicts)

    def by_autopilot(
        self, pose: CameraPose, errors: PoseErrors, kept: float, is_about_to_tell: bool = False
    ) -> CameraPose:
        """The reported attitude: its error is Gauss-Markov.

        It is all new where the scenery's was used before, and where it was told far larger, for nobody knew yet.
        """
        told = errors.bias_variance
        attitude = self._autopilots(told, kept)
        if self.is_scenery or not self._covariance.any() or told[2, 2] < _FAR_LESS * self._covariance[2, 2]:
            attitude = AttitudeError(told, np.zeros((3, 3)), told, "autopilot")
        attitude = replace(attitude, is_about_to_tell=is_about_to_tell)
        return self._handed(pose, errors, attitude, np.zeros(3))

    def by_scenery(
        self,
        pose: CameraPose,
        errors: PoseErrors,
        kept: float,
        found: tuple[FloatArray, FloatArray, FloatArray],
    ) -> CameraPose:
        """The corrected attitude: its error keeps of the one before what both share, and what was told stays told.

        `found` are the error (3,), its covariance (3, 3) and that with the error of the keyframe before (3, 3).
        """
        error_rad, covariance, with_last = found
        if not self.is_scenery:
            before, floored = self._autopilots(errors.bias_variance, kept), covariance + _LEAST_NEW * np.eye(3)
            attitude = AttitudeError(floored, before.kept, before.new, "scenery", error_rad)
        else:
            U, s, Vt = np.linalg.svd(np.linalg.solve(self._covariance, with_last.T).T)
            share = U * np.minimum(s, 1.0) @ Vt
            shared = share @ self._covariance @ share.T
            values, vectors = np.linalg.eigh(covariance - shared)
            new = vectors * np.maximum(values, _LEAST_NEW) @ vectors.T
            attitude = AttitudeError(shared + new, share, new, "scenery")
        return self._handed(pose, errors, attitude, error_rad)

    def between(self, pose: CameraPose, errors: PoseErrors, elapsed_s: float) -> CameraPose:
        """Of a pose too near the last keyframe, so long ago: the same error, and what may have come in since."""
        since = np.zeros((3, 3))
        if self.is_scenery:
            share = min(1.0, 2.0 * elapsed_s / errors.bias_time_constant_s)
            since = share * errors.bias_variance + errors.attitude_white_rad**2 * np.eye(3)
        new, self._since = np.diag(np.maximum(np.diag(since - self._since), 0.0)), since
        source: Literal["scenery", "autopilot"] = "scenery" if self.is_scenery else "autopilot"
        attitude = AttitudeError(self._covariance + since, np.eye(3), new, source)
        return self._corrected(pose, errors, attitude, self._error_rad)

    def _autopilots(self, told: FloatArray, kept: float) -> AttitudeError:
        new = (1.0 - kept**2) * told + np.maximum(told - self._covariance, 0.0)
        return AttitudeError(told, kept * np.eye(3), new, "autopilot")

    def _handed(
        self, pose: CameraPose, errors: PoseErrors, attitude: AttitudeError, error_rad: FloatArray
    ) -> CameraPose:
        self.is_scenery = attitude.source == "scenery"
        self._covariance, self._error_rad, self._since = attitude.covariance, error_rad, np.zeros((3, 3))
        return self._corrected(pose, errors, attitude, error_rad)

    def _corrected(
        self, pose: CameraPose, errors: PoseErrors, attitude: AttitudeError, error_rad: FloatArray
    ) -> CameraPose:
        if not self.is_scenery:
            return replace(pose, errors=errors, attitude=attitude)
        sigma_rad = np.sqrt(np.diag(attitude.covariance))
        left = replace(
            errors,
            heading_bias_rad=float(sigma_rad[2]),
            tilt_bias_rad=float(np.hypot(*sigma_rad[:2]) / np.sqrt(2.0)),
            attitude_white_rad=0.0,
        )
        R = pose.R_cam_from_enu @ matrix_from_rotation_vector(error_rad)
        return replace(pose, R_cam_from_enu=R, errors=left, attitude=attitude)


class BeyondTold:
    """A heading that is wrong by more than is told to be possible: of the compass, or of ground that moves as one.

    Ground that drifts (a river, ice) turns the heading by the angle between its motion and the craft's, and nothing in
    the frames tells. A compass' error does not care where the craft flies. So such an error is told no surer than a
    third of itself, until it was the same on two courses that are well apart: the first is remembered.
    """

    def __init__(self) -> None:
        self._error_rad: float | None = None
        self._course = np.zeros(2)
        self._is_proven = False

    def weighed(self, found: Answer, told_rad: float, moved_m: FloatArray) -> Answer:
        """An answer as sure as it can be: `told_rad` is the heading's sigma, `moved_m` (3,) the way since the last."""
        error_rad = float(found.error_rad[2])
        if abs(error_rad) <= _CONTRADICTS * told_rad:
            self._error_rad, self._is_proven = None, False
            return found
        self._note(error_rad, moved_m[:2])
        if self._is_proven:
            return found
        least = np.zeros((3, 3))
        least[2, 2] = max((error_rad / _CONTRADICTS) ** 2 - found.covariance[2, 2], 0.0)
        return replace(found, covariance=found.covariance + least)

    def _note(self, error_rad: float, moved_m: FloatArray) -> None:
        length_m = float(np.linalg.norm(moved_m))
        before = self._error_rad
        if before is not None and abs(error_rad - before) <= _ALIKE * abs(before):
            self._is_proven |= length_m > _LEAST_STEP_M and float(moved_m @ self._course) < _APART * length_m
        elif length_m > _LEAST_STEP_M:
            self._error_rad, self._course, self._is_proven = error_rad, moved_m / length_m, False
        else:
            self._error_rad, self._is_proven = None, False
