"""How far targets' segments stray from where they ought to be, as the sightings show.

A segment's middle is known as well as the segmenter draws it, which nobody can tell beforehand: against a ridge it may
find now one side of a plume and now the other. While a compass is wrong by degrees that is nothing; once the scenery
has measured the heading it is what limits the answer.
"""

import numpy as np
from numpy.typing import NDArray

from distloc.types import FloatArray

_SHARE = 0.1  # of what the last sighting says
_LEAST = 6  # sightings


class Scatter:
    """The variances (rows, 2), right and up in squared tangents, by which sightings stray more than they are told to.

    By how innovations differ from their mean of late: what stays is of a target that is elsewhere, and no scatter.
    """

    def __init__(self, rows: int) -> None:
        self._excess, self._mean = np.zeros((rows, 2)), np.zeros((rows, 2))
        self._count = np.zeros(rows, np.intp)

    def clear(self, rows: slice) -> None:
        """Begin anew."""
        self._excess[rows], self._mean[rows], self._count[rows] = 0.0, 0.0, 0

    def variance(self, rows: NDArray[np.intp]) -> FloatArray:
        """Of sightings beyond their own (k, 2); 0 while few were seen."""
        return np.asarray(np.maximum(self._excess[rows], 0.0) * (self._count[rows] >= _LEAST)[:, None])

    def add(self, rows: NDArray[np.intp], innovation: FloatArray, white: FloatArray) -> None:
        """Sightings' innovations (k, 2) and their own white covariances (k, 2, 2), the scatter included."""
        self._count[rows] += 1
        share = np.maximum(_SHARE, 1.0 / self._count[rows])[:, None]
        off = innovation - self._mean[rows]
        expected = np.diagonal(white, axis1=1, axis2=2) - self.variance(rows)
        self._mean[rows] += share * off
        self._excess[rows] += share * (np.square(off) - expected - self._excess[rows])
