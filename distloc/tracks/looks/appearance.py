"""What a target looks like from one platform's camera: angles, sizes in its pictures, and how they stray."""

import numpy as np

from distloc.sights.sights import Ray
from distloc.snapshot import TrackSnapshot
from distloc.tracks.looks.jitter import Jitter
from distloc.tracks.looks.plume import Middle
from distloc.tracks.looks.scatter import Scatter
from distloc.tracks.looks.segment_sizes import SegmentSizes
from distloc.types import FloatArray, Plume, Root

_LATELY = 0.2  # of what the last sighting says


class Appearance:
    """The sizes of its segments, its root, the smoke over that, and how all of them stray.

    `root_rad` is how wide the root looks, `size_rad` (2,) how wide and high the smoke, of late; None and 0 where nobody
    knows. `camera_enu_m` (3,) is where the camera was when it saw the target last.
    """

    def __init__(self, platform: str, sizes_px: FloatArray | None = None) -> None:
        self.platform = platform
        self.sizes, self.middle = SegmentSizes(sizes_px), Middle()
        self.scatter, self.jitter = Scatter(), Jitter()
        self.root_rad: float | None = None
        self.size_rad, self.camera_enu_m = np.zeros(2), np.zeros(3)

    @classmethod
    def restored(cls, saved: TrackSnapshot) -> "Appearance":
        """It goes on; where the middle of the smoke is the next sighting shows."""
        looks = cls(saved.platform, saved.sizes_px)
        looks.root_rad, looks.size_rad = saved.root_rad or None, saved.looks_rad.copy()
        looks.jitter, looks.camera_enu_m = Jitter(saved.jitter_rad2), saved.aspect.camera_enu_m
        return looks

    def saw(self, ray: Ray, root: Root) -> None:
        """A segment that has a root; of what is cut what is seen: it is no less."""
        self.size_rad += (_LATELY if self.size_rad.any() else 1.0) * (ray.size_px * ray.px_rad - self.size_rad)
        if any(ray.is_cut):
            return
        root_rad = root.width_px * ray.px_rad
        self.root_rad = root_rad if self.root_rad is None else self.root_rad + _LATELY * (root_rad - self.root_rad)
        self.jitter.add(ray, self.root_rad)
        self.middle.add(ray)

    def plume(self, root_enu_m: FloatArray, lean: FloatArray) -> Plume:
        """The smoke over a root at (3,), which leans by (2,) metres east and north for each metre up."""
        return self.middle.plume(root_enu_m, self.camera_enu_m, lean)
