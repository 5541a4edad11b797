"""Many targets: each segment goes to the track that expects it, the others start tracks of their own."""

from dataclasses import dataclass

import numpy as np

from distloc.filter.calibrated_filter import CalibratedFilter
from distloc.filter.ground import Ground, NoGround, ground_prior
from distloc.filter.particles import Workspace
from distloc.geometry.camera import Camera
from distloc.localizer_config import LocalizerConfig
from distloc.sights.detections import joined
from distloc.sights.sight import Sight
from distloc.sights.sights import Ray, ray_of, size_px
from distloc.snapshot import LocalizerSnapshot
from distloc.tracks.expected import is_well_inside
from distloc.tracks.target_track import MUCH_LARGER, Track
from distloc.types import CameraPose, Detection, FloatArray, MaskArray, TargetEstimate, TargetState

CLUTTER_DENSITY = 1.0  # false segments expected in a frame, for each unit of tangent squared: about one in the image
_MAX_EMBRYOS = 24  # tracks that nobody is told of yet
_EMBRYO_PARTICLES = 4096
_TOLD_SIGHTINGS, _TOLD_WINDOW = 4, 6  # M of N for a track to be told of
_EMBRYO_MISSES = 3  # in a row, for one that nobody was told of; out of view too
# unseen for so many steps a target gives way to a new one when all places are taken
_FORGOTTEN_STEPS = {TargetState.TENTATIVE: 30, TargetState.CONFIRMED: 600, TargetState.COASTING: 600}
_WHOLE = 0.75  # of the expected size
_MERGED_STEPS = 10  # in a row that two tracks share one segment


@dataclass(frozen=True, slots=True)
class _Pair:
    """A detection that a track may have made."""

    score: float
    track: Track
    detection: int
    sight: Sight


