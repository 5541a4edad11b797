"""One target's track: its filter, the sizes of its segments, and what is told of it. The tracker owns them."""

from collections import deque
from dataclasses import replace

import numpy as np

from distloc.filter.calibrated_filter import CalibratedFilter, Prior
from distloc.filter.ground import Ground
from distloc.filter.turning import Views
from distloc.geometry.camera import Camera
from distloc.localizer_config import LocalizerConfig
from distloc.sights.aspect import Aspect
from distloc.sights.sight import Sight
from distloc.sights.sights import Ray, axes_along
from distloc.snapshot import TrackSnapshot
from distloc.tracks.estimate import beside_m2, estimate_of
from distloc.tracks.expected import expected_pixels, range_sigma_m, reach_px
from distloc.tracks.life import CONFIRM_WINDOW, TrackLife
from distloc.tracks.looks import Looks
from distloc.tracks.memory import Frame, Memory
from distloc.tracks.place import Place
from distloc.tracks.plausibility import foot_of, is_in_the_sky, is_too_small, stays_on_the_lens
from distloc.types import AttitudeError, CameraPose, Extent, FloatArray, TargetEstimate

_OTHER_SIZE = 0.1  # change of the expected size in one step that moves the middle
MUCH_LARGER = 1.25  # than expected: what was seen before was a part
_MOST_INNOVATION = 5.0  # mean of 12 squared innovations of 2 degrees of freedom; more in 1 of 10,000 by chance
_START_RANGE_M = 1000.0  # about how far something new is, for what the position's error moves
_BOUNDED_SHARE = 0.5  # of the farthest range: nearer than that a range was measured


