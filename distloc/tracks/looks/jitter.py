"""How roots' middles jump about from one frame to the next, as their places in the segments show."""

import numpy as np
from numpy.typing import NDArray

from distloc.types import BoolArray, FloatArray

_AT_FIRST = 0.1  # of its width: smoke in puffs
_SHARE, _AS_MANY = 0.1, 2  # of what the last sighting says; the first guess counts as so many


class Jitter:
    """The variances (rows, 2) of one frame's, right and up in squared tangents."""

    def __init__(self, rows: int) -> None:
        self.variance = np.zeros((rows, 2))
        self._count = np.zeros(rows, np.intp)
        self._off = np.full((rows, 2), np.nan)  # in the last frame

    def clear(self, rows: slice) -> None:
        """Begin anew."""
        self.variance[rows], self._count[rows], self._off[rows] = 0.0, 0, np.nan

    def restore(self, row: int, variance: FloatArray) -> None:
        """Go on from that of many."""
        self.variance[row], self._count[row] = variance, round(1.0 / _SHARE)

    def add(self, rows: NDArray[np.intp], off: FloatArray, root_rad: FloatArray, is_cut: BoolArray) -> None:
        """Roots that look so wide (k,), so far off their segments' middles (k, 2), in tangents.

        An axis that the border cuts (k, 2) goes by the other.
        """
        variance, before = self.variance[rows], self._off[rows]
        is_known = ~np.isnan(before[:, 0])
        is_first = ~is_known & (self._count[rows] == 0)
        self._count[rows] += is_known
        jumped = np.square(off - before) / 2.0
        jumped = np.where(is_cut & ~is_cut[:, ::-1], jumped[:, ::-1], jumped)
        share = np.maximum(_SHARE, 1.0 / (self._count[rows] + _AS_MANY))[:, None]
        is_told = (is_known & ~is_cut.all(axis=1))[:, None]
        found = np.where(is_told, variance + share * (jumped - variance), variance)
        self.variance[rows] = np.where(is_first[:, None], np.square(_AT_FIRST * root_rad)[:, None], found)
        self._off[rows] = off
