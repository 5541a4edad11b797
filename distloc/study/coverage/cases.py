"""What the coverage study flies: geometries, classes of pose errors, clutter, ranges and fires."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from distloc.localizer import LocalizerConfig
from distloc.simulation.flights import GEOMETRIES, Geometry
from distloc.simulation.pose_noise import CorrelatedSigmas
from distloc.study.bound import NoiseModel
from distloc.study.scenes import BOX_CENTRE_PX, NOISES
from distloc.types import PoseErrors

POOLED: tuple[Geometry, ...] = ("perpendicular", "oblique", "head-on", "orbit")
ASIDE_DEG = 15.0  # off the picture's middle at the start; straight on, the camera has it in view until it is 38 off
_MOST_ASIDE_DEG = 35.0
_FOR_GOOD_S = 1e5
_WORSE_HEADING_RAD = float(np.radians(5.0))

ERROR_CLASSES: Mapping[str, CorrelatedSigmas] = {
    "constant": CorrelatedSigmas(tau_s=_FOR_GOOD_S),
    "drifting": CorrelatedSigmas(tau_s=600.0),
    "survey": CorrelatedSigmas(
        heading_bias_rad=float(np.radians(0.3)),
        tilt_bias_rad=float(np.radians(0.1)),
        attitude_white_rad=float(np.radians(0.05)),
        position_white_m=0.05,
        tau_s=_FOR_GOOD_S,
    ),
    "wandering": CorrelatedSigmas(tau_s=120.0),
    "compass": CorrelatedSigmas(
        heading_bias_rad=float(np.radians(2.0 * 0.5**0.5)),
        heading_iron_rad=float(np.radians(2.0 * 0.5**0.5)),
        tau_s=_FOR_GOOD_S,
    ),
    "scenery": CorrelatedSigmas(tau_s=120.0, position_white_m=0.1, position_drift_m=1.5),
    "scenery_worse": CorrelatedSigmas(
        heading_bias_rad=_WORSE_HEADING_RAD, tau_s=120.0, position_white_m=0.1, position_drift_m=1.5
    ),
}
SCENERY = ("scenery", "scenery_worse")  # corners of the scenery are followed; the localizer is told nothing at all
_TOLD_THE_POSITION = ("wandering", "compass")  # else the localizer takes what it flies with by default


@dataclass(frozen=True, slots=True)
class CoverageCase:
    """What is flown: `error_class` is one of `ERROR_CLASSES`, `clutter` the paper's last row of mask noise.

    The localizer is told how large the errors are and how long they last, but of those that wander or turn with the
    craft: there it takes what it flies with, and corners of the scenery in the classes of `SCENERY`.

    The range is drawn log-uniform by the seed. Several `targets` stand 300 m apart across the first line of sight. The
    craft sways by about `wobble_rad`. From where the flight's origin is, they stand `aside_deg` clockwise of where the
    camera looks: there an error of the lens turns the bearing, and in the picture's middle it does not.
    """

    geometry: Geometry
    error_class: str = "constant"
    clutter: bool = False
    targets: int = 1
    range_m: tuple[float, float] = (700.0, 4000.0)
    wobble_rad: float = 0.0
    aside_deg: float = 0.0

    def __post_init__(self) -> None:
        if self.geometry not in GEOMETRIES or self.error_class not in ERROR_CLASSES:
            raise ValueError(
                f"geometry must be one of {', '.join(GEOMETRIES)} and error_class one of {', '.join(ERROR_CLASSES)}, "
                f"got {self.geometry!r} and {self.error_class!r}"
            )
        if self.targets < 1 or not 0.0 < self.range_m[0] <= self.range_m[1]:
            raise ValueError(f"targets must be >= 1 and range_m rise above 0, got {self.targets} and {self.range_m}")
        if not abs(self.aside_deg) <= _MOST_ASIDE_DEG:
            raise ValueError(f"aside_deg must be within {_MOST_ASIDE_DEG:g} of 0, got {self.aside_deg}")

    @property
    def pose_errors(self) -> PoseErrors:
        """As the localizer is told."""
        sigmas = ERROR_CLASSES[self.error_class]
        if self.error_class in SCENERY:
            return LocalizerConfig().pose_errors
        if self.error_class in _TOLD_THE_POSITION:
            return replace(LocalizerConfig().pose_errors, position_m=sigmas.position_white_m)
        return PoseErrors(
            heading_bias_rad=sigmas.heading_bias_rad,
            tilt_bias_rad=sigmas.tilt_bias_rad,
            attitude_white_rad=sigmas.attitude_white_rad,
            position_m=sigmas.position_white_m,
            bias_time_constant_s=sigmas.tau_s,
        )


def coverage_cases() -> list[CoverageCase]:
    """Every geometry with every class of errors, clutter, fires off the middle, the ranges' ends, and many fires."""
    cases = [CoverageCase(geometry, name) for name in ERROR_CLASSES for geometry in GEOMETRIES]
    cases += [CoverageCase(geometry, clutter=True) for geometry in GEOMETRIES]
    cases += [CoverageCase("head-on", name, aside_deg=ASIDE_DEG) for name in ("wandering", *SCENERY)]
    cases += [CoverageCase("perpendicular", range_m=(range_m, range_m)) for range_m in (500.0, 10_000.0)]
    return cases + [
        CoverageCase("perpendicular", clutter=True, targets=count, range_m=(2000.0, 2000.0)) for count in range(1, 6)
    ]


def main_cases() -> list[CoverageCase]:
    """The eight that are pooled: errors that stay, without clutter and with it."""
    return [CoverageCase(geometry, clutter=clutter) for clutter in (False, True) for geometry in POOLED]


def bound_noise(case: CoverageCase) -> NoiseModel:
    """What is flown, as the bound takes it."""
    sigmas = ERROR_CLASSES[case.error_class]
    return NoiseModel(
        pixel_px=BOX_CENTRE_PX,
        rotation_white_rad=sigmas.attitude_white_rad,
        translation_white_m=sigmas.position_white_m,
        heading_bias_rad=float(np.hypot(sigmas.heading_bias_rad, sigmas.heading_iron_rad)),
        tilt_bias_rad=sigmas.tilt_bias_rad,
        tau_s=sigmas.tau_s,
        missed=NOISES["pfn"].mask.false_negative_rate if case.clutter else 0.0,
        position_drift_m=sigmas.position_drift_m,
    )
