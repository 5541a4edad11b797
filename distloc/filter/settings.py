"""What the localizer is told; the config's `[localizer]` and `[pose_errors]` end here."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from distloc.types import PoseErrors

MOST_PLATFORMS = 16
ENOUGH_PARTICLES = 4_096  # of the calibrated filter for a target: docs/performance.md has the sweep


@dataclass(frozen=True, slots=True)
class LocalizerConfig:
    """Settings of the filter. Raises ValueError on impossible ones.

    A filter step is due once the camera has travelled `step_distance_m` (the paper's T_s), for the calibrated filter
    also after `step_interval_s`, so that a hovering drone still sees smoke come and go; 0 of either steps at each
    frame. A target has `n_particles`; the bootstrap filter wants 100,000. `particle_sigma_m` is the bootstrap filter's
    alone. The sigmas are one standard deviation of a segment's centre beyond its own, and of the pose errors where a
    pose does not bring its own. `platforms` is how many cameras with an attitude error of their own may look, told
    apart by `CameraPose.platform`.
    """

    filter: Literal["calibrated", "bootstrap"] = "calibrated"
    n_particles: int = ENOUGH_PARTICLES
    particle_sigma_m: float = 5.0
    step_distance_m: float = 10.0
    step_interval_s: float = 1.0
    range_m: tuple[float, float] = (50.0, 30_000.0)
    dismissal_misses: int = 5
    max_targets: int = 64
    aim: Literal["centre", "base"] = "base"
    pixel_sigma_px: float = 1.0
    position_sigma_m: float = 1.0
    attitude_white_sigma_rad: float = float(np.radians(0.1))
    heading_bias_sigma_rad: float = float(np.radians(2.0))
    tilt_bias_sigma_rad: float = float(np.radians(0.5))
    bias_time_constant_s: float = 120.0
    bias_turn_rad: float = 2.0
    platforms: int = 1

    def __post_init__(self) -> None:
        if self.filter not in ("calibrated", "bootstrap"):
            raise ValueError(f"filter must be 'calibrated' or 'bootstrap', got {self.filter!r}")
        if self.aim not in ("centre", "base"):
            raise ValueError(f"aim must be 'centre' or 'base', got {self.aim!r}")
        if self.dismissal_misses < 1 or self.max_targets < 1 or self.n_particles < 1:
            raise ValueError(
                "dismissal_misses, max_targets and n_particles must be >= 1, "
                f"got {self.dismissal_misses}, {self.max_targets} and {self.n_particles}"
            )
        if not 1 <= self.platforms <= MOST_PLATFORMS:
            raise ValueError(f"platforms must be 1 to {MOST_PLATFORMS}, got {self.platforms}")
        if not 0.0 < self.range_m[0] < self.range_m[1] < np.inf:
            raise ValueError(f"range_m must rise above 0, got {self.range_m}")
        zero_allowed = (
            self.step_distance_m,
            self.step_interval_s,
            self.position_sigma_m,
            self.attitude_white_sigma_rad,
            self.heading_bias_sigma_rad,
            self.tilt_bias_sigma_rad,
        )
        if not (all(0.0 <= value < np.inf for value in zero_allowed)):
            raise ValueError(f"step_distance_m, step_interval_s and the sigmas must be finite and >= 0, got {self}")
        if not (0.0 < self.pixel_sigma_px < np.inf and min(self.bias_time_constant_s, self.bias_turn_rad) >= 1e-3):
            raise ValueError(
                "pixel_sigma_px must be > 0, bias_time_constant_s and bias_turn_rad >= 0.001, "
                f"got {self.pixel_sigma_px}, {self.bias_time_constant_s} and {self.bias_turn_rad}"
            )

    @property
    def pose_errors(self) -> PoseErrors:
        """For poses that don't bring their own."""
        return PoseErrors(
            heading_bias_rad=self.heading_bias_sigma_rad,
            tilt_bias_rad=self.tilt_bias_sigma_rad,
            attitude_white_rad=self.attitude_white_sigma_rad,
            position_m=self.position_sigma_m,
            bias_time_constant_s=self.bias_time_constant_s,
            bias_turn_rad=self.bias_turn_rad,
        )
