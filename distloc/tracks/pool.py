"""Whose the places of the bank are: what is new gets one, and where none is free the least useful track goes.

A target can be confirmed only once its range is bounded. So where all places are taken, what was watched and found to
be as far as anything, clouds and haze, goes for what has a range, and what cannot be smoke goes first. The tracker
asks.
"""

import math

import numpy as np

from distloc.filter.bank import Bank
from distloc.filter.calibrated_filter import CalibratedFilter
from distloc.filter.ground import Ground, ground_prior
from distloc.filter.particles import SPREAD, Places
from distloc.filter.settings import LocalizerConfig
from distloc.filter.uncertainty import TAILS, equal_parts, quantiles
from distloc.sights.sights import Ray, stands_upright
from distloc.snapshot import Float32Array
from distloc.tracks.explanation import Explanation, Lack, TrackExplanation
from distloc.tracks.life import CONFIRM_WINDOW
from distloc.tracks.looks.aim_error import AimErrors
from distloc.tracks.looks.dirt import Dirt
from distloc.tracks.target_track import BOUNDED_SHARE, Track
from distloc.types import CameraPose, FloatArray, TargetState

MAX_CANDIDATES = 24  # tracks that are not reported yet
USUAL_PLACES = 32  # more are in use at a time only where all is full of smoke
CANDIDATE_MISSES = 3  # in a row, by each platform, for one of them; out of view too
REPORT_SIGHTINGS, REPORT_WINDOW = 4, 6  # M of N for a track to be reported
_REPORTED_AT_ONCE = 4  # the others in the next steps: their frames are seen anew
# unseen for so many steps a target gives way to a new one when all places are taken
_FORGOTTEN_STEPS = {TargetState.TENTATIVE: 30, TargetState.CONFIRMED: 600, TargetState.COASTING: 600}
_IS_BOUNDED = 0.975  # of the particles are nearer: as the upper end of the 95 % interval is
_CLEARLY = 0.25  # of usefulness more than that of the one that goes, else both would take turns
_FAR_SHARE = 0.75  # of what a start has: so much less, and a candidate was watched and found far


