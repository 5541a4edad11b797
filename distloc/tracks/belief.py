"""What a track's sightings tell of its target: a filter, what it looks like, from where it was seen, how it moves."""

import math
from collections import deque
from dataclasses import replace
from enum import Enum, auto

import numpy as np

from distloc.filter.calibrated_filter import CalibratedFilter
from distloc.filter.start import Prior
from distloc.filter.turning import ViewsByPlatform
from distloc.geometry.camera import Camera
from distloc.localizer_config import LocalizerConfig
from distloc.sights.sight import Sight
from distloc.sights.sights import Ray, axes_along
from distloc.snapshot import AspectSnapshot, TrackSnapshot
from distloc.tracks.life import CONFIRM_WINDOW
from distloc.tracks.looks.aim_error import AimError, Weighing
from distloc.tracks.looks.appearance import Appearance
from distloc.tracks.looks.lean import Lean
from distloc.tracks.looks.looks import Looks
from distloc.tracks.memory import Memory
from distloc.tracks.motion.motion import Motion
from distloc.types import CameraPose, Extent, FloatArray

MUCH_LARGER = 1.25  # than expected: what was seen before was a part
_OTHER_SIZE = 0.1  # change of the expected size in one step that moves the middle
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

    _before_px: FloatArray | None = None  # the size that was expected before this step's sighting

    def __init__(self, filter_: CalibratedFilter, prior: Prior | None, config: LocalizerConfig, looks: Looks) -> None:
        self.filter, self.looks, self.memory = filter_, looks, Memory()
        self.views, self.motion, self.extent = ViewsByPlatform(), Motion(), Extent(0.0, 0.0, 0.0, 0.0)
        self._config, self._prior, self._aim_error = config, prior, AimError(looks)
        self._innovations: deque[float] = deque(maxlen=CONFIRM_WINDOW)
        self._steps = 0  # that could have shown it
        self._is_to_renew = False  # by the next sighting, from nothing

    @classmethod
    def started(cls, filter_: CalibratedFilter, ray: Ray, prior: Prior | None, config: LocalizerConfig) -> "Belief":
        """From a first detection."""
        belief, platform = cls(filter_, prior, config, Looks(config)), ray.pose.platform
        filter_.clear(platform)
        belief.board(platform)
        belief._start(ray, belief.looks.sight(ray, _START_RANGE_M))
        belief._saw(ray, _START_RANGE_M)
        return belief

    @classmethod
    def restored(cls, filter_: CalibratedFilter, saved: TrackSnapshot, config: LocalizerConfig) -> "Belief":
        """From a snapshot, in other hands. It has no frames left to see anew, so it counts as grown up."""
        camera_enu_m = saved.aspect.camera_enu_m
        place_enu_m = saved.filter.origin_enu_m + saved.filter.positions_m.mean(axis=1, dtype=np.float64)
        along_enu = place_enu_m - camera_enu_m
        axes = axes_along(along_enu[None] / max(float(np.linalg.norm(along_enu)), 1.0))[0]
        filter_.restore(saved.filter, Sight(saved.filter.stamp_s, camera_enu_m, axes, np.eye(2)))
        looks = Looks(config, Appearance.restored(saved))
        looks.lean = Lean(saved.lean, saved.lean_information, saved.filter.stamp_s)
        belief = cls(filter_, None, config, looks)
        belief.memory.seen_by.add(saved.platform)
        belief.views, belief.motion = (
            ViewsByPlatform(saved.views, saved.platform),
            Motion(saved.bearings, saved.first_s),
        )
        belief.extent, belief._aim_error = saved.extent, AimError.restored(looks, saved.aspect)
        belief._steps = CONFIRM_WINDOW + 1
        return belief

    @property
    def aspect(self) -> AspectSnapshot:
        """From where it was seen."""
        return self._aim_error.snapshot()

    @property
    def expected_size_px(self) -> FloatArray | None:
        """Width and height (2,) of the latest whole segments in this platform's pictures; None while none was."""
        return self.looks.own.sizes.expected_px

    def range_m(self, pose: CameraPose) -> float:
        """From the camera to the cloud's mean."""
        return math.dist(self.filter.mean_enu_m, pose.position_enu_m)

    def board(self, platform: str) -> None:
        """From now on it is this platform's camera that looks."""
        self.filter.board(platform)
        self.looks.board(platform)

    def sight(self, ray: Ray) -> Sight:
        """A ray as this track may find it."""
        return self.looks.sight(ray, self.range_m(ray.pose))

    def measured(self, ray: Ray, sight: Sight) -> Sight:
        """What a ray tells that was found as a sight."""
        return self.looks.measured(ray, self.range_m(ray.pose)) if any(ray.is_cut) else sight

    def take(self, ray: Ray, sight: Sight, innovation: FloatArray, squared: float, is_joined: bool) -> Outcome:
        """A sighting; `sight` is the ray's, and so far from what is expected (2,), and squared by its covariance.

        The size of joined pieces is not learnt, for two fires could go apart as one.
        """
        range_m, expected_px = self.range_m(ray.pose), self.expected_size_px
        self._innovations.append(squared)
        self.looks.learn(ray, innovation, sight)
        self._saw(ray, range_m, is_joined)
        is_larger = (
            self._steps <= CONFIRM_WINDOW
            and expected_px is not None
            and not ray.detection.touches_border
            and bool((ray.size_px > MUCH_LARGER * expected_px).any())
        )
        if self._is_to_renew or is_larger:
            self._is_to_renew = False
            self._see_anew()
            return Outcome.RENEWED
        if self._is_inconsistent():
            self._see_anew()
            return Outcome.CONTRADICTED
        self._before_px = expected_px
        return Outcome.TO_WEIGH

    def weighing(self, ray: Ray, sight: Sight) -> Weighing:
        """How the filter is to weigh what a ray tells."""
        return self._aim_error.weighing(ray, sight, self.filter.mean_enu_m)

    def weighed(self, ray: Ray) -> None:
        """The filter has: where the size that is expected jumps, the middle may have moved by half of that, and stay.

        A size that changes by little from step to step is that of a target seen from another side or from nearer.
        """
        expected_px, before_px = self.expected_size_px, self._before_px
        if before_px is None or expected_px is None or expected_px is before_px:
            return
        change_px = np.abs(expected_px - before_px)
        if (change_px > _OTHER_SIZE * before_px).any():
            self.filter.doubt_aim(float(change_px.max()) / 2.0 * ray.px_rad)

    def missed(self, pose: CameraPose) -> None:
        """A frame that should have shown it and did not."""
        self._steps += 1
        self.memory.add(pose, None, self.range_m(pose))

    def doubt_attitude(self) -> None:
        """The attitude may have jumped by as much as it is ever wrong."""
        self.filter.doubt_attitude()
        self.motion.bearings.forget_error(self.looks.own.platform)

    def heading_jumped(self, by_rad: float) -> None:
        """From now on the heading's error is another; frames from before cannot be seen anew with those to come."""
        self.filter.turn_bias(np.array([0.0, 0.0, -by_rad]))
        self.motion.bearings.jumped(by_rad, self.looks.own.platform)
        self.memory.clear()
        self._innovations.clear()

    def contradicted(self) -> None:
        """A bias that is found now cannot be the filter's: it begins anew."""
        self.memory.clear()
        self._is_to_renew = True

    def grow_up(self) -> None:
        """See the first frames anew by what is known of the segments' sizes now.

        One that waited for that knows more than the frames in memory tell.
        """
        if self._steps <= CONFIRM_WINDOW:
            self._see_anew()

    def measure_extent(self, camera: Camera, depth_m: float, range_sigma_m: float) -> None:
        """Width and height in metres, by the distance along the camera's axis."""
        self.extent = self.looks.own.sizes.extent(camera, max(depth_m, 1.0), range_sigma_m) or self.extent

    def _saw(self, ray: Ray, range_m: float, is_joined: bool = False) -> None:
        self._steps += 1
        errors = self.looks.errors(ray.pose)
        self.memory.add(ray.pose, ray, range_m)
        self.views.add(ray.pose, errors)
        self.looks.saw(ray)
        if not ray.is_cut[0]:
            pixels_rad = math.hypot(ray.sigma_px, self._config.pixel_sigma_px) * ray.px_rad
            self.motion.saw(ray, errors, math.hypot(pixels_rad, errors.attitude_white_rad))
        if not (ray.detection.touches_border or ray.detection.is_point or is_joined):
            self.looks.own.sizes.add(ray.detection.width_px, ray.detection.height_px)

    def _is_inconsistent(self) -> bool:
        """Whether the last innovations are together larger than chance makes them (Bar-Shalom et al. 2001, 5.4)."""
        held = len(self._innovations)
        return held == CONFIRM_WINDOW and sum(self._innovations) > _MOST_INNOVATION * held

    def _see_anew(self) -> None:
        """Start the filter from the frames in memory, the first sighting first."""
        frames, filter_, platform = self.memory.from_first_sighting(), self.filter, self.looks.own.platform
        self.views = ViewsByPlatform()
        for number, frame in enumerate(frames):
            self.board(frame.pose.platform)
            errors, ray = self.looks.errors(frame.pose), frame.ray
            if number > 0:
                if not frame.attitudes:
                    filter_.predict(frame.pose.stamp_s, errors)
                for attitude in frame.attitudes:
                    filter_.follow(frame.pose.stamp_s, attitude)
            if ray is None:
                continue
            self.views.add(frame.pose, errors)
            if number == 0:
                self._start(ray, self.looks.sight(ray, frame.range_m))
            else:
                sight = self.looks.measured(ray, frame.range_m)
                how = self.weighing(ray, sight)
                filter_.turn(how.kept, how.aim_sigma_rad, how.grows)
                filter_.update(replace(sight, covariance=how.covariance))
        self.board(platform)
        self._innovations.clear()

    def _start(self, ray: Ray, sight: Sight) -> None:
        pose = ray.pose
        self.filter.start(sight, self.looks.errors(pose), self._prior, self._aim_error.sigma_rad(ray), pose.attitude)
        self._aim_error.seen_first(ray, self.filter.mean_enu_m)
