"""How wide roots are that a side of the picture cuts, and what may be hidden of them, as the sightings show of late."""

import numpy as np
from numpy.typing import NDArray

from distloc.types import FloatArray

_KEPT = 0.98  # of the widest: nearer or farther, a root looks as wide as before for some sightings
_LATELY = 0.1  # of what the last sighting says


class Borders:
    """The width that is seen at the most, and the scale of what is hidden (rows, 2); NaN where none was cut."""

    def __init__(self, rows: int) -> None:
        self._rad = np.full((rows, 2), np.nan)

    def clear(self, rows: slice) -> None:
        """Begin anew."""
        self._rad[rows] = np.nan

    def add(self, rows: NDArray[np.intp], seen_rad: FloatArray) -> None:
        """Sightings' (k, 2)."""
        before = self._rad[rows]
        scale = before[:, 1] + _LATELY * (seen_rad[:, 1] - before[:, 1])
        after = np.column_stack([np.maximum(seen_rad[:, 0], _KEPT * before[:, 0]), scale])
        self._rad[rows] = np.where(np.isnan(before), seen_rad, after)

    def known_rad(self, rows: NDArray[np.intp], root_rad: FloatArray) -> FloatArray:
        """The same, and the width of those that were seen whole (k,), in one (k, 3)."""
        return np.column_stack([self._rad[rows], root_rad])