class Pool:
    """At most `max_targets` reported tracks and `MAX_CANDIDATES` others, each at a place of its own in the bank.

    `left_out` counts the segments that no track explained and that got no place, of the last step and of all.
    """

    def __init__(self, bank: Bank, aims: AimErrors, config: LocalizerConfig, rng: np.random.Generator) -> None:
        self.tracks: list[Track] = []
        self.next_id = 1
        self.left_out = self.left_out_ever = 0
        self._bank, self._aims, self._config, self._rng = bank, aims, config, rng
        low_m, high_m = config.range_m
        self._bound_m = BOUNDED_SHARE * high_m
        self._start_share = max(0.0, math.log(self._bound_m / low_m)) / math.log(high_m / low_m)

    @property
    def reported(self) -> list[Track]:
        """Those that have a life, in the order of their ids."""
        return [track for _, track in sorted((one.life.id, one) for one in self.tracks if one.life is not None)]

    @property
    def candidates(self) -> list[Track]:
        """The others."""
        return [track for track in self.tracks if track.life is None]

    def start(self, rays: list[Ray], ground: Ground) -> None:
        """Tracks for the segments of a step that no track explains, by chance where not all of them get a place."""
        free = MAX_CANDIDATES - len(self.candidates)
        if len(rays) > free:
            free += self._make_room(len(rays) - free, rays[0].pose.position_enu_m)
            chosen = self._rng.permutation(len(rays))[:free]
            self.left_out = len(rays) - chosen.size
            rays = [rays[index] for index in sorted(chosen.tolist())]
        else:
            self.left_out = 0
        self.left_out_ever += self.left_out
        for ray in rays:
            self._start(ray, ground)

    def report(self, pose: CameraPose) -> None:
        """Give ids to candidates that were seen often enough, the most useful first; where no place is free one may go.

        Its place is free at the next step.
        """
        camera_enu_m = pose.position_enu_m
        due = [track for track in self.candidates if is_due(track)]
        free = self._config.max_targets - len(self.reported)
        if len(due) > free:
            due = [due[index] for index in np.argsort(-self.usefulness(due, camera_enu_m), kind="stable").tolist()]
        for track in due[: min(free, _REPORTED_AT_ONCE)]:
            track.promote(self.next_id, pose)
            self.next_id += 1
        if due and free <= 0:
            self._give_way(due, camera_enu_m)

    def give_up_dirt(self, dirt: Dirt, platform: str) -> None:
        """Tracks of what is known to be dirt on this platform's lens, which looks now, are over."""
        if dirt.seen:
            for track in self.tracks:
                if dirt.is_all_of(*track.memory.segments_by(platform)):
                    track.is_given_up = True

    def drop_over(self) -> None:
        """Forget the tracks that are over."""
        self.tracks = [track for track in self.tracks if not self._is_over(track)]

    def usefulness(self, tracks: list[Track], camera_enu_m: FloatArray) -> FloatArray:
        """How nearly each (k,) can be confirmed, 0 to 1: by whether its range is bounded and how often it was seen."""
        seen = np.array([track.memory.sightings_of_last(CONFIRM_WINDOW) for track in tracks]) / CONFIRM_WINDOW
        is_plausible = np.array([track.is_plausible for track in tracks])
        return np.asarray(self._nearer_shares(tracks, camera_enu_m) * seen * is_plausible)

    def explain(self, camera_enu_m: FloatArray) -> Explanation:
        """What there is, seen from a camera, and why it is not confirmed."""
        tracks = self.tracks
        if not tracks:
            return self._explanation(())
        useful, far_m = self.usefulness(tracks, camera_enu_m), self._ranges95_m(camera_enu_m)
        is_full = len(self.reported) >= self._config.max_targets
        order = sorted(range(len(tracks)), key=lambda index: (_rank(tracks[index]), -useful[index]))
        return self._explanation(tuple(self._explained(tracks[i], far_m[i], is_full) for i in order))

    def _explanation(self, tracks: tuple[TrackExplanation, ...]) -> Explanation:
        reported = len(self.reported)
        return Explanation(
            tracks=tracks,
            places=self._config.max_targets,
            places_used=reported,
            candidate_places=MAX_CANDIDATES,
            candidates=len(self.tracks) - reported,
            left_out=self.left_out,
            left_out_ever=self.left_out_ever,
        )

    def _explained(self, track: Track, range95_m: tuple[float, float], is_full: bool) -> TrackExplanation:
        life, sightings = track.life, track.memory.sightings_of_last(CONFIRM_WINDOW)
        if life is not None:
            return TrackExplanation(life.id, life.state, life.sightings, track.range95_m or range95_m, track.lacks)
        found = (
            (Lack.SIGHTINGS, not is_due(track)),
            (Lack.NO_PLACE, is_due(track) and is_full),
            (Lack.RANGE_UNBOUNDED, range95_m[1] >= self._bound_m),
        )
        return TrackExplanation(None, None, sightings, range95_m, tuple(lack for lack, is_so in found if is_so))

    def _ranges95_m(self, camera_enu_m: FloatArray) -> list[tuple[float, float]]:
        places = np.array([track.filter.place for track in self.tracks], dtype=np.intp)
        ranges_m, weights = ranges_of(self._bank, places, camera_enu_m)
        low_m, high_m = quantiles(equal_parts(ranges_m[None], weights)[0], TAILS).tolist()
        return list(zip(low_m, high_m, strict=True))

    def _nearer_shares(self, tracks: list[Track], camera_enu_m: FloatArray) -> FloatArray:
        """How likely each (k,) is so near that its range is bounded."""
        places = np.array([track.filter.place for track in tracks], dtype=np.intp)
        ranges_m, weights = ranges_of(self._bank, places, camera_enu_m)
        return np.asarray(((ranges_m < self._bound_m) * weights).sum(axis=1), np.float64)

    def _start(self, ray: Ray, ground: Ground) -> None:
        held = {track.filter.place for track in self.tracks}
        place = next(place for place in range(self._bank.places) if place not in held)
        # a segment that ends at the border, or in a picture that is rolled, has its foot nobody knows where
        is_whole = not ray.detection.touches_border and stands_upright(ray.pose)
        prior = ground_prior(ground, ray.pose.position_enu_m, ray.below_tangent) if is_whole else None
        self.tracks.append(Track.started(CalibratedFilter(self._bank, place), ray, prior, self._config, self._aims))

    def _make_room(self, wanted: int, camera_enu_m: FloatArray) -> int:
        """How many candidates, at most as many as wanted, gave way to new ones.

        First what was seen once and not again, then what was watched and found far.
        """
        candidates = self.candidates
        shares = self._nearer_shares(candidates, camera_enu_m)
        is_lone = np.array([_is_lone(one) for one in candidates], np.bool_)
        may_go = np.flatnonzero(is_lone | (shares < _FAR_SHARE * self._start_share))
        order = may_go[np.lexsort((shares[may_go], ~is_lone[may_go]))]
        gone = {candidates[index] for index in order[:wanted].tolist()}
        self.tracks = [track for track in self.tracks if track not in gone]
        return len(gone)

    def _give_way(self, due: list[Track], camera_enu_m: FloatArray) -> None:
        """One that was long unseen goes for any; one that was never confirmed for what has a range and is more useful.

        Without a range of its own the new one would be no better, and all would take turns.
        """
        reported = [(track, track.life) for track in self.reported if track.life is not None]
        unseen = [one for one, life in reported if one.unseen_steps >= _FORGOTTEN_STEPS[life.state]]
        if unseen:
            max(unseen, key=lambda one: one.unseen_steps).is_given_up = True
            return
        bounded = [
            track
            for track, share in zip(due, self._nearer_shares(due, camera_enu_m).tolist(), strict=True)
            if share >= _IS_BOUNDED
        ]
        unsure = [one for one, life in reported if life.state is TargetState.TENTATIVE]
        if bounded and unsure:
            useful = self.usefulness(unsure, camera_enu_m)
            if useful.min() + _CLEARLY < self.usefulness(bounded, camera_enu_m).max():
                unsure[int(useful.argmin())].is_given_up = True

    def _is_over(self, track: Track) -> bool:
        if track.life is None and not track.is_given_up:
            return track.unseen_steps >= CANDIDATE_MISSES * max(1, len(self._bank.names))  # they look in turn
        return track.is_over


def is_due(track: Track) -> bool:
    """Whether a candidate was seen often enough to be reported."""
    return track.memory.sightings_of_last(REPORT_WINDOW) >= REPORT_SIGHTINGS


def _is_lone(track: Track) -> bool:
    return track.unseen_steps > 0 and track.memory.sightings_of_last(CONFIRM_WINDOW) < 2


def _rank(track: Track) -> int:
    """Believed ones first, candidates last."""
    if track.life is None:
        return 2
    return 1 if track.life.state is TargetState.TENTATIVE else 0


def ranges_of(bank: Bank, places: Places, camera_enu_m: FloatArray) -> tuple[Float32Array, Float32Array]:
    """Distances (k, m) from a camera of a sample of the particles at these places, and their weights (k, m)."""
    x, weights = bank.particles.sampled(places, SPREAD, rows=3)
    offsets_m = x + (bank.particles.origin_enu_m[places] - camera_enu_m).astype(np.float32)[:, :, None]
    return np.sqrt(np.square(offsets_m).sum(axis=1)), weights
