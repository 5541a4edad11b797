"""What the study of drawn flights flies: a row a scene, with its landscape, path, camera and what the poses do."""

from dataclasses import dataclass

import numpy as np

from distloc.geometry.camera import Camera
from distloc.simulation.flights import Geometry
from distloc.simulation.landscape.sensor import CameraFaults

__all__ = ["CAMERA", "CASES", "DrawnCase", "PoseStep", "cases_named"]

CAMERA = Camera(640, 360, 450.0, 450.0, 319.5, 179.5)
_FAULTS = CameraFaults(jpeg_quality=85)
_MIDWAY = 0.5


@dataclass(frozen=True, slots=True)
class PoseStep:
    """A step of the reported pose that no message tells of, at a share of the flight; undone `for_s` later.

    The seed draws to which side, on the map and about up.
    """

    position_m: float = 0.0
    heading_rad: float = 0.0
    at_share: float = _MIDWAY
    for_s: float = float("inf")


@dataclass(frozen=True, slots=True)
class DrawnCase:
    """One scene; lengths of flight are shares of the range.

    The true lens has a focal length that is longer or shorter by the share `focal_wrong`, as the seed draws, and
    OpenCV's coefficients `distortion`; the localizer is told `CAMERA`.
    """

    name: str
    landscape: str = "hills"
    geometry: Geometry = "perpendicular"
    length_share: float = 1.0
    speed_mps: float = 25.0
    faults: CameraFaults = _FAULTS
    focal_wrong: float = 0.0
    distortion: tuple[float, ...] = ()
    step: PoseStep = PoseStep()


_RESET = PoseStep(heading_rad=float(np.radians(12.0)), at_share=0.3, for_s=30.0)
_ROWS = (
    *(DrawnCase(name, name) for name in ("hills", "mountains", "sea", "night", "snow", "haze", "few_corners")),
    DrawnCase("traffic", "traffic"),  # cars, and the shadows of clouds
    DrawnCase("hover", geometry="hover"),
    DrawnCase("blur", faults=CameraFaults(exposure_s=0.03, jpeg_quality=85)),
    DrawnCase("rolling_shutter", faults=CameraFaults(readout_s=0.02, jpeg_quality=85)),
    DrawnCase("wrong_lens", focal_wrong=0.03, distortion=(-0.03, 0.0, 0.0, 0.0)),
    DrawnCase("gnss_jump", step=PoseStep(position_m=60.0)),
    # slower, for the flight must last until the step back
    DrawnCase("yaw_reset", speed_mps=15.0, step=_RESET),
    DrawnCase("lawnmower", geometry="lawnmower"),
    DrawnCase("orbit", geometry="orbit"),
    DrawnCase("ahead", geometry="head-on", length_share=0.7),
)
CASES: dict[str, DrawnCase] = {case.name: case for case in _ROWS}


def cases_named(names: str) -> list[DrawnCase]:
    """Those of a list with commas, in its order and each once; all where it is empty. ValueError for another name."""
    wanted = list(dict.fromkeys(name.strip() for name in names.split(","))) if names.strip() else list(CASES)
    if unknown := [name for name in wanted if name not in CASES]:
        raise ValueError(f"there is no scene {', '.join(map(repr, unknown))}: the scenes are {', '.join(CASES)}")
    return [CASES[name] for name in wanted]
