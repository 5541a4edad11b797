"""How a camera's reported pose differs from the true one: the paper's white noise, and errors that last."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from distloc.geometry.rotations import matrix_from_rotation_vector
from distloc.simulation.errors import GaussMarkov
from distloc.types import CameraPose, FloatArray

PoseAt = Callable[[float], CameraPose]


class PoseNoise(Protocol):
    """What a frame's pose is reported to be; one object serves one flight, in the order of time."""

    def reported(self, pose_at: PoseAt, stamp_s: float) -> CameraPose:
        """The reported pose of the frame exposed at `stamp_s`, stamped so."""
        ...


class NoPoseNoise:
    """The truth."""

    def reported(self, pose_at: PoseAt, stamp_s: float) -> CameraPose:
        """The true pose."""
        return pose_at(stamp_s)


class UniformPoseNoise:
    """The paper's: M_nu = [N_rx N_ry N_rz R | t + nu_t], each angle and each component of nu_t uniform, per frame.

    Read literally, in the axes of the ENU frame turned by R: the rotation is about the world's origin, not about the
    camera, so it moves the camera as well.
    """

    def __init__(self, rotation_rad: float, translation_m: float, rng: np.random.Generator) -> None:
        if not (rotation_rad >= 0.0 and translation_m >= 0.0):
            raise ValueError(f"amplitudes must be >= 0, got {rotation_rad} and {translation_m}")
        self._rotation_rad, self._translation_m, self._rng = rotation_rad, translation_m, rng

    def reported(self, pose_at: PoseAt, stamp_s: float) -> CameraPose:
        """The noisy extrinsics as a pose: its position is -(N R)' (t + nu_t)."""
        pose = pose_at(stamp_s)
        angles = self._rng.uniform(-self._rotation_rad, self._rotation_rad, 3)
        nu_t = self._rng.uniform(-self._translation_m, self._translation_m, 3)
        N = np.eye(3)
        for axis in range(3):
            N = N @ matrix_from_rotation_vector(angles[axis] * np.eye(3)[axis])
        R_cam_from_enu = N @ pose.R_cam_from_enu
        t = -pose.R_cam_from_enu @ pose.position_enu_m
        return CameraPose(stamp_s, -R_cam_from_enu.T @ (t + nu_t), R_cam_from_enu)


@dataclass(frozen=True, slots=True)
class CorrelatedSigmas:
    """One standard deviation of each error; the defaults are a consumer GNSS with a compass.

    Heading is about up, tilt about east and about north. Iron that turns with the craft adds a sinusoid of the heading
    to the heading's bias, `heading_iron_rad` at any one heading. The position's bias stays, its drift is Gauss-Markov
    on each axis, as GNSS errs. The time offset is how far the reported pose lags behind the frame.
    """

    heading_bias_rad: float = float(np.radians(2.0))
    tilt_bias_rad: float = float(np.radians(0.5))
    attitude_white_rad: float = float(np.radians(0.1))
    position_bias_m: float = 0.0
    position_white_m: float = 0.3
    time_offset_s: float = 0.0
    tau_s: float = 300.0
    heading_iron_rad: float = 0.0
    position_drift_m: float = 0.0

    def __post_init__(self) -> None:
        sigmas = (
            self.heading_bias_rad,
            self.tilt_bias_rad,
            self.attitude_white_rad,
            self.position_bias_m,
            self.position_white_m,
            self.time_offset_s,
            self.heading_iron_rad,
            self.position_drift_m,
        )
        if not all(0.0 <= sigma < np.inf for sigma in sigmas) or not self.tau_s > 0.0:
            raise ValueError(f"standard deviations must be finite and >= 0, tau_s > 0, got {self}")


class CorrelatedPoseErrors:
    """Attitude biases and position drift as first-order Gauss-Markov processes, a position bias and a time offset that
    stay, white noise.

    R_enu_from_cam reported = exp(beta) R_enu_from_cam true, with beta (3,) small, about east, north and up.
    """

    def __init__(self, sigmas: CorrelatedSigmas, rng: np.random.Generator) -> None:
        self._sigmas, self._rng = sigmas, rng
        bias_sigma = np.array([sigmas.tilt_bias_rad, sigmas.tilt_bias_rad, sigmas.heading_bias_rad])
        self._bias = GaussMarkov(bias_sigma, sigmas.tau_s, rng)
        self.position_bias_enu_m: FloatArray = sigmas.position_bias_m * rng.standard_normal(3)
        self.time_offset_s = float(sigmas.time_offset_s * rng.standard_normal())
        self._iron_rad = sigmas.heading_iron_rad * rng.standard_normal(2) if sigmas.heading_iron_rad else np.zeros(2)
        drift_rng = rng.spawn(1)[0]  # its own: the other errors are the same with and without
        self._drift = GaussMarkov(np.full(3, sigmas.position_drift_m), sigmas.tau_s, drift_rng)

    @property
    def bias_rad(self) -> FloatArray:
        """The attitude's slow error now (3,), about east, north and up."""
        return self._bias.value.copy()

    def reported(self, pose_at: PoseAt, stamp_s: float) -> CameraPose:
        """The pose of `time_offset_s` before the frame, wrong by the errors. Iron needs poses with a heading."""
        pose = pose_at(stamp_s - self.time_offset_s)
        self._bias.advance(stamp_s)
        self._drift.advance(stamp_s)
        bias_rad = self._bias.value.copy()
        if pose.heading_rad is not None:
            bias_rad[2] += self._iron_rad @ [np.cos(pose.heading_rad), np.sin(pose.heading_rad)]
        white = self._sigmas.attitude_white_rad * self._rng.standard_normal(3)
        white_m = self._sigmas.position_white_m * self._rng.standard_normal(3)
        error_m = self.position_bias_enu_m + self._drift.value + white_m
        R_enu_from_cam = matrix_from_rotation_vector(bias_rad + white) @ pose.R_cam_from_enu.T
        return CameraPose(
            stamp_s,
            pose.position_enu_m + error_m,
            np.ascontiguousarray(R_enu_from_cam.T),
            heading_rad=pose.heading_rad,  # an error of degrees makes no other turn of it
        )