class Track:
    """Starts from one detection; nobody is told of it until it is promoted, which gives it a life.

    It sees its last frames anew where it must have been wrong: while it is young and its segments turn out to be parts
    of larger ones, and whenever the innovations are larger than its filter allows.
    """

    _aspect: Aspect  # there once the filter is started

    def __init__(self, filter_: CalibratedFilter, prior: Prior | None, config: LocalizerConfig) -> None:
        self.filter = filter_
        self.life: TrackLife | None = None
        self.misses = 0
        self.unseen_steps = 0  # in a row, in view or not
        self.hidden_by: int | None = None  # the detection that covers where it should be
        self.shared_steps = 0
        self._is_to_renew = False  # by the next sighting, from nothing
        self.is_plausible, self._highest_m = True, 0.0
        self.is_given_up = False  # merged into another, or in the way of a new one
        self._config, self._prior, self.memory = config, prior, Memory()
        self._innovations: deque[float] = deque(maxlen=CONFIRM_WINDOW)
        self._looks, self._views, self._steps = Looks(config), Views(), 0
        self._extent = Extent(0.0, 0.0, 0.0, 0.0)
        self._is_cut = np.zeros(2, np.bool_)  # by the border, across and upright, when it was seen last

    @classmethod
    def started(cls, filter_: CalibratedFilter, ray: Ray, prior: Prior | None, config: LocalizerConfig) -> "Track":
        """From its first detection."""
        track = cls(filter_, prior, config)
        sight = track._looks.sight(ray, _START_RANGE_M)
        filter_.start(sight, track._looks.errors(ray.pose), prior, track._aim_sigma_rad(ray), ray.pose.attitude)
        track._aspect = Aspect(filter_.cloud.mean_enu_m, ray.pose.position_enu_m)
        track._saw(ray, _START_RANGE_M)
        return track

    @classmethod
    def restored(cls, filter_: CalibratedFilter, saved: TrackSnapshot, config: LocalizerConfig) -> "Track":
        """From a snapshot, in other hands. It has no frames left to see anew, so it counts as grown up."""
        track, camera_enu_m = cls(filter_, None, config), saved.aspect.camera_enu_m
        track._aspect = Aspect.restored(saved.aspect)
        place_enu_m = saved.filter.origin_enu_m + saved.filter.positions_m.mean(axis=1, dtype=np.float64)
        along_enu = place_enu_m - camera_enu_m
        axes = axes_along(along_enu / max(float(np.linalg.norm(along_enu)), 1.0))
        filter_.restore(saved.filter, Sight(saved.filter.stamp_s, camera_enu_m, axes, np.eye(2)))
        track.life = TrackLife.restored(saved.life)
        track.misses, track.unseen_steps = saved.misses, saved.unseen_steps
        track.is_plausible, track._highest_m, track._extent = saved.is_plausible, saved.highest_m, saved.extent
        track._looks, track._views = Looks(config, saved.sizes_px), Views(saved.views)
        track._steps = CONFIRM_WINDOW + 1
        return track

    def snapshot(self) -> TrackSnapshot:
        """What it needs to go on; only for a track that has a life."""
        assert self.life is not None
        return TrackSnapshot(
            filter=self.filter.snapshot(),
            life=self.life.snapshot(),
            sizes_px=self._looks.sizes.all_px(),
            extent=self._extent,
            aspect=self._aspect.snapshot(),
            views=self._views.rows,
            highest_m=self._highest_m,
            is_plausible=self.is_plausible,
            misses=self.misses,
            unseen_steps=self.unseen_steps,
        )

    def sight(self, ray: Ray) -> Sight:
        """A ray as this track may find it."""
        return self._looks.sight(ray, self.range_m(ray.pose))

    def predict(self, pose: CameraPose) -> None:
        """Let the filter forget until a step's pose; what contradicts a bias that is found now is begun anew."""
        if not self._predict(self.filter, pose, () if pose.attitude is None else (pose.attitude,)):
            self.memory.clear()
            self._is_to_renew = True
            if self.life is not None:
                self.life.doubt()
        self.memory.step(pose)

    def hit(self, ray: Ray, sight: Sight, is_joined: bool = False) -> None:
        """A sighting; `sight` is the ray's.

        The size of joined pieces is not learnt, for two fires could go apart as one.
        """
        range_m, expected_px = self.range_m(ray.pose), self.expected_size_px
        measured = self._looks.measured(ray, range_m)
        innovation, expected = self.filter.innovation(sight)
        self._innovations.append(float(innovation @ np.linalg.solve(expected, innovation)))
        self._looks.learn(ray, innovation, sight)
        self._saw(ray, range_m, is_joined)
        is_larger = (
            expected_px is not None
            and not ray.detection.touches_border
            and bool((ray.size_px > MUCH_LARGER * expected_px).any())
        )
        if self._is_to_renew or (is_larger and self._steps <= CONFIRM_WINDOW):
            self._is_to_renew = False
            self._see_anew(self.filter)
        elif self._is_inconsistent():
            self._see_anew(self.filter)
            if self.life is not None:
                self.life.doubt()
        else:
            self._update(self.filter, ray, measured)
            self._follow_size(ray, expected_px)

    def is_like(self, ray: Ray) -> bool:
        """Whether a segment may be this target: one many times as large as any before only hides it."""
        return self._looks.sizes.may_be(ray.size_px)

    def adopt(self, other: "Track") -> None:
        """Go on with the filter and the memory of another track, which is of the same target and gets this one's."""
        self.filter, other.filter = other.filter, self.filter
        self.memory, self._innovations, self._looks = other.memory, other._innovations, other._looks
        self._steps, self._extent, self._prior = other._steps, other._extent, other._prior
        self._aspect, self._views, self._is_cut = other._aspect, other._views, other._is_cut
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
        self.memory.clear()
        self._innovations.clear()

    def promote(self, filter_: CalibratedFilter, id_: int) -> None:
        """Give it an id, and a filter that sees again what the one before saw."""
        frames = self._see_anew(filter_)
        self.filter = filter_
        self.life = TrackLife(id_, frames[0].pose.stamp_s, frames[0].pose.position_enu_m)
        for frame in frames:
            self.life.sighting(frame.ray is not None, frame.pose.stamp_s, frame.pose.position_enu_m)

    @property
    def expected_size_px(self) -> FloatArray | None:
        """Width and height (2,) of its latest whole segments; None while none was."""
        return self._looks.sizes.expected_px

    def reach_px(self, camera: Camera, pose: CameraPose) -> tuple[FloatArray, FloatArray]:
        """Least and greatest pixel (2,), (2,) at which it can be: what lies outside need not be weighed."""
        return reach_px(self.filter, camera, pose, self._looks.errors(pose).attitude_white_rad)

    def range_m(self, pose: CameraPose) -> float:
        """From the camera to the cloud's mean."""
        return float(np.linalg.norm(self.filter.cloud.mean_enu_m - pose.position_enu_m))

    def range_sigma_m(self, pose: CameraPose) -> float:
        """One standard deviation of the cloud along the line of sight."""
        return range_sigma_m(self.filter.cloud, pose)

    def pixel(self, camera: Camera, pose: CameraPose) -> FloatArray | None:
        """Where it is expected in the image (2,), the bias in; None behind the camera."""
        pixel = expected_pixels(self.filter.cloud, camera, [pose])[:, 0]
        return pixel if np.isfinite(pixel).all() else None

    def estimate(self, pose: CameraPose, is_seen: bool) -> TargetEstimate:
        """What is told of it after a step; only for a track that has a life."""
        life, cloud, errors = self.life, self.filter.cloud, self._looks.errors(pose)
        assert life is not None
        also_m2 = self._views.covariance_m2(cloud.mean_enu_m, errors)
        if pose.attitude is not None:  # so sure that these count
            also_m2 = also_m2 + beside_m2(errors, self._extent, cloud.mean_enu_m - pose.position_enu_m)
        place = Place.of(self.filter.particles, pose.position_enu_m, also_m2)
        # one that may be as far as anything has no parallax: the start's farthest range makes it look located
        is_bounded = place.range95_m[1] < _BOUNDED_SHARE * self._config.range_m[1]
        is_awaited = pose.attitude is not None and pose.attitude.is_about_to_tell
        is_located = is_bounded and self.is_plausible and not is_awaited
        life.settle(is_seen, place.ellipse95.semi_major_m / max(place.range_m, 1.0) if is_located else np.inf)
        is_over = self.is_given_up or self.misses >= self._config.dismissal_misses
        return estimate_of(life, cloud, place, self._extent, also_m2, is_over, self._config.aim, pose.attitude, errors)

    def consider(self, camera: Camera, pose: CameraPose, ground: Ground) -> None:
        """Whether what was seen in this step can be smoke on the ground: what cannot is not believed, or no longer.

        What may be on the lens is not believed yet, but keeps what it has: a gimbal that holds a fire in the middle of
        the image while the heading's error drifts looks the same.
        """
        ray = self.memory.frames[-1].ray
        if ray is None or self.life is None:
            return
        foot_enu_m = foot_of(ray, self.filter.cloud)
        self._highest_m = max(self._highest_m, float(pose.position_enu_m[2]))
        is_no_smoke = is_too_small(self._extent) or is_in_the_sky(foot_enu_m, self._highest_m, ground)
        if is_no_smoke:
            self.life.withdraw()
        sigma_px = float(np.hypot(self._config.pixel_sigma_px, camera.fx * self._looks.errors(pose).attitude_white_rad))
        self.is_plausible = not (
            is_no_smoke or stays_on_the_lens(self.memory.rays(), self.filter.cloud, camera, sigma_px)
        )

    def measure_extent(self, camera: Camera, pose: CameraPose) -> None:
        """Width and height in metres, by the distance along the camera's axis."""
        depth_m = float(pose.R_cam_from_enu[2] @ (self.filter.cloud.mean_enu_m - pose.position_enu_m))
        self._extent = self._looks.sizes.extent(camera, max(depth_m, 1.0), self.range_sigma_m(pose)) or self._extent

    def _predict(self, filter_: CalibratedFilter, pose: CameraPose, attitudes: tuple[AttitudeError, ...]) -> bool:
        if not attitudes:
            filter_.predict(pose.stamp_s, self._looks.errors(pose))
        return all([filter_.follow(pose.stamp_s, attitude) for attitude in attitudes])

    def _saw(self, ray: Ray, range_m: float, is_joined: bool = False) -> None:
        self.misses, self.unseen_steps, self.hidden_by = 0, 0, None
        self._steps += 1
        self.memory.add(ray.pose, ray, range_m)
        self._views.add(ray.pose, self._looks.errors(ray.pose))
        if not (ray.detection.touches_border or ray.detection.is_point or is_joined):
            self._looks.sizes.add(ray.detection.width_px, ray.detection.height_px)
        if self.life is not None:
            self.life.sighting(True, ray.pose.stamp_s, ray.pose.position_enu_m)

    def _follow_size(self, ray: Ray, before_px: FloatArray | None) -> None:
        """Where the size that is expected jumps, the middle may have moved by half of that, and stay there.

        A size that changes by little from step to step is that of a target seen from another side or from nearer.
        """
        expected_px = self.expected_size_px
        if before_px is None or expected_px is None:
            return
        change_px = np.abs(expected_px - before_px)
        if (change_px > _OTHER_SIZE * before_px).any():
            self.filter.doubt_aim(float(change_px.max()) / 2.0 * ray.px_rad)

    def _is_inconsistent(self) -> bool:
        """Whether the last innovations are together larger than chance makes them (Bar-Shalom et al. 2001, 5.4)."""
        held = len(self._innovations)
        return held == CONFIRM_WINDOW and sum(self._innovations) > _MOST_INNOVATION * held

    def _see_anew(self, filter_: CalibratedFilter) -> list[Frame]:
        """Start the filter from the frames in memory, the first sighting first; they are returned."""
        frames = self.memory.from_first_sighting()
        self._views = Views()
        for number, frame in enumerate(frames):
            takes = self._looks.measured if number else self._looks.sight
            sight = None if frame.ray is None else takes(frame.ray, frame.range_m)
            if frame.ray is not None:
                self._views.add(frame.pose, self._looks.errors(frame.pose))
            if number == 0 and frame.ray is not None and sight is not None:
                aim_rad = self._aim_sigma_rad(frame.ray)
                filter_.start(sight, self._looks.errors(frame.pose), self._prior, aim_rad, frame.pose.attitude)
                self._aspect = Aspect(filter_.cloud.mean_enu_m, frame.pose.position_enu_m)
                continue
            self._predict(filter_, frame.pose, frame.attitudes)
            if frame.ray is not None and sight is not None:
                self._update(filter_, frame.ray, sight)
        self._innovations.clear()
        return frames

    def _update(self, filter_: CalibratedFilter, ray: Ray, sight: Sight) -> None:
        """Weigh by a sight, which tells the less the oftener the target was seen from this side."""
        aim_rad = self._looks.aim_sigma_rad(ray)
        turn = self._aspect.turned(filter_.cloud.mean_enu_m, sight.position_enu_m)
        was_cut, sigma_rad = self._is_cut, self._aim_sigma_rad(ray)
        # another error altogether where the border begins or ends to cut
        kept = np.where(self._is_cut, turn.kept_cut, turn.kept)
        filter_.turn(np.where(was_cut == self._is_cut, kept, 0.0), sigma_rad, ~self._is_cut)
        doubt = turn.doubt(float(np.square(aim_rad).max()), float(np.diag(sight.covariance).min()))
        filter_.update(replace(sight, covariance=doubt * sight.covariance))

    def _aim_sigma_rad(self, ray: Ray) -> FloatArray:
        """Of the aim's error (2,), what lies beyond the border included; that may be off for as long as it is cut."""
        aim_rad, cut_rad = self._looks.aim_sigma_rad(ray), self._looks.cut_sigma_rad(ray)
        self._is_cut = cut_rad > aim_rad
        return np.hypot(aim_rad, cut_rad)
