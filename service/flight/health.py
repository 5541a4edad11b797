"""What the frames' ages say of camera and segmenter; the app puts it together with the other parts' words."""

from collections.abc import Iterable

from service.common.degraded import Degraded

_STALE_NS = 3_000_000_000


class FrameAges:
    """Since when no frame came, and since when those given have made no mask."""

    def __init__(self) -> None:
        self._heard_ns: int | None = None
        self._given_ns: int | None = None

    def frame_heard(self, stamp_ns: int) -> None:
        """A frame came from the camera."""
        self._heard_ns = stamp_ns

    def frame_given(self, now_ns: int) -> None:
        """A frame is handed to the localise stage."""
        if self._given_ns is None:
            self._given_ns = now_ns

    def frame_unusable(self) -> None:
        """One came that tells nothing: the segmenter has nothing to do."""
        self._given_ns = None

    def mask_made(self) -> None:
        """The stage made a mask of one."""
        self._given_ns = None

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
) -> tuple[Degraded, ...]:
    """All that does not work as it should, sorted; a camera that is silent has no pictures to be blind or frozen."""
    names = {*autopilot, *lost}
    names.update([Degraded.CAMERA] if has_camera and ages.is_camera_silent(now_ns) else pictures)
    if ages.is_segmenter_late(now_ns):
        names.add(Degraded.SEGMENTER)
    return tuple(sorted(names))
