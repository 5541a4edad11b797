"""What a target's segments look like to its track, and so how sure a sighting of it is."""

from dataclasses import replace

import numpy as np

from distloc.localizer_config import LocalizerConfig
from distloc.sights.aspect import aim_sigma_rad
from distloc.sights.sight import Sight
from distloc.sights.sights import Ray, cut_sigma_rad, sight_of
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
        expected_px, pixel_sigma_px = self.sizes.expected_px, self._config.pixel_sigma_px
        sight = sight_of(ray, self.errors(ray.pose), pixel_sigma_px, range_m, expected_px)
        if not _is_measured(ray.pose):
            return sight
        return replace(sight, covariance=sight.covariance + np.diag(self._scatter.variance))

    def cut_sigma_rad(self, ray: Ray) -> FloatArray:
        """That of where it goes on beyond the image's border, right and up (2,)."""
        return cut_sigma_rad(ray, self.sizes.expected_px)

    def expected_sight(self, ray: Ray, range_m: float) -> Sight:
        """The same as one may find it who does not yet know that the border cuts it."""
        sight = self.sight(ray, range_m)
        return replace(sight, covariance=sight.covariance + np.diag(np.square(self.cut_sigma_rad(ray))))

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
