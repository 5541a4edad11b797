"""Draws what a simulated drone sees into a folder, the camera of who has none; `distloc autopilot` calls it."""

from collections.abc import Callable
from pathlib import Path

import numpy as np

from service.common.files import write_whole
from service.simulator.drawn_scene import DrawnScene
from service.simulator.scenario import Scenario

_QUALITY = 90


class PicturesError(Exception):
    """The folder cannot be made: one line that names it."""


def draw_pictures(folder: Path, scenario: Scenario, seed: int, count: int, on_progress: Callable[[int], None]) -> None:
    """The flight's first `count` pictures as JPEG by number, at the scenario's rate; `on_progress` gets how many."""
    try:
        folder.mkdir(parents=True)
    except OSError as error:
        raise PicturesError(f"--pictures {folder}: {error.strerror}: it must be a new folder") from error
    scene = DrawnScene(scenario, np.random.default_rng(seed))
    for number in range(count):
        image, _ = scene.at(number / scenario.fps)
        write_whole(folder / f"{number:06d}.jpg", scene.jpeg(image, _QUALITY))
        on_progress(number + 1)
