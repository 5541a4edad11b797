"""Smoke as the stages and the service see it: up to four plumes about 2 km west of the simulated flight."""

import cv2
import numpy as np
from numpy.typing import NDArray

from distloc.geometry.camera import Camera
from distloc.simulation.targets import DriftingPlume
from distloc.types import CameraPose
from service.simulator.scenario import PlumeSection, Scenario, camera_pose, plumes

PLUMES = tuple(
    PlumeSection(east_m=-2000.0, north_m=north_m, height_m=220.0, width_m=90.0) for north_m in (300, 750, 1200, 1650)
)
_SPECKS = 2000


def flight_past(number: int) -> Scenario:
    """The path of the built-in scenario "straight" past the first `number` plumes; they stay in view for 30 s."""
    return Scenario(targets=PLUMES[:number])


def true_mask(scenario: Scenario, camera: Camera, pose: CameraPose) -> NDArray[np.uint8]:
    """What a perfect segmenter gives (h, w), 0 or 255."""
    mask = np.zeros((camera.height, camera.width), np.uint8)
    for plume in plumes(scenario):
        DriftingPlume(plume).draw(mask, camera, pose)
    return mask


def camera_of(width: int, height: int) -> Camera:
    """The demo's field of view across."""
    return Camera(width, height, 900.0 * width / 1280, 900.0 * width / 1280, width / 2, height / 2)


def plumes_mask(width: int, height: int, number: int = 4) -> NDArray[np.uint8]:
    """Plumes in a frame of this size."""
    scenario = flight_past(number)
    return true_mask(scenario, camera_of(width, height), camera_pose(scenario, 0.0, 0.0))


def specks_mask(width: int, height: int) -> NDArray[np.uint8]:
    """2000 specks of a few pixels: a segmenter gone wrong."""
    rng = np.random.default_rng(0)
    mask = np.zeros((height, width), np.uint8)
    for u, v in zip(rng.integers(4, width - 4, _SPECKS), rng.integers(4, height - 4, _SPECKS), strict=True):
        cv2.circle(mask, (int(u), int(v)), 2, 255, -1)
    return mask


def half_mask(width: int, height: int) -> NDArray[np.uint8]:
    """Half of the frame."""
    mask = np.zeros((height, width), np.uint8)
    mask[height // 4 : 3 * height // 4] = 255
    return mask
