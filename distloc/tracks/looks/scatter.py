"""How far a target's segments stray from where they ought to be, as the sightings show; its track has one.

A segment's middle is known as well as the segmenter draws it, which nobody can tell beforehand: against a ridge it may
find now one side of a plume and now the other. While a compass is wrong by degrees that is nothing; once the scenery
has measured the heading it is what limits the answer.
"""

import numpy as np

from distloc.types import FloatArray

_SHARE = 0.1  # of what the last sighting says
_LEAST = 6  # sightings


class Scatter:
    """The variance (2,), right and up in squared tangents, by which sightings stray more than they are told to.

    By how innovations differ from their mean of late: what stays is of a target that is elsewhere, and no scatter.
    """

    def __init__(self) -> None:
        self._excess = np.zeros(2)
        self._mean = np.zeros(2)
        self._count = 0

    @property
    def variance(self) -> FloatArray:
        """Of a sighting beyond its own; 0 while few were seen."""
        return np.maximum(self._excess, 0.0) if self._count >= _LEAST else np.zeros(2)

    def add(self, innovation: FloatArray, white: FloatArray) -> None:
        """A sighting's innovation (2,) and its own white covariance (2, 2), the scatter included."""
        self._count += 1
        share = max(_SHARE, 1.0 / self._count)
        off = innovation - self._mean
        self._mean += share * off
        self._excess += share * (np.square(off) - (np.diag(white) - self.variance) - self._excess)
