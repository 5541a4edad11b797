"""When a command's frames were taken, by the times that it writes on its second channel. Free of I/O.

A line a frame, in the frames' order: milliseconds, with decimals if need be. Lines that begin with # are passed over:
so the files that `rpicam-vid --save-pts` and FFmpeg's mkvtimestamp_v2 write are such lines as they are.
"""

import time
from collections import deque
from collections.abc import Callable

from service.camera.command.pictures import FormatError, PictureError

_LONGEST_LINE = 64
_MOST_AHEAD = 256  # lines that wait for their frames
_OLDEST_NS = 10_000_000_000
_WINDOW_NS = 30_000_000_000  # 50 ppm between two clocks is 3 ms in two of these

Offset = Callable[[], int]


def _unix_less_monotonic() -> int:
    return time.time_ns() - time.monotonic_ns()


def _boottime_less_monotonic() -> int:
    return time.clock_gettime_ns(time.CLOCK_BOOTTIME) - time.monotonic_ns()


OFFSETS: dict[str, Offset] = {
    "monotonic": lambda: 0,
    "boottime": _boottime_less_monotonic,
    "unix": _unix_less_monotonic,
}


class TimeLines:
    """Bytes as they come to the times that wait for their frames."""

    def __init__(self) -> None:
        self._rest = b""
        self._waiting: deque[int] = deque()

    def feed(self, data: bytes) -> None:
        """Take bytes; FormatError where a line is no time, or the frames stay away."""
        *lines, self._rest = (self._rest + data).split(b"\n")
        for line in lines:
            if line.strip() and not line.startswith(b"#"):
                self._waiting.append(_time_ns(line))
        if len(self._rest) > _LONGEST_LINE:
            _time_ns(self._rest)
        if len(self._waiting) > _MOST_AHEAD:
            raise FormatError(f"writes times for over {_MOST_AHEAD} frames that do not come: it must be one a frame")

    def next_ns(self) -> int | None:
        """The next frame's time; None: its line has not come."""
        return self._waiting.popleft() if self._waiting else None


def _time_ns(line: bytes) -> int:
    text = line.strip()
    whole, _, decimals = text.removeprefix(b"-").partition(b".")
    if len(text) > _LONGEST_LINE or not whole.isdigit() or (decimals and not decimals.isdigit()):
        raise FormatError(f"writes {text[:30]!r} as a frame's time: it must be milliseconds, a line a frame")
    size = int(whole) * 1_000_000 + int(decimals[:6].ljust(6, b"0"))  # exactly: a float has no nanoseconds since 1970
    return -size if text.startswith(b"-") else size


class FrameClock:
    """The times of one run on our clock, CLOCK_MONOTONIC; `clock` is the one that they are on, or "relative".

    Relative times have a zero of their own: the frame that came soonest after its time says where that lies, of those
    of the last half to whole minute.
    """

    def __init__(self, clock: str) -> None:
        self._clock = clock
        self._offset = OFFSETS.get(clock)
        self._last_ns: int | None = None
        self._began_ns = 0
        self._least_ns: tuple[int, int] | None = None  # of this window and the one before: arrival less time

    def stamp_ns(self, time_ns: int, arrival_ns: int) -> int:
        """A frame's time by our clock; PictureError where it cannot be one."""
        stamp_ns = time_ns - self._offset() if self._offset else time_ns + self._zero_ns(time_ns, arrival_ns)
        age_s = (arrival_ns - stamp_ns) * 1e-9
        if not 0 <= arrival_ns - stamp_ns <= _OLDEST_NS:
            said = f"{-age_s:.3g} s after its arrival" if age_s < 0 else f"{age_s:.3g} s before its arrival"
            raise PictureError(f'its time is {said} by camera.source.times = "{self._clock}": is it on that clock?')
        if self._last_ns is not None and time_ns <= self._last_ns:
            raise PictureError("its time is not later than that of the frame before it")
        self._last_ns = time_ns
        return stamp_ns

    def _zero_ns(self, time_ns: int, arrival_ns: int) -> int:
        lag_ns = arrival_ns - time_ns
        if self._least_ns is None or (self._last_ns is not None and time_ns <= self._last_ns):
            self._least_ns, self._began_ns, self._last_ns = (lag_ns, lag_ns), arrival_ns, None  # its time began anew
        elif arrival_ns - self._began_ns > _WINDOW_NS:
            self._least_ns, self._began_ns = (lag_ns, self._least_ns[0]), arrival_ns
        self._least_ns = min(lag_ns, self._least_ns[0]), self._least_ns[1]
        return min(self._least_ns)
