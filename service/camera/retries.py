"""How long to wait before what was lost is tried again: growing, capped, jittered. Free of I/O."""

import random

_FIRST_S, _MOST_S = 0.5, 2.5  # a stream that is back gives frames within 5 s: it takes some seconds to begin


class Retries:
    """The delays of one source."""

    def __init__(self, rng: random.Random | None = None) -> None:
        self._rng = rng or random.Random()
        self._delay_s = _FIRST_S

    def next_s(self) -> float:
        """The next delay; each is up to twice the one before it."""
        delay_s, self._delay_s = self._delay_s, min(2.0 * self._delay_s, _MOST_S)
        return delay_s * self._rng.uniform(0.5, 1.0)

    def reset(self) -> None:
        """It works: the next loss begins with the shortest delay."""
        self._delay_s = _FIRST_S
