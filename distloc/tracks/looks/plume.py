"""The smoke over a root as a thing of its own: where its middle is, and how it leans; the estimate brings it."""

import math

import numpy as np

from distloc.sights.sights import Ray
from distloc.types import FloatArray, Plume

_LATELY = 0.2  # of what the last sighting says


class Middle:
    """Where the middle of a segment is off its root, in metres east, north and up for each metre of distance (3,)."""

    def __init__(self) -> None:
        self._off: FloatArray | None = None

    def add(self, ray: Ray) -> None:
        """A sighting's, as much of it as is seen."""
        detection = ray.detection
        right_up = ray.by_pixel @ (detection.centre_px - detection.base_px)
        off = right_up @ ray.axes[:2]
        self._off = off if self._off is None else self._off + _LATELY * (off - self._off)

    def plume(self, root_enu_m: FloatArray, camera_enu_m: FloatArray, lean: FloatArray) -> Plume:
        """Of a root at (3,). Along the line of sight only the lean (2,) tells, metres east and north for each up."""
        along = root_enu_m - camera_enu_m
        range_m = float(np.linalg.norm(along))
        off_m = range_m * (np.zeros(3) if self._off is None else self._off)
        level = along[:2] / max(float(np.hypot(*along[:2])), 1.0)
        off_m[:2] += (float(lean @ level) * max(float(off_m[2]), 0.0) - float(off_m[:2] @ level)) * level
        east, north = lean.tolist()
        return Plume(root_enu_m + off_m, math.atan(math.hypot(east, north)), math.atan2(east, north) % (2.0 * math.pi))
