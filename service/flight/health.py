"""What the frames' ages say of camera and segmenter; the app puts it together with the other parts' words."""

import logging
from collections.abc import Iterable

from distloc.types import RejectReason
from service.common.degraded import Degraded

log = logging.getLogger(__name__)

_STALE_NS = 3_000_000_000
_SETTLED_NS = 2_000_000_000  # as the FaultTeller's: what comes and goes faster is not logged

# What lacks where frames are refused for a reason; every reason that a frame can get has a line.
NAMES = {
    RejectReason.NO_FIX: Degraded.FIX,
    RejectReason.POSITION_INVALID: Degraded.FIX,
    RejectReason.EKF_UNHEALTHY: Degraded.EKF,
    RejectReason.POSITION_JUMPED: Degraded.POSITION,
    RejectReason.ATTITUDE_INVALID: Degraded.POSE,
    RejectReason.GIMBAL_UNKNOWN: Degraded.GIMBAL,
    RejectReason.ZOOMED: Degraded.ZOOM,
    RejectReason.TURNING: Degraded.TURNING,
    RejectReason.NO_CLOCK: Degraded.CLOCK,
    RejectReason.NO_POSE: Degraded.POSE,
    RejectReason.STALE_POSE: Degraded.POSE,
    RejectReason.POSE_GAP: Degraded.RATES,
    RejectReason.FRAME_TOO_OLD: Degraded.CAMERA,
    RejectReason.FRAME_MISSING: Degraded.CAMERA,
    RejectReason.BAD_FRAME: Degraded.CAMERA,
    RejectReason.FROZEN_FRAME: Degraded.CAMERA_FROZEN,
    RejectReason.BLIND_FRAME: Degraded.CAMERA_BLIND,
    RejectReason.SEGMENTATION_FAILED: Degraded.SEGMENTER,
    RejectReason.SEGMENTATION_FLOODED: Degraded.SEGMENTER,
}
_OF_LINK = {Degraded.POSE, Degraded.CLOCK, Degraded.FIX}  # what lacks where nothing is heard: `link` says it


class FrameAges:
    """Since when no frame came, and since when those given have made no mask."""

    def __init__(self) -> None:
        self._heard_ns: int | None = None
        self._given_ns: int | None = None
        self._used_ns: int | None = None  # when a mask was made, or the first frame came
        self._refused_ns: dict[RejectReason, int] = {}

    def frame_heard(self, stamp_ns: int) -> None:
        """A frame came from the camera."""
        if self.is_camera_silent(stamp_ns):
            self._used_ns = stamp_ns
        self._heard_ns = stamp_ns

    def frame_given(self, now_ns: int) -> None:
        """A frame is handed to the localise stage."""
        if self._given_ns is None:
            self._given_ns = now_ns

    def frame_unusable(self, reason: RejectReason, now_ns: int) -> None:
        """One came that tells nothing: the segmenter has nothing to do."""
        self._given_ns = None
        self.frame_refused(reason, now_ns)

    def frame_refused(self, reason: RejectReason, now_ns: int) -> None:
        """One is not used."""
        self._refused_ns[reason] = now_ns

    def mask_made(self, now_ns: int) -> None:
        """The stage made a mask of one."""
        self._given_ns, self._used_ns = None, now_ns

    def refusals(self, now_ns: int) -> set[Degraded]:
        """What lacks where frames come and none was used for 3 s, by the reasons of that time."""
        if self._used_ns is None or now_ns - self._used_ns <= _STALE_NS:
            return set()
        recent = [reason for reason, at_ns in self._refused_ns.items() if now_ns - at_ns <= _STALE_NS]
        return {NAMES.get(reason, Degraded.POSE) for reason in recent}

    def is_camera_silent(self, now_ns: int) -> bool:
        """Whether no frame came for 3 s."""
        return self._heard_ns is None or now_ns - self._heard_ns > _STALE_NS

    def is_segmenter_late(self, now_ns: int) -> bool:
        """Whether no mask came for 3 s though frames were given: it fails, floods or takes this long."""
        return self._given_ns is not None and now_ns - self._given_ns > _STALE_NS


def degraded_names(
    now_ns: int,
    autopilot: Iterable[Degraded],
    ages: FrameAges,
    has_camera: bool,
    pictures: Iterable[Degraded],
    lost: Iterable[Degraded],
    is_compass_bad: bool = False,
) -> tuple[Degraded, ...]:
    """All that does not work as it should, sorted; a camera that is silent has no pictures to be blind or frozen."""
    names = {*autopilot, *lost}
    if has_camera and ages.is_camera_silent(now_ns):
        names.add(Degraded.CAMERA)
    else:
        names.update(pictures)
        names.update(ages.refusals(now_ns) - (_OF_LINK if Degraded.LINK in names else set()))
    if is_compass_bad:
        names.add(Degraded.COMPASS)
    if ages.is_segmenter_late(now_ns):
        names.add(Degraded.SEGMENTER)
    return tuple(sorted(names))


class DegradedLog:
    """Logs each change of the names once, as soon as it has stood for two seconds."""

    def __init__(self) -> None:
        self._told: tuple[Degraded, ...] = ()
        self._seen: tuple[Degraded, ...] = ()
        self._since_ns = 0

    def tell(self, names: tuple[Degraded, ...], now_ns: int) -> None:
        """The names as they are now."""
        if names != self._seen:
            self._seen, self._since_ns = names, now_ns
        if names == self._told or now_ns - self._since_ns < _SETTLED_NS:
            return
        for name in names:
            if name not in self._told:
                log.warning("degraded: %s: %s; %s", name, name.meaning, name.mend)
        for name in self._told:
            if name not in names:
                log.info("no longer degraded: %s", name)
        self._told = names
