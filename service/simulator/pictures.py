"""Draws what a simulated drone sees into a folder, the camera of who has none; `distloc autopilot` calls it."""

from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np

from distloc.simulation.renderer import Renderer
from service.common.files import write_whole
from service.simulator.scenario import Scenario, camera_pose, plumes

_QUALITY = 90


class PicturesError(Exception):
    """The folder cannot be made: one line that names it."""


def draw_pictures(folder: Path, scenario: Scenario, seed: int, count: int, on_progress: Callable[[int], None]) -> None:
    """The flight's first `count` pictures as JPEG by number, at the scenario's rate; `on_progress` gets how many."""
    try:
        folder.mkdir(parents=True)
    except OSError as error:
        raise PicturesError(f"--pictures {folder}: {error.strerror}: it must be a new folder") from error
    renderer = Renderer(scenario.camera.camera(), plumes(scenario), np.random.default_rng(seed))
    for number in range(count):
        t_s = number / scenario.fps
        image, _ = renderer.render(camera_pose(scenario, t_s, t_s))
        _, jpeg = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, _QUALITY])
        write_whole(folder / f"{number:06d}.jpg", jpeg.tobytes())
        on_progress(number + 1)
