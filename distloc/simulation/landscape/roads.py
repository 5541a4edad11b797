"""Winding roads through the landscape, and the cars on them."""

import numpy as np

from distloc.simulation.landscape.texture import Float32
from distloc.types import FloatArray

_WIDTH_M = 7.0
_SPACING_M = 900.0
_BENDS = ((140.0, 1900.0), (35.0, 610.0))  # how far to the side, over which length
LENGTH_M = 8_000.0  # of each road, about the origin, on which cars drive
_ROADS = 9


class Roads:
    """Roads from west to east, `_SPACING_M` apart, in one shape of bends that the rng turns along."""

    def __init__(self, rng: np.random.Generator) -> None:
        self._phase = rng.uniform(0.0, 2.0 * np.pi, len(_BENDS))
        self._shift_m = float(rng.uniform(0.25, 0.75) * _SPACING_M)

    def side_m(self, east_m: FloatArray) -> FloatArray:
        """How far north of its line a road runs at eastings."""
        bends = zip(_BENDS, self._phase, strict=True)
        return np.asarray(sum(far * np.sin(east_m * (2.0 * np.pi / length) + phase) for (far, length), phase in bends))

    def slope(self, east_m: FloatArray) -> FloatArray:
        """How much it runs north for each metre east."""
        bends = zip(_BENDS, self._phase, strict=True)
        turns = ((far, 2.0 * np.pi / length, phase) for (far, length), phase in bends)
        return np.asarray(sum(far * rate * np.cos(east_m * rate + phase) for far, rate, phase in turns))

    def lines_m(self) -> FloatArray:
        """The northings (N,) of the lines of the roads on which cars drive."""
        return (np.arange(_ROADS) - _ROADS // 2) * _SPACING_M + self._shift_m

    def share(self, east_m: Float32, north_m: Float32, covered_m: Float32) -> Float32:
        """How much of a pixel that covers `covered_m` at places (R, C) is road."""
        side_m = np.zeros_like(east_m)
        slope = np.zeros_like(east_m)
        for (far, length), phase in zip(_BENDS, self._phase, strict=True):
            angle = east_m * np.float32(2.0 * np.pi / length) + np.float32(phase)
            side_m += np.float32(far) * np.sin(angle)
            slope += np.float32(far * 2.0 * np.pi / length) * np.cos(angle)
        across = north_m - side_m - np.float32(self._shift_m)
        across -= np.float32(_SPACING_M) * np.rint(across / np.float32(_SPACING_M))
        distance_m = np.abs(across) / np.sqrt(1.0 + slope * slope)
        edge = np.clip((0.5 * _WIDTH_M - distance_m) / np.maximum(covered_m, 0.3) + 0.5, 0.0, 1.0)
        return np.asarray(edge * np.clip(1.8 - covered_m / _WIDTH_M, 0.0, 1.0))
