"""The smoke over roots as things of their own: where their middles are, and how they lean; the estimates bring them."""

import math

import numpy as np
from numpy.typing import NDArray

from distloc.types import FloatArray, Plume

_LATELY = 0.2  # of what the last sighting says


class Middles:
    """Where the middles of segments are off their roots: east, north and up for each metre of distance (rows, 3)."""

    def __init__(self, rows: int) -> None:
        self.off = np.full((rows, 3), np.nan)  # while nobody knows

    def clear(self, rows: slice) -> None:
        """Begin anew."""
        self.off[rows] = np.nan

    def add(self, rows: NDArray[np.intp], right_up: FloatArray, axes: FloatArray) -> None:
        """Sightings' (k, 2) in tangents of sights' axes (k, 3, 3), as much of them as is seen."""
        off, before = (right_up[:, None] @ axes[:, :2])[:, 0], self.off[rows]
        self.off[rows] = np.where(np.isnan(before), off, before + _LATELY * (off - before))


def plumes_of(off: FloatArray, cameras_enu_m: FloatArray, roots_enu_m: FloatArray, lean: FloatArray) -> list[Plume]:
    """Of k roots at (k, 3) with middles off (k, 3) as cameras at (k, 3) saw them.

    Along the line of sight only the lean (k, 2) tells, metres east and north for each up.
    """
    along = roots_enu_m - cameras_enu_m
    off_m = np.linalg.norm(along, axis=1)[:, None] * np.where(np.isnan(off), 0.0, off)
    level = along[:, :2] / np.maximum(np.hypot(along[:, 0], along[:, 1]), 1.0)[:, None]
    leant_m = (lean * level).sum(axis=1) * np.maximum(off_m[:, 2], 0.0) - (off_m[:, :2] * level).sum(axis=1)
    off_m[:, :2] += leant_m[:, None] * level
    return [
        Plume(centre_enu_m, math.atan(math.hypot(east, north)), math.atan2(east, north) % (2.0 * math.pi))
        for centre_enu_m, (east, north) in zip(roots_enu_m + off_m, lean.tolist(), strict=True)
    ]
