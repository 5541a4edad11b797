"""One target's track: what is believed of it, its life, and what is reported. The tracker owns them."""

import numpy as np

from distloc.filter.calibrated_filter import CalibratedFilter
from distloc.filter.settings import LocalizerConfig
from distloc.filter.start import Prior
from distloc.sights.sights import SOMEWHERE_SHARE, Ray, stands_upright
from distloc.snapshot import TrackSnapshot
from distloc.tracks.belief import Belief, Outcome
from distloc.tracks.estimates.estimate import beside_m2, estimate_of
from distloc.tracks.estimates.place import Place
from distloc.tracks.explanation import Lack, lacks_of
from distloc.tracks.life import CONFIRM_WINDOW, LOCATED_SHARE, NEAR_M, TrackLife
from distloc.tracks.looks.aim_error import AimErrors
from distloc.tracks.memory import Memory
from distloc.tracks.plausibility import is_too_small
from distloc.types import CameraPose, FloatArray, Plume, PoseErrors, TargetEstimate, TargetState

_ANOTHER_STAY_STEPS = 20  # out of view
_LONG_UNSEEN_STEPS = 8
_MOST_OPEN_STEPS = 30
_MOST_PATIENCE = 6  # times the misses that dismiss what is new
BOUNDED_SHARE = 0.5  # of the farthest range: nearer than that a range was measured


