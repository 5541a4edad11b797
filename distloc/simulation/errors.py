"""The errors of an autopilot's navigation: what its messages say instead of the truth."""

import numpy as np

from distloc.simulation.paths import VehicleTruth
from distloc.types import FloatArray


class AutopilotErrors:
    """Slow first-order Gauss-Markov errors of attitude and position, and white noise on both.

    `*_bias_*` are the slow errors' standard deviations, which start in their steady state and forget themselves in
    `tau_s`; `*_white_*` the white ones'. Tilt is roll and pitch alike, each with its own error.
    """

    def __init__(
        self,
        rng: np.random.Generator,
        heading_bias_rad: float = 0.035,
        heading_white_rad: float = 0.003,
        tilt_bias_rad: float = 0.006,
        tilt_white_rad: float = 0.001,
        position_bias_m: float = 1.0,
        position_white_m: float = 0.1,
        tau_s: float = 120.0,
    ) -> None:
        if not tau_s > 0.0:
            raise ValueError(f"tau_s must be > 0, got {tau_s}")
        tilt = [tilt_bias_rad, tilt_bias_rad]
        self._bias_sigma = np.array([heading_bias_rad, *tilt, *[position_bias_m] * 3])
        self._white_sigma = np.array([heading_white_rad, tilt_white_rad, tilt_white_rad, *[position_white_m] * 3])
        if not (np.isfinite(self._bias_sigma).all() and (self._bias_sigma >= 0.0).all()):
            raise ValueError(f"standard deviations must be finite and >= 0, got {self._bias_sigma}")
        self._rng = rng
        self._tau_s = tau_s
        self._bias = self._bias_sigma * rng.standard_normal(6)
        self._stamp_s: float | None = None

    @property
    def bias(self) -> FloatArray:
        """The slow errors now (6,): yaw, pitch, roll in radians, then east, north, up in metres."""
        return self._bias.copy()

    def perturb(self, truth: VehicleTruth, t_s: float) -> VehicleTruth:
        """What the autopilot reports at a time; times must not fall, an earlier one keeps the slow error as it is."""
        elapsed = 0.0 if self._stamp_s is None else max(0.0, t_s - self._stamp_s)
        self._stamp_s = t_s if self._stamp_s is None else max(t_s, self._stamp_s)
        kept = float(np.exp(-elapsed / self._tau_s))
        drive = self._bias_sigma * np.sqrt(1.0 - kept * kept)
        self._bias = kept * self._bias + drive * self._rng.standard_normal(6)
        error = self._bias + self._white_sigma * self._rng.standard_normal(6)
        return VehicleTruth(
            position_enu_m=truth.position_enu_m + error[3:],
            velocity_enu_mps=truth.velocity_enu_mps.copy(),
            yaw_rad=float((truth.yaw_rad + error[0] + np.pi) % (2.0 * np.pi) - np.pi),
            pitch_rad=truth.pitch_rad + float(error[1]),
            roll_rad=truth.roll_rad + float(error[2]),
        )
