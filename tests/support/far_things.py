"""Things so far that no flight shows how far, in fixed directions, and a fire: as detections, a step a second."""

import numpy as np

from distloc.localizer import Localizer, LocalizerConfig
from distloc.types import CameraPose, Detection, FloatArray, TargetEstimate
from tests.support.cube_samples import CAMERA, R_NORTH

FIRE_ENU_M: FloatArray = np.array([500.0, 2000.0, 0.0])
_NOISE_PX = 0.5


def seen_at(pixel: FloatArray, size_px: FloatArray) -> Detection:
    """A box of a size (2,) about a pixel (2,)."""
    (u, v), (width, height) = pixel.tolist(), size_px.tolist()
    return Detection(
        centre_px=np.array([u, v]),
        base_px=np.array([u, v + height / 2.0]),
        covariance_px2=np.diag(np.square(size_px) / 12.0),
        area_px=width * height,
        width_px=width,
        height_px=height,
        sigma_px=0.3 + 0.02 * float(np.hypot(width, height)),
        touches_border=False,
    )


class FarThings:
    """So many before a camera that looks north and flies east at 10 m/s, 100 m up; a localizer that sees them."""

    def __init__(self, count: int, max_targets: int, seed: int = 0) -> None:
        self.rng = np.random.default_rng(seed)
        config = LocalizerConfig(n_particles=1024, max_targets=max_targets)
        self.localizer = Localizer(CAMERA, config, rng=np.random.default_rng(1000 + seed))
        self.count, self.steps = count, 0
        self._pixels, self._sizes_px = self._anywhere(480.0)

    def step(self, has_fire: bool) -> list[TargetEstimate]:
        """The next one, with the far things."""
        noise = self.rng.normal(0.0, _NOISE_PX, (self.count, 2))
        return self._step(list(map(seen_at, self._pixels + noise, self._sizes_px)), has_fire)

    def step_in_clutter(self, has_fire: bool) -> list[TargetEstimate]:
        """The next one, with as many segments that are elsewhere each time."""
        return self._step(list(map(seen_at, *self._anywhere(1000.0))), has_fire)

    def _anywhere(self, lowest_px: float) -> tuple[FloatArray, FloatArray]:
        pixels = self.rng.uniform((60.0, 60.0), (1860.0, lowest_px), (self.count, 2))
        return pixels, self.rng.uniform(10.0, 40.0, (self.count, 2))

    def _step(self, detections: list[Detection], has_fire: bool) -> list[TargetEstimate]:
        pose = CameraPose(float(self.steps), np.array([10.0 * self.steps, 0.0, 100.0]), R_NORTH)
        self.steps += 1
        if has_fire:
            pixels, _ = CAMERA.project((R_NORTH @ (FIRE_ENU_M - pose.position_enu_m))[:, None])
            pixel = pixels[:, 0] + self.rng.normal(0.0, _NOISE_PX, 2)
            detections.append(seen_at(pixel, np.array([30.0, 40.0])))
        return self.localizer.step_detections(pose, detections)


def is_fire(one: TargetEstimate) -> bool:
    """Whether it lies where the fire is, to a third of the range."""
    return float(np.hypot(*(one.position_enu_m - FIRE_ENU_M)[:2])) < 700.0
