"""What targets' segments look like to their tracks, and so how sure a sighting of one is."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from distloc.filter.particles import Places
from distloc.filter.platforms import Names
from distloc.filter.settings import LocalizerConfig
from distloc.sights.aspect import aim_sigma_rad
from distloc.sights.border import beyond, seen_rad_of
from distloc.sights.sight import Sight, Sights
from distloc.sights.sights import (
    SOMEWHERE_SHARE,
    Expected,
    Ray,
    cuts_of,
    sights_of,
    stands_upright,
)
from distloc.snapshot import TrackSnapshot
from distloc.tracks.looks.borders import Borders
from distloc.tracks.looks.jitter import Jitter
from distloc.tracks.looks.lean import Leans
from distloc.tracks.looks.plume import Middles
from distloc.tracks.looks.scatter import Scatter
from distloc.tracks.looks.segment_sizes import SegmentSizes
from distloc.tracks.motion.fit import Appearance
from distloc.types import CameraPose, FloatArray, PoseErrors

_TELLS_NOTHING = 10.0  # standard deviations for one
# of a root's width: how far its middle is off, the same way for a while; and while the compass hides most of that
_ROOT_SHARE, _ROOT_SHARE_HIDDEN = 0.12, 0.04
_LATELY, _LASTING = 0.2, 0.02  # of what the last sighting says; of one that is smaller than before, as puffs are


class Looks:
    """Of the targets at all places of the bank what each platform's pictures show, and how their smoke leans.

    A row is what one platform sees of one target: `own` (places,) are the rows of the platforms that look now, `latest`
    of those that saw the targets last. `root_rad` (rows,) is how wide the root looks, of late, and `size_rad` (rows, 2)
    how wide and high the smoke; NaN and 0 where nobody knows. `camera_enu_m` (rows, 3) is from where that was.
    """

    def __init__(self, places: int, names: Names, config: LocalizerConfig) -> None:
        self._platforms, self._names, self._config, self.aim = config.platforms, names, config, config.aim
        rows = places * self._platforms
        self.own = np.arange(places) * self._platforms
        self.latest = self.own.copy()
        self.is_seen, self.camera_enu_m = np.zeros(rows, np.bool_), np.zeros((rows, 3))
        self.root_rad, self.size_rad = np.full(rows, np.nan), np.zeros((rows, 2))
        self.sizes, self.scatters, self.jitter = SegmentSizes(rows), Scatter(rows), Jitter(rows)
        self.middles, self.leans, self.borders = Middles(rows), Leans(places), Borders(rows)

    def board(self, places: Places, platform: str) -> None:
        """From now on it is this platform's camera that looks at these targets."""
        self.own[places] = places * self._platforms + self._number(platform)

    def clear(self, place: int) -> None:
        """A new target, which nobody has seen."""
        rows = slice(place * self._platforms, (place + 1) * self._platforms)
        self.latest[place] = self.own[place]
        self.is_seen[rows], self.root_rad[rows], self.size_rad[rows] = False, np.nan, 0.0
        for one in (self.sizes, self.scatters, self.jitter, self.middles, self.borders):
            one.clear(rows)
        self.leans.clear(place)

    def restore(self, place: int, saved: TrackSnapshot) -> None:
        """Go on from what the platform saw that saw it last; the middle of the smoke shows anew."""
        self.clear(place)
        row = self.latest[place] = place * self._platforms + self._number(saved.platform)
        self.is_seen[row], self.camera_enu_m[row] = True, saved.aspect.camera_enu_m
        self.root_rad[row], self.size_rad[row] = saved.root_rad or np.nan, saved.looks_rad
        self.sizes.restore(row, saved.sizes_px)
        self.jitter.restore(row, saved.jitter_rad2)
        self.leans.restore(place, saved.lean_information, saved.lean, saved.filter.stamp_s)

    def platform(self, place: int) -> str:
        """The platform that looks now at a target."""
        return self._names.name(int(self.own[place]) % self._platforms)

    def seen_last_by(self, place: int) -> str:
        """The platform that saw a target last."""
        return self._names.name(int(self.latest[place]) % self._platforms)

    def errors(self, pose: CameraPose) -> PoseErrors:
        """The pose's own, else the config's."""
        return pose.errors or self._config.pose_errors

    def expected(self, places: Places, pose: CameraPose, range_m: FloatArray) -> Expected:
        """What is expected to be seen from a pose of targets that are about so far away (k,)."""
        rows = self.own[places]
        border_rad = self.borders.known_rad(rows, self.root_rad[rows])
        return Expected(range_m, self.sizes.expected_px[rows], self.scatter(places, pose), border_rad)

    def found(self, rays: Sequence[Ray], expected: Expected) -> Sights:
        """The sights of k rays of one frame as tracks that expect that may find them, what the border cuts in."""
        whole = sights_of(rays, expected, self.errors(rays[0].pose), self._config.pixel_sigma_px)
        along, across_rad = cuts_of(rays, expected.size_px)
        covariance = whole.covariance + along
        covariance[:, [0, 1], [0, 1]] += np.square(across_rad)
        covariance[:, 0, 0] += np.square(hidden_rad(rays, expected.border_rad))
        return replace(whole, covariance=covariance)

    def measured(self, rays: Sequence[Ray], expected: Expected) -> Sights:
        """What they tell: nothing of how far they go on beyond the border, for that is off the same way for long."""
        whole = sights_of(rays, expected, self.errors(rays[0].pose), self._config.pixel_sigma_px)
        along, _ = cuts_of(rays, expected.size_px)
        return replace(whole, covariance=whole.covariance + _TELLS_NOTHING**2 * along)

    def appearance(self, places: Places) -> Appearance:
        """How high the targets look, and how they lean."""
        return Appearance(self.size_rad[self.latest[places], 1], *self.leans.pictures(places))

    def scatter(self, places: Places, pose: CameraPose) -> FloatArray:
        """The variances (k, 2), right and up in squared tangents, by which segments stray, and roots jump about."""
        rows = self.own[places]
        jumps = self.jitter.variance[rows]
        return self.scatters.variance(rows) + jumps if _is_measured(pose) else jumps

    def cut_sigma_rad(self, places: Places, rays: Sequence[Ray]) -> FloatArray:
        """That of what the border cuts across its own axis, and of what a side hides, right and up (k, 2)."""
        rows = self.own[places]
        across_rad = cuts_of(rays, self.sizes.expected_px[rows])[1]
        known_rad = self.borders.known_rad(rows, self.root_rad[rows])
        across_rad[:, 0] = np.hypot(across_rad[:, 0], hidden_rad(rays, known_rad))
        return across_rad

    def aim_sigma_rad(self, places: Places, rays: Sequence[Ray]) -> FloatArray:
        """That of the aims' errors, right and up (k, 2)."""
        rows, px_rad = self.own[places], np.array([ray.px_rad for ray in rays])
        is_measured = _is_measured(rays[0].pose)
        expected_px, root_rad = self.sizes.expected_px[rows], self.root_rad[rows]
        sizes_px = np.where(np.isnan(expected_px), np.array([ray.size_px for ray in rays]), expected_px)
        sigma_rad = aim_sigma_rad(sizes_px * px_rad[:, None])
        if self.aim == "base":
            is_rooted = np.array([ray.detection.root is not None for ray in rays])[:, None]
            first_rad = np.array([ray.aim_px[0] for ray in rays]) * px_rad
            root_rad = np.where(np.isnan(root_rad), first_rad, root_rad)[:, None]
            share = _ROOT_SHARE if is_measured else _ROOT_SHARE_HIDDEN
            strays = share * root_rad + np.sqrt(self.jitter.variance[rows])
            sigma_rad = np.where(is_rooted, np.hypot(aim_sigma_rad(root_rad), strays), sigma_rad)
            if not stands_upright(rays[0].pose):  # the fire is somewhere in it
                sigma_rad = np.maximum(sigma_rad, SOMEWHERE_SHARE * sizes_px * px_rad[:, None])
        # what strays does not do so anew in each frame: as much of it stays for a while
        return np.sqrt(sigma_rad**2 + self.scatters.variance(rows)) if is_measured else sigma_rad

    def saw(self, places: Places, rays: Sequence[Ray], is_joined: Sequence[bool]) -> None:
        """Sightings of one frame. The size of joined pieces is not learnt: two fires could go apart as one."""
        rows = self.own[places]
        self.latest[places], self.is_seen[rows], self.camera_enu_m[rows] = rows, True, rays[0].pose.position_enu_m
        sizes_px = np.array([ray.size_px for ray in rays])
        if self.aim == "base":
            is_rooted = np.array([ray.detection.root is not None for ray in rays])
            self._saw_smoke(rows[is_rooted], sizes_px[is_rooted], [ray for ray in rays if ray.detection.root])
            is_whole = [ray.detection.root is not None and not any(ray.is_cut) for ray in rays]
            is_sided = [ray.border is not None for ray in rays]
            if any(is_sided):
                px_rad = np.array([ray.px_rad for ray in rays])
                self.borders.add(rows[is_sided], seen_rad_of([ray.border for ray in rays], px_rad)[is_sided])
            self._saw_roots(places[is_whole], [ray for ray, is_so in zip(rays, is_whole, strict=True) if is_so])
        details = [(ray.detection, joined) for ray, joined in zip(rays, is_joined, strict=True)]
        is_sized = [not (one.touches_border or one.is_point or joined) for one, joined in details]
        self.sizes.add(rows[is_sized], sizes_px[is_sized])

    def learn(self, places: Places, rays: Sequence[Ray], innovation: FloatArray, sights: Sequence[Sight]) -> None:
        """How far sightings were from what was expected (k, 2), in tangents."""
        if not _is_measured(rays[0].pose):
            return
        is_whole = [not any(ray.is_cut) for ray in rays]
        white = np.array([one.covariance for one in sights])
        self.scatters.add(self.own[places][is_whole], innovation[is_whole], white[is_whole])

    def _number(self, platform: str) -> int:
        return self._names.number(platform) if self._platforms > 1 else 0

    def _saw_smoke(self, rows: NDArray[np.intp], sizes_px: FloatArray, rays: Sequence[Ray]) -> None:
        """How large it looks; of what is cut what is seen: it is no less."""
        before, px_rad = self.size_rad[rows], np.array([ray.px_rad for ray in rays])
        size_rad = sizes_px * px_rad[:, None]
        share = np.where(size_rad > before, _LATELY, _LASTING)
        share[~before.any(axis=1)] = 1.0
        self.size_rad[rows] = before + share * (size_rad - before)

    def _saw_roots(self, places: Places, rays: Sequence[Ray]) -> None:
        """Roots that are whole."""
        if not rays:
            return
        rows, before = self.own[places], self.root_rad[self.own[places]]
        root_rad = np.array([ray.aim_px[0] * ray.px_rad for ray in rays])
        root_rad = np.where(np.isnan(before), root_rad, before + _LATELY * (root_rad - before))
        self.root_rad[rows] = root_rad
        axes, by_pixel = np.array([ray.axes for ray in rays]), np.array([ray.by_pixel for ray in rays])
        seen = [ray.detection for ray in rays]
        off_px = np.array([one.base_px for one in seen]) - np.array([one.centre_px for one in seen])
        off = (by_pixel @ off_px[:, :, None])[:, :, 0]
        is_cut = np.array([one.is_cut if one.touches_border else (False, False) for one in seen])
        self.jitter.add(rows, off, root_rad, is_cut)
        self.leans.add(places, rays[0].pose.stamp_s, axes[:, 0], np.array([ray.lean for ray in rays]))
        self.middles.add(rows, -off, axes)


def hidden_rad(rays: Sequence[Ray], known_rad: FloatArray) -> FloatArray:
    """One standard deviation (k,) of how far beyond the border the middles of roots are that a side cuts, else 0."""
    return beyond([ray.border for ray in rays], np.array([ray.px_rad for ray in rays]), known_rad)[1]


def _is_measured(pose: CameraPose) -> bool:
    """Whether the scenery tells the attitude: else its own error hides how segments stray."""
    return pose.attitude is not None and pose.attitude.source == "scenery"
