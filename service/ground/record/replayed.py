"""A record's messages as they came, at any speed, in place of zenoh."""

import time
from collections.abc import Callable
from pathlib import Path

from service.common.shown import shown
from service.ground.faults import GroundError
from service.ground.inbox import Heard
from service.ground.record.recorder import read

_MOST_AT_ONCE = 5_000
_LONGEST_GAP_S = 30.0  # in which nothing came: passed over
_SET_BACK_S = 60.0  # then the ground's clock was set back while it recorded


class Replayed:
    """`due` gives what has come by now. GroundError where the file holds nothing or cannot be read."""

    def __init__(self, path: Path, speed: float, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock, self._speed = clock, speed
        self._messages = read(path)
        try:
            self._next = next(self._messages, None)
        except OSError as error:
            raise GroundError(f"--replay {path}: {error.strerror}") from error
        if self._next is None:
            raise GroundError(f"--replay {path}: holds no message of a drone: give a file that --record wrote")
        self.name = shown(path.name)
        self.now_s = self._next.arrived_s
        self.set_back_s = 0.0  # by so much, negative, the ground's clock was set back before what `due` gave last
        self._before = clock()

    @property
    def is_over(self) -> bool:
        """Whether all was given."""
        return self._next is None

    def due(self) -> list[Heard]:
        """What arrived since the last time; the record's clock stands still at its end."""
        now, self.set_back_s = self._clock(), 0.0
        if self._next is not None:
            self.now_s += (now - self._before) * self._speed
            if self._is_back(self._next):
                self.set_back_s = self._next.arrived_s - self.now_s
            if self._is_back(self._next) or self._next.arrived_s - self.now_s > _LONGEST_GAP_S:
                self.now_s = self._next.arrived_s
        self._before = now
        out: list[Heard] = []
        while self._next is not None and self._next.arrived_s <= self.now_s and len(out) < _MOST_AT_ONCE:
            if self._is_back(self._next):
                break
            out.append(self._next)
            self._next = next(self._messages, None)
        return out

    def _is_back(self, message: Heard) -> bool:
        return message.arrived_s < self.now_s - _SET_BACK_S * self._speed