class Tracker:
    """A fixed pool of tracks with a calibrated filter each. The localizer calls it."""

    def __init__(self, camera: Camera, config: LocalizerConfig, rng: np.random.Generator) -> None:
        self.ground: Ground = NoGround()
        self.camera, self._config = camera, config
        rngs = rng.spawn(config.max_targets + _MAX_EMBRYOS)
        self._workspace = Workspace(config.n_particles)
        small = Workspace(min(_EMBRYO_PARTICLES, config.n_particles))
        self._large = self._filters(self._workspace, rngs[: config.max_targets])
        self._small = self._filters(small, rngs[config.max_targets :])
        self._tracks: list[Track] = []
        self._next_id = 1

    def step(self, pose: CameraPose, mask: MaskArray | None, detections: list[Detection]) -> list[TargetEstimate]:
        """One filter step of every track; the estimates of those that are told of, a dismissed one once."""
        self._workspace.begin_step()
        for track in self._tracks:
            track.predict(pose)
        rays = [ray_of(self.camera, pose, detection, self._config.aim) for detection in detections]
        taken, used = self._assign(pose, rays)
        for track in self._tracks:
            if track not in taken:
                self._miss(track, pose, detections)
        for index, ray in enumerate(rays):
            if index not in used:
                self._start(ray)
        for track in self._tracks:
            if track.life is None and track.memory.sightings_of_last(_TOLD_WINDOW) >= _TOLD_SIGHTINGS:
                self._tell_of(track)
        told = [track for track in self._tracks if track.life is not None]
        self._merge(told, taken, pose)
        for track in taken:
            track.measure_extent(self.camera, pose)
            track.consider(self.camera, pose, self.ground)
        estimates = [track.estimate(pose, track in taken) for track in told]
        for track in [track for track in self._tracks if self._is_over(track)]:
            self._release(track)
        return estimates

    def doubt_attitude(self) -> None:
        """The autopilot began anew: its attitude may be wrong by other amounts than before."""
        for track in self._tracks:
            track.filter.doubt_attitude()

    def snapshot(self) -> LocalizerSnapshot:
        """The tracks that were told of."""
        return LocalizerSnapshot(
            self._next_id, tuple(track.snapshot() for track in self._tracks if track.life is not None)
        )

    def restore(self, saved: LocalizerSnapshot) -> None:
        """Go on from a snapshot; only before the first step."""
        if self._tracks or self._next_id > 1 or len(saved.tracks) > len(self._large):
            raise ValueError(
                f"a snapshot of {len(saved.tracks)} targets needs as many places and no step before it, "
                f"there are {len(self._large)} places and {len(self._tracks)} tracks"
            )
        held = len(saved.tracks)
        self._tracks = [
            Track.restored(filter_, one, self._config)
            for filter_, one in zip(self._large[:held], saved.tracks, strict=True)
        ]
        del self._large[:held]
        self._next_id = saved.next_id

    def heading_jumped(self, by_rad: float) -> None:
        """The reported heading, and so its error, is another by an angle, clockwise from above."""
        for track in self._tracks:
            track.heading_jumped(by_rad)

    def particles_enu_m(self, target_id: int) -> FloatArray | None:
        """Equally likely particles (3, n) of a live target."""
        for track in self._tracks:
            if track.life is not None and track.life.id == target_id:
                return track.filter.particles.positions_enu_m()
        return None

    def _filters(self, workspace: Workspace, rngs: list[np.random.Generator]) -> list[CalibratedFilter]:
        filters = [CalibratedFilter(workspace.n, rng, self._config.range_m, workspace) for rng in rngs]
        for one in filters:
            one.particles.write()
        return filters

    def _assign(self, pose: CameraPose, rays: list[Ray]) -> tuple[dict[Track, _Pair], set[int]]:
        """One detection at most to each track, the best matches first, those told of before the others.

        Pieces of a confirmed target that lie beside its detection are used with it.
        """
        pairs = []
        for track in self._tracks:
            low, high = track.reach_px(self.camera, pose)
            for index, ray in enumerate(rays):
                margin = 10.0 * ray.detection.sigma_px + ray.size_px
                pixel = ray.detection.centre_px
                if (pixel < low - margin).any() or (pixel > high + margin).any() or not track.is_like(ray):
                    continue
                sight = track.sight(ray)
                score = track.filter.log_likelihood(sight) - float(np.log(CLUTTER_DENSITY))
                if score > 0.0:
                    pairs.append(_Pair(score, track, index, sight))
        pairs.sort(key=lambda pair: (pair.track.life is None, -pair.score))
        taken: dict[Track, _Pair] = {}
        used: set[int] = set()
        for pair in pairs:
            if pair.track not in taken and pair.detection not in used:
                taken[pair.track] = pair
                used.add(pair.detection)
        for track, pair in taken.items():
            ray, sight = rays[pair.detection], pair.sight
            pieces = self._pieces(track, pose, rays, pair.detection, used)
            if pieces:
                whole = joined([rays[index].detection for index in (pair.detection, *pieces)])
                ray = ray_of(self.camera, pose, whole, self._config.aim)
                sight = track.sight(ray)
                used |= pieces
            track.hit(ray, sight, is_joined=bool(pieces))
        return taken, used

    def _pieces(self, track: Track, pose: CameraPose, rays: list[Ray], own: int, used: set[int]) -> set[int]:
        """Detections that make a confirmed target's whole again, with its own; none where they would make more."""
        pixel, expected_px = track.pixel(self.camera, pose), track.expected_size_px
        is_confirmed = track.life is not None and track.life.state is TargetState.CONFIRMED
        if pixel is None or expected_px is None or not is_confirmed:
            return set()
        if (rays[own].size_px >= _WHOLE * expected_px).all():
            return set()  # it lacks nothing: what is beside it is something else
        pieces = {
            i
            for i, ray in enumerate(rays)
            if i not in used and _is_within(ray.detection.centre_px, pixel, MUCH_LARGER * expected_px - ray.size_px)
        }
        if not pieces:
            return set()
        whole = joined([rays[index].detection for index in (own, *pieces)])
        return pieces if (size_px(whole) <= MUCH_LARGER * expected_px).all() else set()

    def _miss(self, track: Track, pose: CameraPose, detections: list[Detection]) -> None:
        """No detection for a track: a miss where it must have been seen, and nothing else hides it."""
        pixel = track.pixel(self.camera, pose)
        track.unseen_steps += 1
        track.hidden_by = None
        if pixel is None or not is_well_inside(pixel, self.camera):
            return
        track.hidden_by = next(
            (i for i, one in enumerate(detections) if _is_within(pixel, one.centre_px, size_px(one))), None
        )
        if track.hidden_by is None:
            track.missed(pose)

    def _start(self, ray: Ray) -> None:
        if not self._small:
            return
        # a segment that ends at the border has its foot nobody knows where
        is_whole = not ray.detection.touches_border
        prior = ground_prior(self.ground, ray.pose.position_enu_m, ray.below_tangent) if is_whole else None
        self._tracks.append(Track.started(self._small.pop(), ray, prior, self._config))

    def _tell_of(self, track: Track) -> None:
        """Give it an id and, while there is one, a large filter that sees again what the small one saw."""
        if not self._large:
            unseen = [
                one
                for one in self._tracks
                if one.life is not None and one.unseen_steps >= _FORGOTTEN_STEPS[one.life.state]
            ]
            if unseen:  # its place is free at the next step
                max(unseen, key=lambda one: one.unseen_steps).is_given_up = True
            return
        small = track.filter
        track.promote(self._large[-1], self._next_id)
        self._large.pop()  # only now: what fails above must not cost a place
        self._next_id += 1
        self._small.append(small)

    def _merge(self, told: list[Track], taken: dict[Track, _Pair], pose: CameraPose) -> None:
        """Two tracks on one segment, in one place as far as anyone can tell, are one: the older stays."""
        for track in told:
            holder = next(
                (one for one, pair in taken.items() if pair.detection == track.hidden_by and one.life is not None), None
            )
            is_shared = track.hidden_by is not None and holder is not None and _are_one_place(track, holder, pose)
            track.shared_steps = track.shared_steps + 1 if is_shared else 0
            if track.shared_steps < _MERGED_STEPS or holder is None:
                continue
            if _id(track) < _id(holder):  # the older id goes on with the filter that follows the target
                track.adopt(holder)
                holder.is_given_up = True
            else:
                track.is_given_up = True

    def _is_over(self, track: Track) -> bool:
        if track.life is None:
            return track.unseen_steps >= _EMBRYO_MISSES
        return track.is_given_up or track.misses >= self._config.dismissal_misses

    def _release(self, track: Track) -> None:
        self._tracks.remove(track)
        (self._small if track.life is None else self._large).append(track.filter)


def _id(track: Track) -> int:
    return track.life.id if track.life is not None else 0


def _is_within(pixel: FloatArray, centre_px: FloatArray, size_px: FloatArray) -> bool:
    return bool((np.abs(pixel - centre_px) <= size_px / 2.0).all())


def _are_one_place(one: Track, other: Track, pose: CameraPose) -> bool:
    """Whether their ranges differ by less than two standard deviations of the difference."""
    apart_m = one.range_m(pose) - other.range_m(pose)
    return abs(apart_m) < 2.0 * float(np.hypot(one.range_sigma_m(pose), other.range_sigma_m(pose)))
