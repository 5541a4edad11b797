"""What a track's sightings tell of its target: a filter, what it looks like, from where it was seen, how it moves."""

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import replace
from enum import Enum, auto

import numpy as np

from distloc.filter.calibrated_filter import CalibratedFilter
from distloc.filter.settings import LocalizerConfig
from distloc.filter.start import Prior
from distloc.filter.turning import ViewsByPlatform
from distloc.sights.sight import Sight
from distloc.sights.sights import Expected, Ray, axes_along
from distloc.snapshot import AspectSnapshot, TrackSnapshot
from distloc.tracks.life import CONFIRM_WINDOW
from distloc.tracks.looks.aim_error import AimErrors
from distloc.tracks.looks.looks import hidden_rad
from distloc.tracks.memory import Memory
from distloc.tracks.motion.motion import Motion
from distloc.types import AttitudeError, CameraPose, Extent

_MOST_INNOVATION = 5.0  # mean of 12 squared innovations of 2 degrees of freedom; more in 1 of 10,000 by chance
_START_RANGE_M = 1000.0  # about how far something new is, for what the position's error moves


class Outcome(Enum):
    """What a sighting comes to: the filter is yet to weigh it, or has, with all that is remembered."""

    TO_WEIGH = auto()
    RENEWED = auto()
    CONTRADICTED = auto()  # what was believed before, and so it is renewed


