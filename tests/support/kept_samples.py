"""A file's content that the tests of keeping tracks share."""

import numpy as np

from distloc.localizer import Localizer, LocalizerConfig
from distloc.snapshot import LocalizerSnapshot
from service.localise.continuity import Moment
from service.localise.track_store import VERSION, Kept
from tests.support.cube_samples import CAMERA, cube_mask, pose_at


def snapshot(steps: int = 30) -> LocalizerSnapshot:
    """Of a localizer that flew past the cube."""
    located = Localizer(CAMERA, LocalizerConfig(n_particles=400), rng=np.random.default_rng(0))
    for k in range(steps):
        located.step(pose_at(10.0 * k), cube_mask(pose_at(10.0 * k)))
    return located.snapshot()


def kept(**changes: object) -> Kept:
    """One target, at a moment that GPS knew."""
    content = {
        "version": VERSION,
        "vehicle": "drone1",
        "settings": "0123456789abcdef",
        "moment": Moment("boot-1", 5000.0, 700.0, 1_780_000_000.0),
        "origin": (47.4, 8.6, 430.0),
        "camera_enu_m": (290.0, 0.0, 0.0),
        "localizer": snapshot(),
    }
    return Kept(**(content | changes))  # type: ignore[arg-type]
