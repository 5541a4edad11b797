"""One target's track: its filter, the sizes of its segments, and what is told of it. The tracker owns them."""

import math
from collections import deque
from dataclasses import replace

import numpy as np

from distloc.filter.calibrated_filter import CalibratedFilter
from distloc.filter.start import Prior
from distloc.filter.turning import Views
from distloc.geometry.camera import Camera
from distloc.localizer_config import LocalizerConfig
from distloc.sights.sight import Sight
from distloc.sights.sights import Ray, axes_along
from distloc.snapshot import TrackSnapshot
from distloc.tracks.estimate import beside_m2, estimate_of
from distloc.tracks.explanation import Lack, lacks_of
from distloc.tracks.life import CONFIRM_WINDOW, LOCATED_SHARE, NEAR_M, TrackLife
from distloc.tracks.looks.aim_error import AimError, Weighing
from distloc.tracks.looks.jitter import Jitter
from distloc.tracks.looks.lean import Lean
from distloc.tracks.looks.looks import Looks
from distloc.tracks.memory import Memory
from distloc.tracks.motion.motion import Motion
from distloc.tracks.place import Place
from distloc.tracks.plausibility import foot_of, is_too_small
from distloc.types import CameraPose, Extent, FloatArray, PoseErrors, TargetEstimate, TargetState

_OTHER_SIZE = 0.1  # change of the expected size in one step that moves the middle
MUCH_LARGER = 1.25  # than expected: what was seen before was a part
_MOST_INNOVATION = 5.0  # mean of 12 squared innovations of 2 degrees of freedom; more in 1 of 10,000 by chance
_START_RANGE_M = 1000.0  # about how far something new is, for what the position's error moves
BOUNDED_SHARE = 0.5  # of the farthest range: nearer than that a range was measured


