"""Many targets: each segment goes to the track that expects it, the others start tracks of their own."""

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import replace

import numpy as np

from distloc.filter.bank import Bank
from distloc.filter.calibrated_filter import CalibratedFilter
from distloc.filter.ground import Ground, NoGround
from distloc.filter.particles import Places
from distloc.filter.settings import LocalizerConfig
from distloc.geometry.camera import Camera
from distloc.sights.detections import joined
from distloc.sights.sights import Ray, ray_of, rays_of
from distloc.snapshot import LocalizerSnapshot
from distloc.tracks.assignment.apart import Apart
from distloc.tracks.assignment.assigned import Pair, assigned
from distloc.tracks.assignment.clutter import Clutter
from distloc.tracks.assignment.hidden import covering, is_hidden
from distloc.tracks.assignment.pieces import pieces_of
from distloc.tracks.assignment.shift import drift_of
from distloc.tracks.estimates.outlook import Outlook, outlook_of
from distloc.tracks.estimates.reports import estimates_of, judge_motion
from distloc.tracks.expected import in_view, is_well_inside
from distloc.tracks.explanation import Explanation
from distloc.tracks.looks.aim_error import AimErrors
from distloc.tracks.looks.dirt import Dirt
from distloc.tracks.looks.looks import Looks
from distloc.tracks.looks.sightings import Seen, weigh
from distloc.tracks.motion.heading_scale import HeadingScale
from distloc.tracks.plausibility import are_in_the_sky, feet_of, stay_on_the_lens
from distloc.tracks.pool import MAX_CANDIDATES, USUAL_PLACES, Pool, is_due
from distloc.tracks.target_track import Track
from distloc.types import CameraPose, Detection, FloatArray, MaskArray, PoseErrors, TargetEstimate, TargetState

_MERGED_STEPS = 10  # in a row that two tracks share one segment