class Belief:
    """Starts from one detection. Two tracks of one target may exchange theirs.

    It sees its last frames anew where it must have been wrong: while it is young and its segments turn out to be parts
    of larger ones, and whenever the innovations are larger than its filter allows.
    """

    def __init__(
        self, filter_: CalibratedFilter, prior: Prior | None, config: LocalizerConfig, aims: AimErrors
    ) -> None:
        self.filter, self.place, self.looks, self.memory = filter_, filter_.place, aims.looks, Memory()
        self.views, self.motion, self.extent = ViewsByPlatform(), Motion(), Extent(0.0, 0.0, 0.0, 0.0)
        self._config, self._prior, self._aims, self._places = config, prior, aims, np.array([filter_.place])
        self._innovations: deque[float] = deque(maxlen=CONFIRM_WINDOW)
        self._steps = 0  # that could have shown it
        self._is_to_renew = False  # by the next sighting, from nothing

    @classmethod
    def started(
        cls, filter_: CalibratedFilter, ray: Ray, prior: Prior | None, config: LocalizerConfig, aims: AimErrors
    ) -> "Belief":
        """From a first detection."""
        belief, platform = cls(filter_, prior, config, aims), ray.pose.platform
        filter_.clear(platform)
        aims.clear(belief.place)
        belief.board(platform)
        belief._start(ray, _START_RANGE_M)
        belief.looks.saw(belief._places, [ray], [False])
        belief._saw(ray, _START_RANGE_M)
        return belief

    @classmethod
    def restored(
        cls, filter_: CalibratedFilter, saved: TrackSnapshot, config: LocalizerConfig, aims: AimErrors
    ) -> "Belief":
        """From a snapshot, in other hands. It has no frames left to see anew, so it counts as grown up."""
        camera_enu_m = saved.aspect.camera_enu_m
        place_enu_m = saved.filter.origin_enu_m + saved.filter.positions_m.mean(axis=1, dtype=np.float64)
        along_enu = place_enu_m - camera_enu_m
        axes = axes_along(along_enu[None] / max(float(np.linalg.norm(along_enu)), 1.0))[0]
        filter_.restore(saved.filter, Sight(saved.filter.stamp_s, camera_enu_m, axes, np.eye(2)))
        belief = cls(filter_, None, config, aims)
        aims.restore(belief.place, saved)
        belief.views = ViewsByPlatform(saved.views, saved.platform)
        belief.motion, belief.extent = Motion(saved.bearings, saved.first_s), saved.extent
        belief._steps = CONFIRM_WINDOW + 1
        return belief

    @property
    def aspect(self) -> AspectSnapshot:
        """From where it was seen."""
        return self._aims.snapshot(self.place)

    def range_m(self, pose: CameraPose) -> float:
        """From the camera to the cloud's mean."""
        return math.dist(self.filter.mean_enu_m, pose.position_enu_m)

    def board(self, platform: str) -> None:
        """From now on it is this platform's camera that looks."""
        self.filter.board(platform)
        self.looks.board(self._places, platform)

    def sight(self, ray: Ray) -> Sight:
        """A ray as this track may find it."""
        return self.looks.found([ray], self._expected(ray.pose, self.range_m(ray.pose))).one(0)

    def take(self, ray: Ray, squared: float, is_larger: bool) -> Outcome:
        """A sighting, at a squared distance by the covariance of what is expected, of more than much that was seen."""
        self._innovations.append(squared)
        self._saw(ray, self.range_m(ray.pose))
        if self._is_to_renew or (is_larger and self._steps <= CONFIRM_WINDOW):
            self._is_to_renew = False
            self._see_anew()
            return Outcome.RENEWED
        if self._is_inconsistent():
            self._see_anew()
            return Outcome.CONTRADICTED
        return Outcome.TO_WEIGH

    def missed(self, pose: CameraPose) -> None:
        """A frame that should have shown it and did not."""
        self._steps += 1
        self.memory.add(pose, None, self.range_m(pose))

    def doubt_attitude(self, platform: str, is_measured: bool) -> None:
        """The platform's attitude may have jumped by as much as it is ever wrong.

        Where the scenery's `is_measured` and used instead, only the bearings had the other.
        """
        self.motion.bearings.forget_error(platform)
        if not is_measured:
            self.filter.doubt_attitude()

    def heading_jumped(self, by_rad: float, platform: str, is_measured: bool) -> None:
        """Another error of the platform's heading; frames from before cannot be seen anew with those to come."""
        self.motion.bearings.jumped(by_rad, platform)
        if is_measured:
            return
        self.filter.turn_bias(np.array([0.0, 0.0, -by_rad]))
        self.memory.clear()
        self._innovations.clear()

    def contradicted(self) -> None:
        """A bias that is found now cannot be the filter's: it begins anew."""
        self.memory.clear()
        self._is_to_renew = True

    def grow_up(self, pose: CameraPose) -> None:
        """See the first frames anew by what is known of the segments' sizes now, up to a step's pose.

        One that waited for that knows more than the frames in memory tell.
        """
        if self._steps <= CONFIRM_WINDOW:
            self._see_anew()
            # this camera may be in none of the frames
            self._forget_until(pose, self.memory.since(pose.platform))

    def _saw(self, ray: Ray, range_m: float) -> None:
        self._steps += 1
        errors = self.looks.errors(ray.pose)
        self.memory.add(ray.pose, ray, range_m)
        self.views.add(ray.pose, errors)
        if not ray.is_cut[0] or ray.border is not None:
            told, beyond_rad = (ray, 0.0) if ray.border is None else self._beyond(ray, range_m)
            pixels_rad = math.hypot(ray.sigma_px, self._config.pixel_sigma_px) * ray.px_rad
            jumps_rad = math.sqrt(float(self.looks.scatter(self._places, ray.pose)[0, 0]))
            white_rad = math.hypot(pixels_rad, errors.attitude_white_rad, jumps_rad, beyond_rad)
            self.motion.saw(told, errors, white_rad, self.filter.mean_enu_m)

    def _beyond(self, ray: Ray, range_m: float) -> tuple[Ray, float]:
        """Along the middle of a root that a side cuts, and one standard deviation of what is hidden."""
        expected = self._expected(ray.pose, range_m)
        axes = self.looks.measured([ray], expected).axes[0]
        return replace(ray, axes=axes), float(hidden_rad([ray], expected.border_rad)[0])

    def _expected(self, pose: CameraPose, range_m: float) -> Expected:
        return self.looks.expected(self._places, pose, np.array([range_m]))

    def _is_inconsistent(self) -> bool:
        """Whether the last innovations are together larger than chance makes them (Bar-Shalom et al. 2001, 5.4)."""
        held = len(self._innovations)
        return held == CONFIRM_WINDOW and sum(self._innovations) > _MOST_INNOVATION * held

    def _see_anew(self) -> None:
        """Start the filter from the frames in memory, the first sighting first."""
        frames, filter_, platform = self.memory.from_first_sighting(), self.filter, self.looks.platform(self.place)
        self.views = ViewsByPlatform()
        for number, frame in enumerate(frames):
            self.board(frame.pose.platform)
            ray = frame.ray
            if number > 0:
                self._forget_until(frame.pose, frame.attitudes)
            if ray is None:
                continue
            self.views.add(frame.pose, self.looks.errors(frame.pose))
            if number == 0:
                self._start(ray, frame.range_m)
            else:
                sights = self.looks.measured([ray], self._expected(frame.pose, frame.range_m))
                self._aims.weigh(filter_.bank, self._places, [ray], sights)
        self.board(platform)
        self._innovations.clear()

    def _forget_until(self, pose: CameraPose, attitudes: Sequence[AttitudeError]) -> None:
        """Let the filter forget until a pose, by what its attitude's error kept since that camera's frame before."""
        if pose.attitude is None:
            self.filter.predict(pose.stamp_s, self.looks.errors(pose))
        for attitude in attitudes:
            self.filter.follow(pose.stamp_s, attitude)

    def _start(self, ray: Ray, range_m: float) -> None:
        pose, sight = ray.pose, self.looks.found([ray], self._expected(ray.pose, range_m)).one(0)
        sigma_rad = self._aims.sigma_rad(self.place, ray)
        self.filter.start(sight, self.looks.errors(pose), self._prior, sigma_rad, pose.attitude)
        self._aims.seen_first(self.place, ray, self.filter.mean_enu_m)
