"""Draws what a scenario's camera sees, in its landscape and with its faults; each simulated camera has one."""

import cv2
import numpy as np
from numpy.typing import NDArray

from distloc.geometry.camera import Camera
from distloc.simulation.landscape.renderer import LandscapeRenderer
from distloc.simulation.landscape.scenes import SCENES
from distloc.simulation.landscape.sensor import CameraFaults, compressed
from distloc.simulation.renderer import Renderer
from distloc.types import CameraPose
from service.simulator.scenario import FaultSection, Scenario, camera_pose, plumes

Image = NDArray[np.uint8]


class DrawnScene:
    """The scene of a scenario, fixed by `rng`; `camera` in place of the scenario's draws it at another size."""

    def __init__(self, scenario: Scenario, rng: np.random.Generator, camera: Camera | None = None) -> None:
        self._scenario, self._faults = scenario, faults_of(scenario.camera_faults)
        camera = camera or scenario.camera.camera()
        self._flat = self._hilly = None
        if scenario.landscape == "flat" and not self._faults.is_moving:
            self._flat = Renderer(camera, plumes(scenario), rng)
        else:
            self._hilly = LandscapeRenderer(camera, plumes(scenario), rng, SCENES[scenario.landscape], self._faults)

    def at(self, t_s: float) -> tuple[Image, Image]:
        """The image (H, W, 3) and the smoke's mask (H, W) `t_s` after take-off, before JPEG."""
        pose = self._pose(t_s)
        if self._hilly is not None:
            return self._hilly.render(pose, self._pose)
        assert self._flat is not None
        return self._flat.render(pose)

    def seen_at(self, t_s: float) -> Image:
        """The image as the camera gives it: after JPEG where the scenario has a quality."""
        return compressed(self.at(t_s)[0], self._faults.jpeg_quality)

    def jpeg(self, image: Image, quality: int) -> bytes:
        """An image as JPEG, with the scenario's quality where it has one."""
        wanted = quality if self._faults.jpeg_quality is None else self._faults.jpeg_quality
        return cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, wanted])[1].tobytes()

    def _pose(self, t_s: float) -> CameraPose:
        return camera_pose(self._scenario, t_s, t_s)


def faults_of(section: FaultSection) -> CameraFaults:
    """The section in the renderer's units."""
    return CameraFaults(section.readout_ms * 1e-3, section.exposure_ms * 1e-3, section.jpeg_quality)