class Tracker:
    """A fixed pool of tracks, whose filters have a place each in one bank. The localizer calls it."""

    def __init__(self, camera: Camera, config: LocalizerConfig, rng: np.random.Generator) -> None:
        self.ground: Ground = NoGround()
        self.camera, self._config = camera, config
        places = config.max_targets + MAX_CANDIDATES
        self._bank = Bank(places, config.n_particles, rng, config.range_m, config.platforms)
        self._platform, self.dirt = "", Dirt(camera, config.pixel_sigma_px)  # of the platform that looked last
        self._pose: CameraPose | None = None  # of the last step
        self._shown_s: dict[str, float] = {}  # when each platform last saw a target
        self._bank.particles.write(USUAL_PLACES)
        self._looks, self._heading_scale = Looks(places, self._bank.names, config), HeadingScale()
        self._aims, self._apart = AimErrors(places, self._looks), Apart(places)
        self._pool, self._clutter = Pool(self._bank, self._aims, config, rng.spawn(1)[0]), Clutter(camera)

    @property
    def _tracks(self) -> list[Track]:
        return self._pool.tracks

    def step(self, pose: CameraPose, mask: MaskArray | None, detections: list[Detection]) -> list[TargetEstimate]:
        """One filter step of every track; the estimates of those that are told of, a dismissed one once."""
        errors = pose.errors or self._config.pose_errors
        if pose.attitude is None and self._config.platforms == 1:  # of several compasses each errs in its own way
            errors = self._heading_scale.scaled(errors)
            pose = replace(pose, errors=errors)
        self._pose = pose
        self._bank.particles.begin_step()
        self._predict(pose, errors)
        rays = rays_of(
            self.camera, pose, self.dirt.split(pose, detections, errors.attitude_white_rad), self._config.aim
        )
        taken, used = self._assign(pose, errors, rays)
        self._pool.start([ray for index, ray in enumerate(rays) if index not in used], self.ground)
        self._pool.report(pose)
        told = self._pool.reported
        self._merge(told, taken, pose)
        self._consider([track for track in taken if track.life is not None], pose, errors)
        self._pool.give_up_dirt(self.dirt, pose.platform)
        estimates = self._estimates(told, taken, pose, errors)
        self._pool.drop_over()
        self._apart.keep([track.filter.place for track in self._tracks])
        return estimates

    def doubt_attitude(self, platform: str | None = None, is_measured: bool = False) -> None:
        """An autopilot began anew: its attitude may be wrong by other amounts than before.

        That of the platform that looked last where none is named. `is_measured` says that the scenery's is used now.
        """
        with self._aboard(platform) as name:
            for track in self._tracks:
                track.belief.doubt_attitude(name, is_measured)

    def snapshot(self) -> LocalizerSnapshot:
        """The tracks that were told of."""
        tracks = tuple(track.snapshot() for track in self._pool.reported)
        return LocalizerSnapshot(self._pool.next_id, tracks, self._platform)

    def restore(self, saved: LocalizerSnapshot) -> None:
        """Go on from a snapshot; only before the first step."""
        if self._tracks or self._pool.next_id > 1 or len(saved.tracks) > self._config.max_targets:
            raise ValueError(
                f"a snapshot of {len(saved.tracks)} targets needs as many places and no step before it, "
                f"there are {self._config.max_targets} places and {len(self._tracks)} tracks"
            )
        self._pool.tracks = [
            Track.restored(self._filter_at(place, saved.platform), one, self._config, self._aims)
            for place, one in enumerate(saved.tracks)
        ]
        self._pool.next_id, self._platform = saved.next_id, saved.platform
        self._apart.part([one.filter.place for one in self._tracks if one.is_believed])

    def heading_jumped(self, by_rad: float, platform: str | None = None, is_measured: bool = False) -> None:
        """The reported heading, and so its error, is another by an angle, clockwise from above; of whom as above."""
        with self._aboard(platform) as name:
            for track in self._tracks:
                track.belief.heading_jumped(by_rad, name, is_measured)

    def particles_enu_m(self, target_id: int) -> FloatArray | None:
        """Equally likely particles (3, n) of a live target."""
        for track in self._tracks:
            if track.life is not None and track.life.id == target_id:
                return track.filter.positions_enu_m()
        return None

    def outlook(self, target_id: int) -> Outlook | None:
        """What is known of a target after the last step, to foretell by; None where there is none such."""
        pose = self._pose
        if pose is None:
            return None
        errors = pose.errors or self._config.pose_errors
        for track in self._tracks:
            if track.life is not None and track.life.id == target_id:
                return outlook_of(track, pose, errors)
        return None

    def explain(self, camera_enu_m: FloatArray) -> Explanation:
        """What there is, as seen from a camera after a step, and why it is not confirmed."""
        return self._pool.explain(camera_enu_m)

    @contextmanager
    def _aboard(self, platform: str | None) -> Iterator[str]:
        """A platform of which something is told while it does not look, None for that which did; its name."""
        before = self._platform
        if platform is None or platform == before or not self._tracks:
            yield before
            return
        self._board(platform)
        yield platform
        self._board(before)

    def _board(self, platform: str) -> None:
        """From now on it is this platform's camera that looks."""
        self._platform = platform
        _, places = _by_place(self._tracks)
        self._bank.board(places, platform)
        self._looks.board(places, platform)

    def _filter_at(self, place: int, platform: str) -> CalibratedFilter:
        filter_ = CalibratedFilter(self._bank, place)
        if self._config.platforms > 1:
            filter_.clear(platform)
        return filter_

    def _predict(self, pose: CameraPose, errors: PoseErrors) -> None:
        """Let the filters forget until a step's pose; what contradicts a bias that is found now is begun anew."""
        self._board(pose.platform)
        tracks, places = _by_place(self._tracks)
        self._drift = drift_of(self._shown_s.get(pose.platform, -np.inf), pose, errors)
        if pose.attitude is None:
            self._bank.predict(places, pose.stamp_s, errors)
        else:
            is_expected = self._bank.follow(places, pose.stamp_s, pose.attitude)
            for index in np.flatnonzero(~is_expected):
                tracks[index].contradicted()
        for track in tracks:
            track.memory.step(pose)

    def _assign(self, pose: CameraPose, errors: PoseErrors, rays: list[Ray]) -> tuple[dict[Track, Pair], set[int]]:
        """Each track's detection, which its filter has weighed, and which of them are used.

        Pieces of a confirmed target that lie beside its detection are used with it.
        """
        tracks, places = _by_place(self._tracks)
        view = in_view(self._bank, places, self.camera, pose)
        found = assigned(
            self._bank, self._looks, tracks, view, pose, errors, rays, self._config, self._clutter, self._drift
        )
        taken, used = found.taken, found.used
        if found.carried is not None:
            since_s = self._shown_s.get(pose.platform, -np.inf)
            unseen = (one for one in tracks if one not in taken and one.is_unseen_since(since_s))
            found.carried.give(self._bank, _by_place(unseen)[1])
            self._shown_s[pose.platform] = pose.stamp_s
        pixels = dict(zip(tracks, view.pixel, strict=True))
        seen: list[Seen] = []
        for track, pair in taken.items():
            one = Seen(track, rays[pair.detection], pair.sight, pair.innovation, pair.squared, False)
            is_confirmed = track.life is not None and track.life.state is TargetState.CONFIRMED
            expected_px = self._looks.sizes.expected_px[self._looks.own[track.filter.place]]
            pieces = pieces_of(pixels[track], expected_px, rays, pair.detection, used) if is_confirmed else set()
            if pieces:
                whole = joined([rays[index].detection for index in (pair.detection, *pieces)])
                ray = ray_of(self.camera, pose, whole, self._config.aim)
                sight = track.belief.sight(ray)
                one = Seen(track, ray, sight, *track.filter.innovation(sight), True)
                used |= pieces
            seen.append(one)
        if seen:
            weigh(self._bank, self._aims, seen)
        known = [track for track in taken if track.life is not None or is_due(track)]
        self._clutter.learn(len(rays) - len(known) - len(found.waiting))
        detections = [*(ray.detection for ray in rays), *self.dirt.seen]
        for track in self._tracks:
            if track in found.waiting:
                track.hidden_by = None
            elif track not in taken:
                self._miss(track, pixels[track], pose, detections)
        return taken, used

    def _miss(self, track: Track, pixel: FloatArray, pose: CameraPose, detections: list[Detection]) -> None:
        """No detection for a track: a miss where it must have been seen, and nothing else hides it."""
        track.unseen_steps += 1
        track.hidden_by = None
        # one that never saw it may be behind a ridge, or too far
        row = self._looks.own[track.filter.place]
        if not self._looks.is_seen[row]:
            return
        track.away_steps += 1
        if is_well_inside(pixel, self.camera):
            track.hidden_by = covering(pixel, detections)
            expected_px = self._looks.sizes.expected_px[row]
            if track.hidden_by is None and not is_hidden(pixel, expected_px, detections, self._config.aim):
                track.missed(pose)

    def _merge(self, told: list[Track], taken: dict[Track, Pair], pose: CameraPose) -> None:
        """Two tracks on one segment, in one place as far as anyone can tell, are one: the older stays.

        Not where both were seen beside each other before: then smoke has grown together, or hides the other's.
        """
        holders = {pair.detection: one for one, pair in taken.items() if one.life is not None}
        self._apart.seen([one for one in taken if one.life is not None])
        for track in told:
            holder = None if track.hidden_by is None else holders.get(track.hidden_by)
            if holder is not None:
                self._apart.share(track.filter.place, holder.filter.place)
                if self._apart.are(track.filter.place, holder.filter.place):
                    holder = None
            is_shared = holder is not None and self._are_one_place(track, holder, pose)
            track.shared_steps = track.shared_steps + 1 if is_shared else 0
            if track.shared_steps < _MERGED_STEPS or holder is None:
                continue
            if _id(track) < _id(holder):  # the older id goes on with the filter that follows the target
                self._apart.join(track.filter.place, holder.filter.place)
                taken[track] = taken.pop(holder)
                holders[taken[track].detection] = track
                track.adopt(holder)
                holder.is_given_up = True
            else:
                track.is_given_up = True

    def _are_one_place(self, one: Track, other: Track, pose: CameraPose) -> bool:
        """Whether their ranges differ by less than two standard deviations of the difference."""
        view = in_view(self._bank, np.array([one.filter.place, other.filter.place]), self.camera, pose)
        apart_m = float(view.range_m[0] - view.range_m[1])
        return abs(apart_m) < 2.0 * float(np.hypot(*view.range_sigma_m))

    def _consider(self, seen: list[Track], pose: CameraPose, errors: PoseErrors) -> None:
        """How large the targets that were seen are, and whether they can be smoke on the ground."""
        if not seen:
            return
        tracks, places = _by_place(seen)
        view = in_view(self._bank, places, self.camera, pose)
        rows, depth_m = self._looks.own[places], np.maximum(view.depth_m, 1.0)
        extents = self._looks.sizes.extents(rows, self.camera, depth_m, view.range_sigma_m)
        for track, extent in zip(tracks, extents, strict=True):
            track.belief.extent = extent or track.belief.extent
            track.highest_m = max(track.highest_m, float(pose.position_enu_m[2]))
        memories, clouds = [track.memory for track in tracks], self._bank.particles.clouds
        rays = [memory.frames[-1].ray for memory in memories]
        feet_enu_m = feet_of([ray for ray in rays if ray is not None], clouds.mean_enu_m[places])
        in_the_sky = are_in_the_sky(feet_enu_m, np.array([track.highest_m for track in tracks]), self.ground)
        sigma_px = float(np.hypot(self._config.pixel_sigma_px, self.camera.fx * errors.attitude_white_rad))
        on_the_lens = stay_on_the_lens(memories, clouds, places, self.camera, sigma_px)
        for track, is_in_the_sky, is_on_the_lens in zip(tracks, in_the_sky, on_the_lens, strict=True):
            track.consider(bool(is_in_the_sky), bool(is_on_the_lens))

    def _estimates(
        self, told: list[Track], taken: dict[Track, Pair], pose: CameraPose, errors: PoseErrors
    ) -> list[TargetEstimate]:
        if not told:
            return []
        judge_motion(told, self._bank, self._looks, self._heading_scale)
        return estimates_of(told, taken.keys(), self._bank, self._looks, pose, errors, self.ground)


def _by_place(tracks: Iterable[Track]) -> tuple[list[Track], Places]:
    """The tracks in the order of their places, and these."""
    ordered = sorted(tracks, key=lambda track: track.filter.place)
    return ordered, np.array([track.filter.place for track in ordered], dtype=np.intp)


def _id(track: Track) -> int:
    return track.life.id if track.life is not None else 0