class Track:
    """Nobody is told of it until it is promoted, which gives it a life."""

    def __init__(self, belief: Belief, config: LocalizerConfig) -> None:
        self.belief, self._config = belief, config
        self.life: TrackLife | None = None
        self.misses = 0
        self.unseen_steps = 0  # in a row, in view or not
        self.away_steps = 0  # the same, of cameras that saw it before
        self.hidden_by: int | None = None  # the detection that covers where it should be
        self.shared_steps = 0
        self.open_steps = 0  # in a row that had a segment which may be another's
        self.is_plausible, self.highest_m = True, 0.0
        self.lacks: tuple[Lack, ...] = ()  # of what confirms it, as of the last estimate
        self.range95_m: tuple[float, float] | None = None  # of the same
        self._looks_like: tuple[Lack, ...] = ()  # what it is rather than smoke
        self.is_given_up = False  # merged into another, or in the way of a new one

    @classmethod
    def started(
        cls, filter_: CalibratedFilter, ray: Ray, prior: Prior | None, config: LocalizerConfig, aims: AimErrors
    ) -> "Track":
        """From its first detection."""
        return cls(Belief.started(filter_, ray, prior, config, aims), config)

    @classmethod
    def restored(
        cls, filter_: CalibratedFilter, saved: TrackSnapshot, config: LocalizerConfig, aims: AimErrors
    ) -> "Track":
        """From a snapshot, in other hands."""
        track = cls(Belief.restored(filter_, saved, config, aims), config)
        track.life = TrackLife.restored(saved.life)
        track.misses, track.unseen_steps = saved.misses, saved.unseen_steps
        track.is_plausible, track.highest_m = saved.is_plausible, saved.highest_m
        return track

    def snapshot(self) -> TrackSnapshot:
        """What it needs to go on; only for a track that has a life."""
        assert self.life is not None
        belief, looks, place = self.belief, self.belief.looks, self.belief.place
        row = int(looks.latest[place])
        return TrackSnapshot(
            filter=self.filter.snapshot(),
            life=self.life.snapshot(),
            sizes_px=looks.sizes.all_px(row),
            extent=belief.extent,
            aspect=belief.aspect,
            views=belief.views.rows,
            highest_m=self.highest_m,
            is_plausible=self.is_plausible,
            misses=self.misses,
            unseen_steps=self.unseen_steps,
            bearings=belief.motion.bearings.rows,
            first_s=belief.motion.first_s,
            root_rad=float(np.nan_to_num(looks.root_rad[row])),
            looks_rad=looks.size_rad[row].copy(),
            jitter_rad2=looks.jitter.variance[row].copy(),
            lean=looks.leans.weighed[place].copy(),
            lean_information=looks.leans.information[place].copy(),
            platform=looks.seen_last_by(place),
        )

    @property
    def filter(self) -> CalibratedFilter:
        """Its place in the bank."""
        return self.belief.filter

    @property
    def memory(self) -> Memory:
        """Its last frames."""
        return self.belief.memory

    def is_unseen_since(self, stamp_s: float) -> bool:
        """Whether it is told of and was not seen after a time."""
        return self.life is not None and self.life.last_seen_s <= stamp_s

    def may_wait(self) -> bool:
        """One more step with a segment that may be another's; whether it is better to leave that.

        After a while unseen, not for long, and not before it has an id: until then nothing is lost.
        """
        if self.life is None or self.unseen_steps < _LONG_UNSEEN_STEPS:
            return False
        self.open_steps += 1
        return self.open_steps <= _MOST_OPEN_STEPS

    def hit(self, ray: Ray, squared: float, is_larger: bool) -> bool:
        """A sighting, as the belief takes it; whether the filter is to weigh it."""
        if self.life is not None and self.away_steps - self.misses > _ANOTHER_STAY_STEPS:
            self.life.come_back()
        self.misses, self.unseen_steps, self.away_steps, self.hidden_by = 0, 0, 0, None
        self.open_steps = 0
        outcome = self.belief.take(ray, squared, is_larger)
        if self.life is not None:
            self.life.sighting(True, ray.pose.stamp_s, ray.pose.position_enu_m)
            if outcome is Outcome.CONTRADICTED:
                self.life.doubt()
        return outcome is Outcome.TO_WEIGH

    @property
    def is_over(self) -> bool:
        """Whether it is dismissed: smoke that was seen for a while may pause as long, for it comes in puffs."""
        least = self._config.dismissal_misses
        seen = 0 if self.life is None else self.life.observations
        patience = min(seen, _MOST_PATIENCE * least) if seen >= CONFIRM_WINDOW else least
        return self.is_given_up or self.misses >= max(patience, least)

    def missed(self, pose: CameraPose) -> None:
        """A frame that should have shown it and did not."""
        self.misses += 1
        self.belief.missed(pose)
        if self.life is not None:
            self.life.sighting(False, pose.stamp_s, pose.position_enu_m)

    def contradicted(self) -> None:
        """A bias that is found now cannot be the filter's."""
        self.belief.contradicted()
        if self.life is not None:
            self.life.doubt()

    def adopt(self, other: "Track") -> None:
        """Go on with what is believed by another track, which is of the same target and gets this one's."""
        self.belief, other.belief = other.belief, self.belief
        self.misses, self.unseen_steps, self.hidden_by = other.misses, other.unseen_steps, None

    def promote(self, id_: int, pose: CameraPose) -> None:
        """Give it an id, in a step of this pose."""
        self.belief.grow_up(pose)
        frames = self.memory.from_first_sighting()
        self.life = TrackLife(id_, frames[0].pose.stamp_s, frames[0].pose.position_enu_m)
        for frame in frames:
            self.life.sighting(frame.ray is not None, frame.pose.stamp_s, frame.pose.position_enu_m)

    @property
    def is_believed(self) -> bool:
        """Whether it is confirmed, seen or not."""
        return self.life is not None and self.life.state is not TargetState.TENTATIVE

    def also_m2(self, pose: CameraPose, turning_m2: FloatArray, errors: PoseErrors) -> FloatArray:
        """The covariance (2, 2) of what the cloud lacks on the map; `turning_m2` is that by turning."""
        also_m2, extent = turning_m2, self.belief.extent
        if self._config.aim == "base" and not stands_upright(pose):  # straight down the fire is somewhere under it
            also_m2 = also_m2 + np.eye(2) * (max(extent.width_m, extent.height_m) * SOMEWHERE_SHARE) ** 2
        if pose.attitude is not None:  # so sure that these count
            also_m2 = also_m2 + beside_m2(errors, extent, self.filter.mean_enu_m - pose.position_enu_m)
        return also_m2

    def estimate(
        self, pose: CameraPose, place: Place, plume: Plume | None, errors: PoseErrors, is_seen: bool
    ) -> TargetEstimate:
        """What is told of it after a step; only for a track that has a life."""
        life, belief = self.life, self.belief
        assert life is not None
        # one that may be as far as anything has no parallax: the start's farthest range makes it look located
        is_bounded = place.range95_m[1] < BOUNDED_SHARE * self._config.range_m[1]
        motion = belief.motion.verdict
        is_standing = motion == "fixed"  # else one course can't tell where it is
        is_awaited = pose.attitude is not None and pose.attitude.is_about_to_tell
        is_burst = is_bounded and life.is_burst and place.range95_m[0] < NEAR_M
        if not is_standing:
            life.withdraw()
        is_standing = is_standing and not belief.motion.is_awaited  # not yet; what was confirmed before stays so
        is_located = is_bounded and self.is_plausible and not is_awaited and is_standing and not is_burst
        major_share = place.ellipse95.semi_major_m / max(place.range_m, 1.0)
        life.settle(is_seen, major_share if is_located else np.inf)
        self.range95_m, self.lacks = place.range95_m, ()
        if life.state is TargetState.TENTATIVE:
            is_short = major_share <= LOCATED_SHARE
            is_shared = self.shared_steps > 0
            lacks = lacks_of(life, is_bounded, is_short, is_awaited, is_shared, is_standing)
            self.lacks = (*lacks, *self._looks_like, *((Lack.BURST,) if is_burst else ()))
        is_over, aim = self.is_over, self._config.aim
        return estimate_of(life, place, belief.extent, plume, is_over, motion, aim, pose.attitude, errors)

    def consider(self, is_in_the_sky: bool, is_on_the_lens: bool) -> None:
        """Whether what was seen in this step can be smoke on the ground: what cannot is not believed, or no longer.

        What may be on the lens is not believed yet, but keeps what it has: a gimbal that holds a fire in the middle of
        the image while the heading's error drifts looks the same.
        """
        is_small = is_too_small(self.belief.extent)
        is_no_smoke = is_in_the_sky or is_small
        looks = ((Lack.IN_THE_SKY, is_in_the_sky), (Lack.TOO_SMALL, is_small), (Lack.ON_THE_LENS, is_on_the_lens))
        self._looks_like = tuple(lack for lack, is_so in looks if is_so)
        if is_no_smoke and self.life is not None:
            self.life.withdraw()
        self.is_plausible = not (is_no_smoke or is_on_the_lens)