class Track:
    """Starts from one detection; nobody is told of it until it is promoted, which gives it a life.

    It sees its last frames anew where it must have been wrong: while it is young and its segments turn out to be parts
    of larger ones, and whenever the innovations are larger than its filter allows.
    """

    _before_px: FloatArray | None = None  # the size that was expected before this step's sighting

    def __init__(self, filter_: CalibratedFilter, prior: Prior | None, config: LocalizerConfig) -> None:
        self.filter = filter_
        self.life: TrackLife | None = None
        self.misses = 0
        self.unseen_steps = 0  # in a row, in view or not
        self.hidden_by: int | None = None  # the detection that covers where it should be
        self.shared_steps = 0
        self._is_to_renew = False  # by the next sighting, from nothing
        self.is_plausible, self.highest_m = True, 0.0
        self.lacks: tuple[Lack, ...] = ()  # of what confirms it, as of the last estimate
        self.range95_m: tuple[float, float] | None = None  # of the same
        self._looks_like: tuple[Lack, ...] = ()  # what it is rather than smoke
        self.is_given_up = False  # merged into another, or in the way of a new one
        self._config, self._prior, self.memory = config, prior, Memory()
        self._innovations: deque[float] = deque(maxlen=CONFIRM_WINDOW)
        self.looks, self.views, self._steps = Looks(config), Views(), 0
        self._aim_error, self.motion = AimError(self.looks), Motion()
        self.extent = Extent(0.0, 0.0, 0.0, 0.0)

    @classmethod
    def started(cls, filter_: CalibratedFilter, ray: Ray, prior: Prior | None, config: LocalizerConfig) -> "Track":
        """From its first detection."""
        track = cls(filter_, prior, config)
        sight = track.looks.sight(ray, _START_RANGE_M)
        track._start(ray, sight, prior)
        track._saw(ray, _START_RANGE_M)
        return track

    @classmethod
    def restored(cls, filter_: CalibratedFilter, saved: TrackSnapshot, config: LocalizerConfig) -> "Track":
        """From a snapshot, in other hands. It has no frames left to see anew, so it counts as grown up."""
        track, camera_enu_m = cls(filter_, None, config), saved.aspect.camera_enu_m
        place_enu_m = saved.filter.origin_enu_m + saved.filter.positions_m.mean(axis=1, dtype=np.float64)
        along_enu = place_enu_m - camera_enu_m
        axes = axes_along(along_enu[None] / max(float(np.linalg.norm(along_enu)), 1.0))[0]
        filter_.restore(saved.filter, Sight(saved.filter.stamp_s, camera_enu_m, axes, np.eye(2)))
        track.life = TrackLife.restored(saved.life)
        track.misses, track.unseen_steps = saved.misses, saved.unseen_steps
        track.is_plausible, track.highest_m, track.extent = saved.is_plausible, saved.highest_m, saved.extent
        track.looks, track.views = Looks(config, saved.sizes_px), Views(saved.views)
        track.looks.root_rad, track.looks.size_rad = saved.root_rad or None, saved.looks_rad
        track.looks.jitter = Jitter(saved.jitter_rad2)
        track.looks.lean = Lean(saved.lean, saved.lean_information, saved.filter.stamp_s)
        track._aim_error = AimError.restored(track.looks, saved.aspect)
        track.motion = Motion(saved.bearings, saved.first_s)
        track._steps = CONFIRM_WINDOW + 1
        return track

    def snapshot(self) -> TrackSnapshot:
        """What it needs to go on; only for a track that has a life."""
        assert self.life is not None
        return TrackSnapshot(
            filter=self.filter.snapshot(),
            life=self.life.snapshot(),
            sizes_px=self.looks.sizes.all_px(),
            extent=self.extent,
            aspect=self._aim_error.snapshot(),
            views=self.views.rows,
            highest_m=self.highest_m,
            is_plausible=self.is_plausible,
            misses=self.misses,
            unseen_steps=self.unseen_steps,
            bearings=self.motion.bearings.rows,
            first_s=self.motion.first_s,
            root_rad=self.looks.root_rad or 0.0,
            looks_rad=self.looks.size_rad,
            jitter_rad2=self.looks.jitter.variance,
            lean=self.looks.lean.weighed,
            lean_information=self.looks.lean.information,
        )

    def sight(self, ray: Ray) -> Sight:
        """A ray as this track may find it."""
        return self.looks.sight(ray, self.range_m(ray.pose))

    def measured(self, ray: Ray, sight: Sight) -> Sight:
        """What a ray tells that was found as a sight."""
        return self.looks.measured(ray, self.range_m(ray.pose)) if any(ray.is_cut) else sight

    def doubt_attitude(self) -> None:
        """The attitude may have jumped by as much as it is ever wrong."""
        self.filter.doubt_attitude()
        self.motion.bearings.forget_error()

    def contradicted(self) -> None:
        """A bias that is found now cannot be the filter's: it begins anew."""
        self.memory.clear()
        self._is_to_renew = True
        if self.life is not None:
            self.life.doubt()

    def hit(self, ray: Ray, sight: Sight, innovation: FloatArray, squared: float, is_joined: bool) -> bool:
        """A sighting; `sight` is the ray's, and so far from what is expected (2,), and squared by its covariance.

        Whether the filter is to weigh it: else it has seen it anew with what is in memory. The size of joined pieces is
        not learnt, for two fires could go apart as one.
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
            return False
        if self._is_inconsistent():
            self._see_anew()
            if self.life is not None:
                self.life.doubt()
            return False
        self._before_px = expected_px
        return True

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

    def adopt(self, other: "Track") -> None:
        """Go on with the filter and the memory of another track, which is of the same target and gets this one's."""
        self.filter, other.filter = other.filter, self.filter
        self.memory, self._innovations, self.looks = other.memory, other._innovations, other.looks
        self._steps, self.extent, self._prior = other._steps, other.extent, other._prior
        self._aim_error, self.views, self.motion = other._aim_error, other.views, other.motion
        self.misses, self.unseen_steps, self.hidden_by = other.misses, other.unseen_steps, None

    def missed(self, pose: CameraPose) -> None:
        """A frame that should have shown it and did not."""
        self.misses += 1
        self._steps += 1
        self.memory.add(pose, None, self.range_m(pose))
        if self.life is not None:
            self.life.sighting(False, pose.stamp_s, pose.position_enu_m)

    def heading_jumped(self, by_rad: float) -> None:
        """From now on the heading's error is another; frames from before cannot be seen anew with those to come."""
        self.filter.turn_bias(np.array([0.0, 0.0, -by_rad]))
        self.motion.bearings.jumped(by_rad)
        self.memory.clear()
        self._innovations.clear()

    def promote(self, id_: int) -> None:
        """Give it an id, and see its frames anew by what is known of its segments' sizes now.

        One that waited for a place knows more than the frames in memory tell.
        """
        frames = self.memory.from_first_sighting()
        if self._steps <= CONFIRM_WINDOW:
            self._see_anew()
        life = TrackLife(id_, frames[0].pose.stamp_s, frames[0].pose.position_enu_m)
        for frame in frames:
            life.sighting(frame.ray is not None, frame.pose.stamp_s, frame.pose.position_enu_m)
        self.life = life

    @property
    def is_believed(self) -> bool:
        """Whether it is confirmed, seen or not."""
        return self.life is not None and self.life.state is not TargetState.TENTATIVE

    @property
    def expected_size_px(self) -> FloatArray | None:
        """Width and height (2,) of its latest whole segments; None while none was."""
        return self.looks.sizes.expected_px

    def range_m(self, pose: CameraPose) -> float:
        """From the camera to the cloud's mean."""
        return math.dist(self.filter.mean_enu_m, pose.position_enu_m)

    def also_m2(self, pose: CameraPose, turning_m2: FloatArray, errors: PoseErrors) -> FloatArray:
        """The covariance (2, 2) of what the cloud lacks on the map; `turning_m2` is that by turning."""
        if pose.attitude is None:
            return turning_m2
        # so sure that these count
        return turning_m2 + beside_m2(errors, self.extent, self.filter.mean_enu_m - pose.position_enu_m)

    def estimate(
        self, pose: CameraPose, place: Place, lean: FloatArray, errors: PoseErrors, is_seen: bool
    ) -> TargetEstimate:
        """What is told of it after a step; only for a track that has a life. Its smoke leans by (2,)."""
        life = self.life
        assert life is not None
        # one that may be as far as anything has no parallax: the start's farthest range makes it look located
        is_bounded = place.range95_m[1] < BOUNDED_SHARE * self._config.range_m[1]
        is_standing = self.motion.verdict == "fixed"  # else one course can't tell where it is
        is_awaited = pose.attitude is not None and pose.attitude.is_about_to_tell
        is_burst = is_bounded and life.is_burst and place.range95_m[0] < NEAR_M
        is_located = is_bounded and self.is_plausible and not is_awaited and is_standing and not is_burst
        if not is_standing:
            life.withdraw()
        major_share = place.ellipse95.semi_major_m / max(place.range_m, 1.0)
        life.settle(is_seen, major_share if is_located else np.inf)
        self.range95_m, self.lacks = place.range95_m, ()
        if life.state is TargetState.TENTATIVE:
            is_short = major_share <= LOCATED_SHARE
            is_shared = self.shared_steps > 0
            lacks = lacks_of(life, is_bounded, is_short, is_awaited, is_shared, is_standing)
            self.lacks = (*lacks, *self._looks_like, *((Lack.BURST,) if is_burst else ()))
        is_over, aim = self.is_given_up or self.misses >= self._config.dismissal_misses, self._config.aim
        plume = None
        if aim == "base":
            plume = self.looks.middle.plume(place.position_enu_m, pose.position_enu_m, lean)
        return estimate_of(life, place, self.extent, plume, is_over, self.motion.verdict, aim, pose.attitude, errors)

    def foot_enu_m(self) -> FloatArray:
        """The foot (3,) of the segment that was seen in this step."""
        ray = self.memory.frames[-1].ray
        assert ray is not None
        return foot_of(ray, self.filter.mean_enu_m)

    def consider(self, is_in_the_sky: bool, is_on_the_lens: bool) -> None:
        """Whether what was seen in this step can be smoke on the ground: what cannot is not believed, or no longer.

        What may be on the lens is not believed yet, but keeps what it has: a gimbal that holds a fire in the middle of
        the image while the heading's error drifts looks the same.
        """
        is_small = is_too_small(self.extent)
        is_no_smoke = is_in_the_sky or is_small
        looks = ((Lack.IN_THE_SKY, is_in_the_sky), (Lack.TOO_SMALL, is_small), (Lack.ON_THE_LENS, is_on_the_lens))
        self._looks_like = tuple(lack for lack, is_so in looks if is_so)
        if is_no_smoke and self.life is not None:
            self.life.withdraw()
        self.is_plausible = not (is_no_smoke or is_on_the_lens)

    def measure_extent(self, camera: Camera, depth_m: float, range_sigma_m: float) -> None:
        """Width and height in metres, by the distance along the camera's axis."""
        self.extent = self.looks.sizes.extent(camera, max(depth_m, 1.0), range_sigma_m) or self.extent

    def _saw(self, ray: Ray, range_m: float, is_joined: bool = False) -> None:
        self.misses, self.unseen_steps, self.hidden_by = 0, 0, None
        self._steps += 1
        self.memory.add(ray.pose, ray, range_m)
        self.views.add(ray.pose, self.looks.errors(ray.pose))
        self.looks.saw(ray)
        if not ray.is_cut[0]:
            errors = self.looks.errors(ray.pose)
            pixels_rad = math.hypot(ray.sigma_px, self._config.pixel_sigma_px) * ray.px_rad
            self.motion.saw(ray, errors, math.hypot(pixels_rad, errors.attitude_white_rad))
        if not (ray.detection.touches_border or ray.detection.is_point or is_joined):
            self.looks.sizes.add(ray.detection.width_px, ray.detection.height_px)
        if self.life is not None:
            self.life.sighting(True, ray.pose.stamp_s, ray.pose.position_enu_m)

    def _is_inconsistent(self) -> bool:
        """Whether the last innovations are together larger than chance makes them (Bar-Shalom et al. 2001, 5.4)."""
        held = len(self._innovations)
        return held == CONFIRM_WINDOW and sum(self._innovations) > _MOST_INNOVATION * held

    def _see_anew(self) -> None:
        """Start the filter from the frames in memory, the first sighting first."""
        frames, filter_ = self.memory.from_first_sighting(), self.filter
        self.views = Views()
        for number, frame in enumerate(frames):
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
                self._start(ray, self.looks.sight(ray, frame.range_m), self._prior)
            else:
                sight = self.looks.measured(ray, frame.range_m)
                how = self.weighing(ray, sight)
                filter_.turn(how.kept, how.aim_sigma_rad, how.grows)
                filter_.update(replace(sight, covariance=how.covariance))
        self._innovations.clear()

    def _start(self, ray: Ray, sight: Sight, prior: Prior | None) -> None:
        pose = ray.pose
        self.filter.start(sight, self.looks.errors(pose), prior, self._aim_error.sigma_rad(ray), pose.attitude)
        self._aim_error.seen_first(ray, self.filter.mean_enu_m)
