"""Winding roads through the landscape, and the cars on them."""

from collections.abc import Callable

import numpy as np

from distloc.simulation.landscape.texture import Floats
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

    def side_m(self, east_m: Floats) -> Floats:
        """How far north of its line a road runs at eastings."""
        return self._bent(east_m, np.sin, lambda far, rate: far)

    def slope(self, east_m: Floats) -> Floats:
        """How much it runs north for each metre east."""
        return self._bent(east_m, np.cos, lambda far, rate: far * rate)

    def lines_m(self) -> FloatArray:
        """The northings (N,) of the lines of the roads on which cars drive."""
        return np.asarray((np.arange(_ROADS) - _ROADS // 2) * _SPACING_M + self._shift_m)

    def share(self, east_m: Floats, north_m: Floats, covered_m: Floats) -> Floats:
        """How much of a pixel that covers `covered_m` at places (R, C) is road."""
        slope = self.slope(east_m)
        across = north_m - self.side_m(east_m) - np.float32(self._shift_m)
        across -= np.float32(_SPACING_M) * np.rint(across / np.float32(_SPACING_M))
        distance_m = np.abs(across) / np.sqrt(1.0 + slope * slope)
        edge = np.clip((0.5 * _WIDTH_M - distance_m) / np.maximum(covered_m, 0.3) + 0.5, 0.0, 1.0)
        return np.asarray(edge * np.clip(1.8 - covered_m / _WIDTH_M, 0.0, 1.0))

    def _bent(self, east_m: Floats, wave: Callable[[Floats], Floats], size: Callable[[float, float], float]) -> Floats:
        total = np.zeros_like(east_m)
        for (far, length), phase in zip(_BENDS, self._phase, strict=True):
            rate = 2.0 * np.pi / length
            total += size(far, rate) * wave(east_m * rate + float(phase))
        return total
