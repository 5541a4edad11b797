"""Which frames of a live camera are taken so that there are no more than asked for. Free of I/O."""


class Thinning:
    """Lets through at most `fps` frames a second; all of them where that is None."""

    def __init__(self, fps: float | None) -> None:
        self._period_ns = 0 if fps is None else round(1e9 / fps)
        self._due_ns: int | None = None

    def takes(self, stamp_ns: int) -> bool:
        """Whether a frame of this time is taken; those after it are counted from then."""
        # a tenth of a period early is still this turn: the camera's own rate jitters
        if self._due_ns is not None and stamp_ns < self._due_ns - self._period_ns // 10:
            return False
        late = self._due_ns is None or stamp_ns > self._due_ns + self._period_ns
        self._due_ns = (stamp_ns if late or self._due_ns is None else self._due_ns) + self._period_ns
        return True
