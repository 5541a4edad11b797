"""The localise stage: a frame and its pose in, located targets out. The live service and the replay both run it."""

import math
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass

import msgspec
import numpy as np
from numpy.typing import NDArray

from distloc.advice.advise import Advice
from distloc.filter.settings import ENOUGH_PARTICLES, LocalizerConfig
from distloc.geometry.geodesy import LocalFrame
from distloc.localizer import Localizer
from distloc.tracks.explanation import Explanation
from distloc.types import CameraPose, FloatArray, RejectReason, TargetEstimate
from service.autopilot.autopilot import Autopilot
from service.common.messages import Frame, Geodetic, LocatedTarget
from service.config.sections import Config, LocaliserSection
from service.localise.adviser import Adviser
from service.localise.ground_prior import GroundKeeper
from service.localise.scenery import Scenery, make_compass, make_scenery
from service.localise.track_keeper import Keeper, NoKeeper
from service.segmenters.segment import Segmenter


@dataclass(frozen=True, slots=True)
class Localised:
    """What one frame gave: the mask (or None and the reason) and the estimates that changed.

    `pose` is the reported one, `best_pose` has the attitude that the scenery corrected, where it did.
    """

    frame: Frame
    pose: CameraPose
    mask: NDArray[np.uint8] | None
    estimates: tuple[TargetEstimate, ...]
    reason: RejectReason | None = None
    best_pose: CameraPose | None = None


def localizer_config(section: LocaliserSection) -> LocalizerConfig:
    """As the section says, with no more particles for a target than tell anything."""
    settings = msgspec.structs.asdict(section)
    del settings["seed"]
    if section.filter == "calibrated":
        settings["n_particles"] = min(section.n_particles, ENOUGH_PARTICLES)
    return LocalizerConfig(**settings)


class LocaliseStage:
    """Owns the segmenter, the localizer and its ground; called from one thread."""

    def __init__(
        self,
        config: Config,
        segmenter: Segmenter,
        autopilot: Autopilot,
        seed: int | None = None,
        keeper: Keeper | None = None,
        scenery: Scenery | None = None,
        adviser: Adviser | None = None,
    ) -> None:
        section = config.localizer
        rng = np.random.Generator(np.random.SFC64(section.seed if seed is None else seed))
        camera = config.camera.camera()
        self.scenery = scenery or make_scenery(config, camera, lambda: autopilot.frame_enu)
        self.localizer = Localizer(camera, localizer_config(section), rng=rng, compass=make_compass(config, camera))
        self.ground = GroundKeeper(config.ground, autopilot, self.localizer.set_ground)
        self.rejects: Counter[RejectReason] = Counter()
        self.frames = 0
        self.explanation = Explanation()  # after the last frame; others may read it on their thread
        self._autopilot, self._epoch = autopilot, autopilot.epoch
        self._turned_rad = 0.0
        self.segmenter, self.keeper = segmenter, keeper or NoKeeper()
        self.adviser = adviser or Adviser(config)
        self._last: dict[int, TargetEstimate] = {}

    def process(self, frame: Frame, pose: CameraPose) -> Localised:
        """Segment one frame, take the scenery's corners in it and step the localizer.

        Corners are asked for after the segmentation, so that none lies in the smoke of this very frame, and also where
        there is no mask: they need short hops.
        """
        mask = self.segmenter.segment(frame, pose)
        corners = self.scenery.track(frame, pose, mask)
        if isinstance(mask, RejectReason):
            self.rejects[mask] += 1
            return Localised(frame, pose, None, (), mask)
        self.frames += 1
        self.ground.ask(pose.position_enu_m)
        if self._autopilot.epoch != self._epoch:
            self._epoch = self._autopilot.epoch
            self.localizer.doubt_attitude()
        if not self.keeper.take_up(self.localizer, pose):
            return Localised(frame, pose, mask, ())
        turned_rad = self._autopilot.heading_turned_rad(frame.stamp_ns)
        if turned_rad != self._turned_rad:
            self.localizer.heading_jumped(math.remainder(turned_rad - self._turned_rad, 2.0 * math.pi))
            self._turned_rad = turned_rad
        estimates = self.localizer.step(pose, mask, corners)
        self.explanation = self.localizer.explain()
        self.adviser.ask(self.localizer, estimates, pose.stamp_s)
        self.scenery.note(self.localizer.compass)
        changed = tuple(one for one in estimates if self._last.get(one.id) is not one)
        self._last = {one.id: one for one in estimates}
        self.keeper.keep(self.localizer, pose, bool(changed))
        return Localised(frame, pose, mask, changed, best_pose=self.scenery.state.corrected(pose))

    def particles_enu_m(self, target_id: int) -> FloatArray | None:
        """A copy of a target's particles (3, N), for a picture."""
        particles = self.localizer.particles_enu_m(target_id)
        return None if particles is None else particles.copy()


class Locator:
    """Puts estimates on the map and on the calendar: the autopilot's origin, heights, UTC and faults."""

    def __init__(self, autopilot: Autopilot, advised: Callable[[int, float], Advice | None] = lambda *_: None) -> None:
        self._autopilot, self._advised = autopilot, advised
        self._sequence = 0

    def locate(self, estimates: tuple[TargetEstimate, ...], stamp_ns: int) -> list[LocatedTarget]:
        """The estimates of the frame at `stamp_ns` with their places; non-finite ones are never passed on."""
        frame_enu = self._autopilot.frame_enu
        if frame_enu is None:
            return []
        return [self._located(one, frame_enu, stamp_ns) for one in estimates if _is_finite(one)]

    def _located(self, estimate: TargetEstimate, frame_enu: LocalFrame, stamp_ns: int) -> LocatedTarget:
        self._sequence += 1
        place = Geodetic(*frame_enu.geodetic_from_enu(estimate.position_enu_m))
        plume = estimate.plume
        undulation_m = self._autopilot.place.geoid_undulation_m
        time_utc_s, source = self._autopilot.utc_s(stamp_ns)
        return LocatedTarget(
            estimate=estimate,
            place=place,
            ellipsoidal_height_m=None if undulation_m is None else place.alt_msl_m + undulation_m,
            epoch=self._autopilot.epoch,
            sequence=self._sequence,
            time_utc_s=time_utc_s,
            time_source=source,
            first_seen_utc_s=self._autopilot.utc_s(round(estimate.first_seen_s * 1e9))[0],
            last_seen_utc_s=self._autopilot.utc_s(round(estimate.last_seen_s * 1e9))[0],
            degraded=self._autopilot.degraded(stamp_ns),
            advice=self._advised(estimate.id, stamp_ns * 1e-9),
            plume_place=None if plume is None else Geodetic(*frame_enu.geodetic_from_enu(plume.centre_enu_m)),
        )


def _is_finite(estimate: TargetEstimate) -> bool:
    numbers = [estimate.position_enu_m, estimate.covariance_enu_m2.ravel()]
    plume = estimate.plume
    if plume is not None:
        numbers += [plume.centre_enu_m, np.array([plume.lean_rad, plume.drift_rad])]
    return bool(np.isfinite(np.concatenate(numbers)).all())
