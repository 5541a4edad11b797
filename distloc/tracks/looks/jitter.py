"""How a root's middle jumps about from one frame to the next, as its place in the segment shows; its track has one."""

import numpy as np

from distloc.sights.sights import Ray
from distloc.types import FloatArray

_AT_FIRST = 0.1  # of its width: smoke in puffs
_SHARE, _AS_MANY = 0.1, 2  # of what the last sighting says; the first guess counts as so many


class Jitter:
    """The variance (2,) of one frame's, right and up in squared tangents."""

    def __init__(self, variance: FloatArray | None = None) -> None:
        self.variance = np.zeros(2) if variance is None else variance
        self._count = 0 if variance is None else round(1.0 / _SHARE)
        self._off: FloatArray | None = None

    def add(self, ray: Ray, root_rad: float) -> None:
        """A segment whose root looks so wide; an axis that the border cuts goes by the other."""
        detection = ray.detection
        off = ray.by_pixel @ (detection.base_px - detection.centre_px)
        if self._count == 0 and self._off is None:
            self.variance = np.full(2, (_AT_FIRST * root_rad) ** 2)
        elif self._off is not None:
            self._count += 1
            share = max(_SHARE, 1.0 / (self._count + _AS_MANY))
            jumped = np.square(off - self._off) / 2.0
            if detection.touches_border and detection.is_cut[0] != detection.is_cut[1]:
                jumped[:] = jumped[1 if detection.is_cut[0] else 0]
            if not detection.touches_border or not all(detection.is_cut):
                self.variance = self.variance + share * (jumped - self.variance)
        self._off = off
