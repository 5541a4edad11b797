"""What a frame goes through, live and in a replay: may it be used, where was the camera, what is in it, where is that.

No sockets, no threads and no clock: the flight and the replay bring frames, times and what takes the results.
"""

import logging
from collections import Counter
from collections.abc import Iterable

from distloc.types import CameraPose, RejectReason
from service.autopilot.autopilot import Autopilot
from service.camera.blind import BlindWatch
from service.camera.frozen import FreezeWatch
from service.camera.garbled import GarbleWatch
from service.camera.sources import fits
from service.common.degraded import Degraded
from service.common.messages import Frame, LocatedTarget
from service.config.sections import Config
from service.localise.adviser import Adviser
from service.localise.scenery import Scenery
from service.localise.stage import Localised, LocaliseStage, Locator
from service.localise.track_keeper import Keeper
from service.segmenters.segment import Segmenter

log = logging.getLogger(__name__)


class FrameGate:
    """Which frames may be used, and the camera's pose at each; `rejects` counts the others by reason."""

    def __init__(self, config: Config, autopilot: Autopilot) -> None:
        self.autopilot = autopilot
        self.rejects: Counter[RejectReason] = Counter()
        self._camera = config.camera.camera()
        self._blind, self._frozen, self._garbled = BlindWatch(), FreezeWatch(), GarbleWatch()

    def admit(self, frame: Frame) -> RejectReason | None:
        """Why a frame tells nothing, or None; each frame is asked of once, in the order in which they were taken."""
        reason = self._fault(frame)
        if reason is not None:
            self.rejects[reason] += 1
        return reason

    def pose(self, frame: Frame, now_ns: int) -> CameraPose | RejectReason | None:
        """The camera's pose at the frame, or why there is none; None: ask again later, a sample may still come."""
        pose = self.autopilot.camera_pose(frame.stamp_ns, now_ns)
        if isinstance(pose, RejectReason):
            self.rejects[pose] += 1
        return pose

    def degraded(self) -> Iterable[Degraded]:
        """What is wrong with the pictures."""
        if self._blind.is_blind():
            yield Degraded.CAMERA_BLIND
        elif self._frozen.is_frozen():
            yield Degraded.CAMERA_FROZEN

    def _fault(self, frame: Frame) -> RejectReason | None:
        if frame.image is not None and not fits(self._camera, frame.image):
            return RejectReason.BAD_FRAME
        if self._blind.sees_nothing(frame):  # asked first: an overexposed camera gives the same white again
            return RejectReason.BLIND_FRAME
        if self._garbled.is_garbled(frame):
            return RejectReason.BAD_FRAME
        return RejectReason.FROZEN_FRAME if self._frozen.is_repeated(frame) else None


class FramePipeline:
    """One flight's frames to located targets: `gate`, then `localise`, which may run on a thread, then `located`."""

    def __init__(
        self,
        config: Config,
        segmenter: Segmenter,
        gate: FrameGate,
        seed: int | None = None,
        keeper: Keeper | None = None,
        scenery: Scenery | None = None,
        adviser: Adviser | None = None,
    ) -> None:
        self.gate = gate
        self.stage = LocaliseStage(config, segmenter, gate.autopilot, seed, keeper, scenery, adviser)
        self._locator = Locator(gate.autopilot, self.stage.adviser.current)

    def localise(self, frame: Frame, pose: CameraPose) -> Localised:
        """Segment the frame and step the localizer; whatever fails costs this frame alone."""
        try:
            return self.stage.process(frame, pose)
        except Exception:
            log.exception("frame %s was not localised", frame.name)
            self.gate.rejects[RejectReason.SEGMENTATION_FAILED] += 1
            return Localised(frame, pose, None, (), RejectReason.SEGMENTATION_FAILED)

    def located(self, localised: Localised) -> list[LocatedTarget]:
        """What the frame changed, on the map."""
        return self._locator.locate(localised.estimates, localised.frame.stamp_ns)

    @property
    def rejects(self) -> Counter[RejectReason]:
        """Frames that were not used, by reason."""
        total: Counter[RejectReason] = Counter()
        for part in (self.gate.rejects, self.stage.rejects):
            total.update(dict(part))  # copied at once: another thread may count on
        return total
