"""Which targets were seen beside each other, and so are two; the tracker asks."""

from collections.abc import Collection, Sequence

import numpy as np

from distloc.tracks.life import CONFIRM_SIGHTINGS
from distloc.tracks.target_track import Track

_APART_STEPS = CONFIRM_SIGHTINGS  # with a segment each


class Apart:
    """Which targets were seen beside each other, and so are two, by the places of their filters.

    Ranges that a common error of the heading blurs say little of whether two targets are one. That both had a segment
    of their own in the same frames does: it is forgotten again where one is in the other's segment, as a piece is that
    comes off now and then, but not any more once it was so for as long as a confirmation takes.
    """

    def __init__(self, places: int) -> None:
        self._steps = np.zeros((places, places), np.int8)

    def seen(self, tracks: Collection[Track]) -> None:
        """All these had a segment of their own in this frame."""
        places = [one.filter.place for one in tracks]
        at = np.ix_(places, places)
        self._steps[at] = np.minimum(self._steps[at] + 1, _APART_STEPS)

    def share(self, one: int, other: int) -> None:
        """One is in the segment of the other."""
        if not self.are(one, other):
            self._steps[one, other] = self._steps[other, one] = max(self._steps[one, other] - 1, 0)

    def are(self, one: int, other: int) -> bool:
        """Whether they are two."""
        return bool(self._steps[one, other] >= _APART_STEPS)

    def part(self, places: Sequence[int]) -> None:
        """All these are known to be two by two."""
        self._steps[np.ix_(places, places)] = _APART_STEPS

    def join(self, one: int, other: int) -> None:
        """They are the same, and go on at the second's place."""
        self._steps[other] = np.maximum(self._steps[one], self._steps[other])
        self._steps[:, other] = self._steps[other]

    def keep(self, places: Sequence[int]) -> None:
        """Only these are in use; what comes to the others is new."""
        is_free = np.ones(len(self._steps), np.bool_)
        is_free[list(places)] = False
        self._steps[is_free], self._steps[:, is_free] = 0, 0
