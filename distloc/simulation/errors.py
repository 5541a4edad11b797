"""The errors of an autopilot's navigation: what its messages say instead of the truth."""

import numpy as np

from distloc.simulation.paths import VehicleTruth
from distloc.types import FloatArray


class GaussMarkov:
    """A first-order Gauss-Markov process (n,) in its steady state: sigmas (n,), forgotten in `tau_s`."""

    def __init__(self, sigma: FloatArray, tau_s: float, rng: np.random.Generator) -> None:
        if not tau_s > 0.0:
            raise ValueError(f"tau_s must be > 0, got {tau_s}")
        if not (np.isfinite(sigma).all() and (sigma >= 0.0).all()):
            raise ValueError(f"standard deviations must be finite and >= 0, got {sigma}")
        self._sigma, self._tau_s, self._rng = sigma, tau_s, rng
        self.value: FloatArray = sigma * rng.standard_normal(sigma.size)
        self._stamp_s: float | None = None

    def advance(self, stamp_s: float) -> None:
        """Go on to a time; an earlier one than before keeps the value as it is."""
        elapsed_s = 0.0 if self._stamp_s is None else max(0.0, stamp_s - self._stamp_s)
        self._stamp_s = stamp_s if self._stamp_s is None else max(stamp_s, self._stamp_s)
        kept = float(np.exp(-elapsed_s / self._tau_s))
        drive = self._sigma * np.sqrt(1.0 - kept * kept)
        self.value = kept * self.value + drive * self._rng.standard_normal(self._sigma.size)


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
        tilt = [tilt_bias_rad, tilt_bias_rad]
        self._white_sigma = np.array([heading_white_rad, tilt_white_rad, tilt_white_rad, *[position_white_m] * 3])
        if not (np.isfinite(self._white_sigma).all() and (self._white_sigma >= 0.0).all()):
            raise ValueError(f"standard deviations must be finite and >= 0, got {self._white_sigma}")
        self._rng = rng
        self._bias = GaussMarkov(np.array([heading_bias_rad, *tilt, *[position_bias_m] * 3]), tau_s, rng)

    @property
    def bias(self) -> FloatArray:
        """The slow errors now (6,): yaw, pitch, roll in radians, then east, north, up in metres."""
        return self._bias.value.copy()

    def perturb(self, truth: VehicleTruth, t_s: float) -> VehicleTruth:
        """What the autopilot reports at a time; times must not fall, an earlier one keeps the slow error as it is."""
        self._bias.advance(t_s)
        error = self._bias.value + self._white_sigma * self._rng.standard_normal(6)
        return VehicleTruth(
            position_enu_m=truth.position_enu_m + error[3:],
            velocity_enu_mps=truth.velocity_enu_mps.copy(),
            yaw_rad=float((truth.yaw_rad + error[0] + np.pi) % (2.0 * np.pi) - np.pi),
            pitch_rad=truth.pitch_rad + float(error[1]),
            roll_rad=truth.roll_rad + float(error[2]),
        )
