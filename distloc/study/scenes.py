"""What the study flies past what, and with which noise: the paper's scene and the five rows of its Table 1."""

from dataclasses import dataclass, field

import numpy as np

from distloc.geometry.camera import Camera
from distloc.simulation.flights import Flight, paper_flight
from distloc.simulation.mask_noise import MaskNoise
from distloc.simulation.pose_noise import NoPoseNoise, PoseNoise, UniformPoseNoise
from distloc.simulation.targets import Box, Target
from distloc.study.bound import NoiseModel

PAPER_CAMERA = Camera(width=1920, height=1080, fx=1200.0, fy=1200.0, cx=960.0, cy=540.0)
PAPER_TARGET_ENU_M = (500.0, 2000.0, 200.0)  # (500, -200, 2000) m in the camera's axes at the start
BOX_CENTRE_PX = 1.0 / float(np.sqrt(24.0))  # the mean of two edges, each rounded to a whole pixel


@dataclass(frozen=True, slots=True)
class Scene:
    """A camera's flight past one target."""

    camera: Camera
    flight: Flight
    target: Target


@dataclass(frozen=True, slots=True)
class Noise:
    """One row's noise: the mask's, and the paper's uniform pose noise by its amplitudes."""

    mask: MaskNoise = field(default_factory=MaskNoise)
    rotation_rad: float = 0.0
    translation_m: float = 0.0

    def pose_noise(self, rng: np.random.Generator) -> PoseNoise:
        """For one flight."""
        if self.rotation_rad == 0.0 and self.translation_m == 0.0:
            return NoPoseNoise()
        return UniformPoseNoise(self.rotation_rad, self.translation_m, rng)

    @property
    def model(self) -> NoiseModel:
        """As the bound takes it: variances of the uniform laws, false negatives as frames that show nothing.

        False positives and partial negatives are left out, as for one who knows them: the bound stays a bound.
        """
        return NoiseModel(
            pixel_px=BOX_CENTRE_PX,
            rotation_white_rad=self.rotation_rad / float(np.sqrt(3.0)),
            rotation_about="origin",
            translation_white_m=self.translation_m / float(np.sqrt(3.0)),
            missed=self.mask.false_negative_rate,
        )


_POSE = (float(np.radians(0.5)), 0.1)
NOISES: dict[str, Noise] = {  # cumulative, as in the paper
    "none": Noise(),
    "pose": Noise(MaskNoise(), *_POSE),
    "fp": Noise(MaskNoise(0.1, 0.2, 3), *_POSE),
    "fn": Noise(MaskNoise(0.1, 0.2, 3, 0.1), *_POSE),
    "pfn": Noise(MaskNoise(0.1, 0.2, 3, 0.1, 0.1, 0.2), *_POSE),
}


def paper_scene(step_m: float = 10.0) -> Scene:
    """A cube of 100 m, 2 km ahead, seen on 1000 m of flight; a frame every T_s."""
    return Scene(PAPER_CAMERA, paper_flight(step_m), Box(np.array(PAPER_TARGET_ENU_M)))
