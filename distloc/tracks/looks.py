"""What a target's segments look like to its track, and so how sure a sighting of it is."""

from collections.abc import Sequence

import numpy as np

from distloc.localizer_config import LocalizerConfig
from distloc.sights.aspect import aim_sigma_rad
from distloc.sights.sight import Sight
from distloc.sights.sights import Expected, Ray, sights_of
from distloc.tracks.scatter import Scatter
from distloc.tracks.segment_sizes import SegmentSizes
from distloc.types import CameraPose, FloatArray, PoseErrors


class Looks:
    """The sizes of its segments and how they stray; a snapshot keeps the sizes (n, 2)."""

    def __init__(self, config: LocalizerConfig, sizes_px: FloatArray | None = None) -> None:
        self.sizes = SegmentSizes() if sizes_px is None else SegmentSizes(sizes_px)
        self._scatter, self._config = Scatter(), config

    def errors(self, pose: CameraPose) -> PoseErrors:
        """The pose's own, else the config's."""
        return pose.errors or self._config.pose_errors

    def sight(self, ray: Ray, range_m: float) -> Sight:
        """A ray as a track that is about so far away takes it."""
        expected = expected_of([self], ray.pose, np.array([range_m]))
        return sights_of([ray], expected, self.errors(ray.pose), self._config.pixel_sigma_px).one(0)

    def scatter(self, pose: CameraPose) -> FloatArray:
        """The variance (2,), right and up in squared tangents, by which segments stray; 0 where that is hidden."""
        return self._scatter.variance if _is_measured(pose) else np.zeros(2)

    def aim_sigma_rad(self, ray: Ray) -> FloatArray:
        """That of the aim's error, right and up (2,)."""
        sigma_rad = aim_sigma_rad(
            (ray.size_px if self.sizes.expected_px is None else self.sizes.expected_px) * ray.px_rad
        )
        # what strays does not do so anew in each frame: as much of it stays for a while
        return np.sqrt(sigma_rad**2 + self._scatter.variance) if _is_measured(ray.pose) else sigma_rad

    def learn(self, ray: Ray, innovation: FloatArray, sight: Sight) -> None:
        """How far a sighting was from what was expected (2,), in tangents."""
        if _is_measured(ray.pose):
            self._scatter.add(innovation, sight.covariance)


def expected_of(looks: Sequence[Looks], pose: CameraPose, range_m: FloatArray) -> Expected:
    """What k tracks, whose targets are about so far away (k,), expect to see from a pose."""
    unknown = np.full(2, np.nan)
    sizes_px = [unknown if one.sizes.expected_px is None else one.sizes.expected_px for one in looks]
    return Expected(range_m, np.array(sizes_px), np.array([one.scatter(pose) for one in looks]))


def _is_measured(pose: CameraPose) -> bool:
    """Whether the scenery tells the attitude: else its own error hides how segments stray."""
    return pose.attitude is not None and pose.attitude.source == "scenery"
