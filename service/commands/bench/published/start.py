"""Where every published filter's particles start, so that steps are compared and not starts."""

import numpy as np

from distloc.study.scenes import PAPER_CAMERA
from distloc.types import FloatArray
from service.commands.bench.scene import Seen

_RANGE_M = (50.0, 30_000.0)


def spread_along(seen: Seen, n_particles: int, rng: np.random.Generator) -> FloatArray:
    """The common start (3, N): uniform in range along the ray of the first segment's centre."""
    ray_cam = PAPER_CAMERA.rays(seen.centre_px.reshape(2, 1))[:, 0]
    ray_enu = seen.pose.R_cam_from_enu.T @ ray_cam
    return np.asarray(seen.pose.position_enu_m[:, None] + ray_enu[:, None] * rng.uniform(*_RANGE_M, n_particles))
