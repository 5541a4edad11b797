"""Where the picture was before: all of it every ten seconds, compressed, in a bounded number of bytes. Free of I/O."""

import zlib
from bisect import bisect_right
from collections.abc import Callable

STEP_S = 10.0
MOST_BYTES = 24_000_000  # hours of a few fires, minutes of a thousand


class Timeline:
    """Pictures as JSON; when full, every other one of the older half goes, so that the beginning stays."""

    def __init__(self, most_bytes: int = MOST_BYTES) -> None:
        self._most_bytes = most_bytes
        self._times_s: list[float] = []
        self._pictures: list[bytes] = []
        self._bytes = 0

    @property
    def begin_s(self) -> float | None:
        """The time of the earliest."""
        return self._times_s[0] if self._times_s else None

    def keep(self, now_s: float, picture: Callable[[], bytes]) -> None:
        """Call it often: every ten seconds one is kept. After the clock was set back, all begins anew."""
        if self._times_s and 0.0 <= now_s - self._times_s[-1] < STEP_S:
            return
        if self._times_s and now_s < self._times_s[-1]:
            self._times_s, self._pictures, self._bytes = [], [], 0
        self._times_s.append(now_s)
        self._pictures.append(zlib.compress(picture(), 1))
        self._bytes += len(self._pictures[-1])
        while self._bytes > self._most_bytes and len(self._pictures) > 2:
            half = max(len(self._pictures) // 2, 2)
            self._times_s = self._times_s[:half:2] + self._times_s[half:]
            self._pictures = self._pictures[:half:2] + self._pictures[half:]
            self._bytes = sum(map(len, self._pictures))

    def at(self, time_s: float) -> bytes | None:
        """The last picture up to a time, the first one before that; None while there is none."""
        if not self._times_s:
            return None
        return zlib.decompress(self._pictures[max(bisect_right(self._times_s, time_s) - 1, 0)])
