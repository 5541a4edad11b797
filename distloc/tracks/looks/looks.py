"""What a target's segments look like to its track, and so how sure a sighting of it is."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from distloc.localizer_config import LocalizerConfig
from distloc.sights.aspect import aim_sigma_rad
from distloc.sights.sight import Sight, Sights
from distloc.sights.sights import Expected, Ray, cut_of, cuts_of, sights_of
from distloc.tracks.looks.jitter import Jitter
from distloc.tracks.looks.lean import Lean, pictures_of
from distloc.tracks.looks.plume import Middle
from distloc.tracks.looks.scatter import Scatter
from distloc.tracks.looks.segment_sizes import SegmentSizes
from distloc.tracks.motion.fit import Appearance
from distloc.types import CameraPose, FloatArray, PoseErrors

_TELLS_NOTHING = 10.0  # standard deviations for one
# of a root's width: how far its middle is off, the same way for a while; and while the compass hides most of that
_ROOT_SHARE, _ROOT_SHARE_HIDDEN = 0.12, 0.04
_LATELY, _LASTING = 0.2, 0.02  # of what the last sighting says; of one that is smaller than before, as puffs are


class Looks:
    """The sizes of its segments and how they stray; a snapshot keeps the sizes (n, 2)."""

    def __init__(self, config: LocalizerConfig, sizes_px: FloatArray | None = None) -> None:
        self.sizes = SegmentSizes() if sizes_px is None else SegmentSizes(sizes_px)
        self.root_rad: float | None = None  # how wide its root looks, of late
        self.size_rad = np.zeros(2)  # how wide and high the smoke, of late; 0 where nobody knows
        self.lean, self.middle = Lean(), Middle()
        self._scatter, self.jitter, self._config = Scatter(), Jitter(), config

    def errors(self, pose: CameraPose) -> PoseErrors:
        """The pose's own, else the config's."""
        return pose.errors or self._config.pose_errors

    def sight(self, ray: Ray, range_m: float) -> Sight:
        """A ray as a track that is about so far away may find it."""
        expected = expected_of([self], ray.pose, np.array([range_m]))
        return found_of([ray], expected, self.errors(ray.pose), self._config.pixel_sigma_px).one(0)

    def measured(self, ray: Ray, range_m: float) -> Sight:
        """What a ray tells: nothing of how far it goes on beyond the border, for that is off the same way for long."""
        expected = expected_of([self], ray.pose, np.array([range_m]))
        whole = sights_of([ray], expected, self.errors(ray.pose), self._config.pixel_sigma_px).one(0)
        along, _ = cut_of(ray, self.sizes.expected_px)
        return replace(whole, covariance=whole.covariance + _TELLS_NOTHING**2 * along)

    def cut_sigma_rad(self, ray: Ray) -> FloatArray:
        """That of what the border cuts across its own axis, right and up (2,)."""
        return cut_of(ray, self.sizes.expected_px)[1]

    def scatter(self, pose: CameraPose) -> FloatArray:
        """The variance (2,), right and up in squared tangents, by which segments stray, and roots jump about."""
        strays = self._scatter.variance if _is_measured(pose) else np.zeros(2)
        return strays + self.jitter.variance

    def aim_sigma_rad(self, ray: Ray) -> FloatArray:
        """That of the aim's error, right and up (2,)."""
        if self._config.aim == "base" and ray.detection.root is not None:
            root_rad = np.full(2, ray.aim_px[0] * ray.px_rad if self.root_rad is None else self.root_rad)
            share = _ROOT_SHARE if _is_measured(ray.pose) else _ROOT_SHARE_HIDDEN
            strays = share * root_rad + np.sqrt(self.jitter.variance)
            sigma_rad = np.hypot(aim_sigma_rad(root_rad), strays)
        else:
            size_px = ray.size_px if self.sizes.expected_px is None else self.sizes.expected_px
            sigma_rad = aim_sigma_rad(size_px * ray.px_rad)
        # what strays does not do so anew in each frame: as much of it stays for a while
        return np.sqrt(sigma_rad**2 + self._scatter.variance) if _is_measured(ray.pose) else sigma_rad

    def saw(self, ray: Ray) -> None:
        """How wide the root is, and how the smoke leans over it."""
        root = ray.detection.root
        if self._config.aim != "base" or root is None:
            return
        # of what is cut what is seen: it is no less
        size_rad = ray.size_px * ray.px_rad
        share = np.where(size_rad > self.size_rad, _LATELY, _LASTING) if self.size_rad.any() else 1.0
        self.size_rad += share * (size_rad - self.size_rad)
        if any(ray.is_cut):
            return
        root_rad = root.width_px * ray.px_rad
        self.root_rad = root_rad if self.root_rad is None else self.root_rad + _LATELY * (root_rad - self.root_rad)
        self.jitter.add(ray, self.root_rad)
        self.lean.add(ray)
        self.middle.add(ray)

    def learn(self, ray: Ray, innovation: FloatArray, sight: Sight) -> None:
        """How far a sighting was from what was expected (2,), in tangents."""
        if _is_measured(ray.pose) and not any(ray.is_cut):
            self._scatter.add(innovation, sight.covariance)


def expected_of(looks: Sequence[Looks], pose: CameraPose, range_m: FloatArray) -> Expected:
    """What k tracks, whose targets are about so far away (k,), expect to see from a pose."""
    unknown = np.full(2, np.nan)
    sizes_px = [unknown if one.sizes.expected_px is None else one.sizes.expected_px for one in looks]
    return Expected(range_m, np.array(sizes_px), np.array([one.scatter(pose) for one in looks]))


def found_of(rays: Sequence[Ray], expected: Expected, errors: PoseErrors, pixel_sigma_px: float) -> Sights:
    """The sights of k rays of one frame as a track each may find them, what the border cuts in."""
    whole = sights_of(rays, expected, errors, pixel_sigma_px)
    along, across_rad = cuts_of(rays, expected.size_px)
    covariance = whole.covariance + along
    covariance[:, [0, 1], [0, 1]] += np.square(across_rad)
    return replace(whole, covariance=covariance)


def appearance_of(looks: Sequence[Looks]) -> Appearance:
    """How high k targets look, and how they lean."""
    information, weighed = pictures_of([one.lean for one in looks])
    return Appearance(np.array([one.size_rad[1] for one in looks]), information, weighed)


def _is_measured(pose: CameraPose) -> bool:
    """Whether the scenery tells the attitude: else its own error hides how segments stray."""
    return pose.attitude is not None and pose.attitude.source == "scenery"
