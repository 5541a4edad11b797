"""How many frames a second come and how many the segmenter takes: what it cannot take is told, not dropped in silence.

The flight's loop notes each frame. Free of I/O; times are the caller's.
"""

from collections import deque

_KEPT = 64
_STALE_NS = 10_000_000_000
_FEW = 0.8  # of those that come
_SETTLED_NS = 30_000_000_000


class Rate:
    """Of the last events, at most 64 and none older than 10 s."""

    def __init__(self) -> None:
        self._at_ns: deque[int] = deque(maxlen=_KEPT)

    def note(self, now_ns: int) -> None:
        """One happened."""
        if self._at_ns and now_ns < self._at_ns[-1]:
            self._at_ns.clear()
        self._at_ns.append(now_ns)

    def hz(self, now_ns: int) -> float:
        """Events a second; 0 where there were none of late."""
        recent = [at_ns for at_ns in self._at_ns if now_ns - at_ns < _STALE_NS]
        if len(recent) < 2 or recent[-1] == recent[0]:
            return 0.0
        return (len(recent) - 1) / ((recent[-1] - recent[0]) * 1e-9)


class FrameRates:
    """`came` is called for each frame of the camera, `done` for each that was segmented."""

    def __init__(self) -> None:
        self._camera, self._segmented = Rate(), Rate()
        self._few_since_ns: int | None = None
        self._is_told = False

    def came(self, now_ns: int) -> None:
        """A frame came from the camera."""
        self._camera.note(now_ns)

    def done(self, now_ns: int) -> None:
        """One was segmented and localised."""
        self._segmented.note(now_ns)

    def per_second(self, now_ns: int) -> dict[str, float]:
        """For the status."""
        return {"camera": round(self._camera.hz(now_ns), 2), "segmented": round(self._segmented.hz(now_ns), 2)}

    def news(self, now_ns: int) -> str | None:
        """A line once fewer have been segmented than come for 30 s, and once that is over; call it now and then."""
        camera_hz, segmented_hz = self._camera.hz(now_ns), self._segmented.hz(now_ns)
        if not segmented_hz or segmented_hz >= _FEW * camera_hz:
            self._few_since_ns = None
            if self._is_told and segmented_hz:
                self._is_told = False
                return f"the segmenter takes all of the camera's {camera_hz:.1f} frames a second again"
            return None
        if self._few_since_ns is None:
            self._few_since_ns = now_ns
        if self._is_told or now_ns - self._few_since_ns < _SETTLED_NS:
            return None
        self._is_told = True
        return (
            f"the segmenter takes {segmented_hz:.1f} of the camera's {camera_hz:.1f} frames a second: the newest each "
            "time, the others serve the scenery alone; fewer frames (camera.source.fps) spare the board"
        )
