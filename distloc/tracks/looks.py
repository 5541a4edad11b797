"""What a target's segments look like to its track, and so how sure a sighting of it is."""

from dataclasses import replace

import numpy as np

from distloc.localizer_config import LocalizerConfig
from distloc.sights.aspect import aim_sigma_rad
from distloc.sights.sight import Sight
from distloc.sights.sights import Ray, cut_of, sight_of
from distloc.tracks.scatter import Scatter
from distloc.tracks.segment_sizes import SegmentSizes
from distloc.types import CameraPose, FloatArray, PoseErrors

_TELLS_NOTHING = 10.0  # standard deviations for one


class Looks:
    """The sizes of its segments and how they stray; a snapshot keeps the sizes (n, 2)."""

    def __init__(self, config: LocalizerConfig, sizes_px: FloatArray | None = None) -> None:
        self.sizes = SegmentSizes() if sizes_px is None else SegmentSizes(sizes_px)
        self._scatter, self._config = Scatter(), config

    def errors(self, pose: CameraPose) -> PoseErrors:
        """The pose's own, else the config's."""
        return pose.errors or self._config.pose_errors

    def sight(self, ray: Ray, range_m: float) -> Sight:
        """A ray as a track that is about so far away may find it."""
        along, across_rad = cut_of(ray, self.sizes.expected_px)
        sight = self._whole(ray, range_m)
        return replace(sight, covariance=sight.covariance + along + np.diag(np.square(across_rad)))

    def measured(self, ray: Ray, range_m: float) -> Sight:
        """What a ray tells: nothing of how far it goes on beyond the border, for that is off the same way for long."""
        along, _ = cut_of(ray, self.sizes.expected_px)
        sight = self._whole(ray, range_m)
        return replace(sight, covariance=sight.covariance + _TELLS_NOTHING**2 * along)

    def cut_sigma_rad(self, ray: Ray) -> FloatArray:
        """That of what the border cuts across its own axis, right and up (2,)."""
        return cut_of(ray, self.sizes.expected_px)[1]

    def _whole(self, ray: Ray, range_m: float) -> Sight:
        expected_px, pixel_sigma_px = self.sizes.expected_px, self._config.pixel_sigma_px
        sight = sight_of(ray, self.errors(ray.pose), pixel_sigma_px, range_m, expected_px)
        if not _is_measured(ray.pose):
            return sight
        return replace(sight, covariance=sight.covariance + np.diag(self._scatter.variance))

    def aim_sigma_rad(self, ray: Ray) -> FloatArray:
        """That of the aim's error, right and up (2,)."""
        sigma_rad = aim_sigma_rad(
            (ray.size_px if self.sizes.expected_px is None else self.sizes.expected_px) * ray.px_rad
        )
        # what strays does not do so anew in each frame: as much of it stays for a while
        return np.sqrt(sigma_rad**2 + self._scatter.variance) if _is_measured(ray.pose) else sigma_rad

    def learn(self, ray: Ray, innovation: FloatArray, sight: Sight) -> None:
        """How far a sighting was from what was expected (2,), in tangents."""
        if _is_measured(ray.pose) and not any(ray.is_cut):
            self._scatter.add(innovation, sight.covariance)


def _is_measured(pose: CameraPose) -> bool:
    """Whether the scenery tells the attitude: else its own error hides how segments stray."""
    return pose.attitude is not None and pose.attitude.source == "scenery"
