"""Frames of a file at their own speed: each is given once the clock has reached its stamp; the flight asks for it."""

import threading
from collections import Counter
from collections.abc import Callable
from types import TracebackType

from distloc.backports import Self
from distloc.types import RejectReason
from service.camera.source import Clock, FrameSource
from service.common.messages import Frame


class PacedSource:
    """Another source, waited for. `close` ends a wait at once; `wait` (True once closed) can be replaced in tests."""

    def __init__(self, source: FrameSource, clock: Clock, wait: Callable[[float], bool] | None = None) -> None:
        self.rejected: Counter[RejectReason] = source.rejected
        self._source, self._clock = source, clock
        self._closed = threading.Event()
        self._wait = wait or self._closed.wait
        self._reading = threading.Lock()  # the source is let go between two reads: OpenCV's are not thread-safe

    def read(self) -> Frame | None:
        """The next frame at its time; None at the end or once closed."""
        with self._reading:
            frame = None if self._closed.is_set() else self._source.read()
        while frame is not None and (left_ns := frame.stamp_ns - self._clock()) > 0:
            if self._wait(left_ns * 1e-9):
                return None
        return frame

    def close(self) -> None:
        """End."""
        self._closed.set()
        with self._reading:
            self._source.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()
