"""The ground's time: the computer's calendar, and by how much that was set meanwhile, so that ages stay true."""

import time
from collections.abc import Callable

_SET_S = 0.5  # a computer's clock that is only trimmed is not off by that in a long time


def steady_s() -> float:
    """Seconds that no setting of the clock changes; a computer's sleep counts where the system tells of it."""
    clock = getattr(time, "CLOCK_BOOTTIME", None)
    return time.monotonic() if clock is None else time.clock_gettime(clock)


class WallClock:
    """`now_s` may be called on any thread, and goes on steadily until `follow` is called."""

    def __init__(self, wall: Callable[[], float] = time.time, steady: Callable[[], float] = steady_s) -> None:
        self._wall, self._steady = wall, steady
        self._ahead_s = wall() - steady()

    def now_s(self) -> float:
        """Seconds since 1970."""
        return self._steady() + self._ahead_s

    def follow(self) -> float:
        """By how many seconds the computer's clock was set since; 0 where it was not."""
        step_s = self._wall() - self.now_s()
        if abs(step_s) < _SET_S:
            return 0.0
        self._ahead_s += step_s
        return step_s
