"""What zenoh's threads brought and nobody read yet: the newest message of each key, so that a flood costs no more."""

import threading
import time
from collections import OrderedDict
from collections.abc import Callable
from typing import NamedTuple

MOST_SENDERS, MOST_KEYS_EACH = 256, 80


class Heard(NamedTuple):
    """A message as it came; `payload` None: the liveliness token went, empty: it came."""

    key: str
    payload: bytes | None
    arrived_s: float
    sender: str


class Inbox:
    """Filled on zenoh's threads, emptied by one reader. What a newer message of its key replaced is no loss.

    A message gets its time of arrival here: what is taken arrived before all that is taken later.
    """

    def __init__(self, clock: Callable[[], float] = time.time) -> None:
        self._clock = clock
        self._lock = threading.Lock()
        self._waiting: OrderedDict[str, OrderedDict[str, Heard]] = OrderedDict()
        self._dropped: dict[str, int] = {}

    def put(self, key: str, payload: bytes | None, sender: str = "") -> None:
        """By vehicle and key; what has no place is counted."""
        vehicle = key.removeprefix("distloc/").partition("/")[0]
        with self._lock:
            own = self._waiting.get(vehicle)
            if own is None:
                if len(self._waiting) >= MOST_SENDERS:
                    self._drop(vehicle)
                    return
                own = self._waiting[vehicle] = OrderedDict()
            if key in own or len(own) < MOST_KEYS_EACH:
                own[key] = Heard(key, payload, self._clock(), sender)
            else:
                self._drop(vehicle)

    def take(self) -> tuple[list[Heard], dict[str, int]]:
        """All that waits, and how many of each vehicle's had no place since the last time."""
        with self._lock:
            waiting, self._waiting = self._waiting, OrderedDict()
            dropped, self._dropped = self._dropped, {}
        return [one for own in waiting.values() for one in own.values()], dropped

    def _drop(self, vehicle: str) -> None:
        if vehicle in self._dropped or len(self._dropped) < MOST_SENDERS:
            self._dropped[vehicle] = self._dropped.get(vehicle, 0) + 1
