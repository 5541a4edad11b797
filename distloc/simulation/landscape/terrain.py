"""The ground's height, and where rays meet it.

A ray's meeting is found in two steps: a table of the ground's elevation angles about the camera, by azimuth and range,
gives between which two ranges it is; then the secant method solves for it on the height field itself. So what is
drawn of a place does not depend on the table, which moves with the camera.
"""

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from distloc.simulation.landscape.texture import Floats, smoothstep
from distloc.types import FloatArray

__all__ = ["FLAT_M", "RIDGE_FROM_M", "Horizon", "Terrain"]

FLAT_M = 350.0  # about home and each plume's base the ground is flat
_BLEND_M = 600.0  # beyond it the hills rise to their height over so much
_CELL_M = 24.0
_CELLS = 1024
_WAVES_M = ((2800.0, 1.0), (1400.0, 0.5), (650.0, 0.22))  # length, amplitude
RIDGE_FROM_M = 6_000.0  # from the origin: mountains begin
_RIDGE_OVER_M = 4_000.0
# the last ones bring a plane's horizon to eye level
_RANGES_M = np.hstack([np.geomspace(8.0, 16_000.0, 448), np.geomspace(17_000.0, 2e6, 40)]).astype(np.float32)
_COLUMN_RAD = 0.0025
_STEEPEST = 50.0  # tangents beyond count as this
_STRIDE = 4.0 * _STEEPEST  # keeps the columns apart in one sorted list


class Terrain:
    """Heights over a square of 24.6 km about the origin, bilinear between points 24 m apart; level beyond.

    `places_enu_m`: about each of these the ground is flat, at `ground_height_m`, which is also its lowest.
    """

    def __init__(
        self,
        rng: np.random.Generator,
        places_enu_m: Sequence[FloatArray],
        hill_height_m: float,
        ridge_height_m: float,
        ground_height_m: float,
    ) -> None:
        axis = (np.arange(_CELLS) - _CELLS / 2) * _CELL_M
        east, north = np.meshgrid(axis, axis)
        waves = np.sum([amplitude * _wave(rng, length_m) for length_m, amplitude in _WAVES_M], axis=0)
        height = hill_height_m * smoothstep((waves + 1.0) / 3.2)
        rough = 0.7 + 0.3 * _wave(rng, 2400.0) + 0.12 * _wave(rng, 700.0)
        far = smoothstep((np.hypot(east, north) - RIDGE_FROM_M) / _RIDGE_OVER_M)
        height = height + ridge_height_m * far * np.clip(rough, 0.1, None)
        for place in places_enu_m:
            height *= smoothstep((np.hypot(east - place[0], north - place[1]) - FLAT_M) / _BLEND_M)
        self._grid = (height + ground_height_m).astype(np.float32)
        slope_north, slope_east = np.gradient(height, _CELL_M)
        self._shade = (1.0 + np.clip(1.6 * (0.7 * slope_east - 0.5 * slope_north), -0.45, 0.4)).astype(np.float32)

    def height_m(self, east_m: Floats, north_m: Floats) -> Floats:
        """The ground's height at places (R, C)."""
        return self._at(self._grid, east_m, north_m)

    def shade(self, east_m: Floats, north_m: Floats) -> Floats:
        """How the sun lights the slopes there, 1 where level."""
        return self._at(self._shade, east_m, north_m)

    @staticmethod
    def _at(grid: Floats, east_m: Floats, north_m: Floats) -> Floats:
        scale, middle = np.float32(1.0 / _CELL_M), np.float32(_CELLS / 2)
        x, y = east_m * scale + middle, north_m * scale + middle
        return np.asarray(cv2.remap(grid, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE))


class Horizon:
    """The terrain about a place as its elevation angles (tangents) by azimuth, over `span_rad` about `middle_rad`."""

    def __init__(self, terrain: Terrain, position_enu_m: FloatArray, middle_rad: float, span_rad: float) -> None:
        self._terrain = terrain
        n = max(8, int(np.ceil(span_rad / _COLUMN_RAD)) + 1)
        self._low_rad, self._step_rad = -span_rad / 2, span_rad / (n - 1)
        azimuth = (middle_rad + self._low_rad + self._step_rad * np.arange(n)).astype(np.float32)[:, None]
        east, north, up = position_enu_m.astype(np.float32)
        height = terrain.height_m(east + np.sin(azimuth) * _RANGES_M, north + np.cos(azimuth) * _RANGES_M)
        self._tangent = (height - up) / _RANGES_M
        self._top = np.maximum.accumulate(self._tangent, axis=1)
        clipped = np.clip(self._top, -_STEEPEST, _STEEPEST)
        self._sorted = (clipped + _STRIDE * np.arange(n)[:, None]).ravel()

    def meet(
        self, azimuth_rad: Floats, sine: Floats, cosine: Floats, tangent: Floats, position_enu_m: FloatArray
    ) -> Floats:
        """Horizontal ranges (R, C) at which rays meet the ground, infinite for the sky.

        Azimuths (relative to the middle) choose the table's columns; their true `sine` and `cosine` and the rays'
        origins `position_enu_m` (R, 1, 3) count in what follows.
        """
        last = len(_RANGES_M) - 1
        column = self._column(azimuth_rad)
        wanted = np.clip(tangent, -_STEEPEST, _STEEPEST) + _STRIDE * column
        index = (np.searchsorted(self._sorted, wanted.ravel()).reshape(wanted.shape) - column * (last + 1)).astype(
            np.int32
        )
        is_sky = index > last
        is_below = index == 0  # nearer than the table begins
        index = np.clip(index, 1, last)
        flat = column.astype(np.int32) * (last + 1) + index
        tangents, ranges = self._tangent.ravel(), _RANGES_M
        near_m, far_m = ranges[index - 1], ranges[index]
        below_m, above_m = (tangents[flat - 1] - tangent) * near_m, (tangents[flat] - tangent) * far_m
        slope = np.maximum((above_m - below_m) / (far_m - near_m), np.float32(1e-5))
        origin = position_enu_m.astype(np.float32)
        east, north, up = origin[..., 0], origin[..., 1], origin[..., 2]

        def above(range_m: Floats) -> Floats:
            ground_m = self._terrain.height_m(east + range_m * sine, north + range_m * cosine)
            return np.asarray(ground_m - up - range_m * tangent)

        least_m, most_m = np.where(is_below, np.float32(0.0), np.float32(0.9) * near_m), np.float32(1.02) * far_m
        first_m = np.clip(near_m - below_m / slope, least_m, far_m)
        first = above(first_m)
        apart_m = np.float32(0.005) + np.float32(1e-5) * first_m  # what the two differ by at least
        second_m = np.clip(first_m - first / slope, least_m, most_m)
        second_m = np.where(np.abs(second_m - first_m) < apart_m, first_m + apart_m, second_m)
        second = above(second_m)
        secant = (second - first) / (second_m - first_m)
        slope = np.where(secant > 0.1 * slope, secant, slope)
        met_m = np.clip(second_m - second / slope, least_m, most_m)
        met_m[is_sky] = np.inf
        return np.asarray(met_m)

    def skyline(self, azimuth_rad: Floats) -> Floats:
        """The tangent (R, C) at which the sky begins."""
        place = (azimuth_rad - np.float32(self._low_rad)) / np.float32(self._step_rad)
        index = np.clip(place.astype(np.int32), 0, len(self._top) - 2)
        last = self._top[:, -1]
        return np.asarray(last[index] + (place - index) * (last[index + 1] - last[index]), dtype=np.float32)

    def crest(self, azimuth_rad: Floats, range_m: Floats) -> Floats:
        """The greatest tangent (N,) of the ground before ranges (N,): what lies lower there is hidden."""
        index = np.searchsorted(_RANGES_M, 0.985 * range_m - 8.0) - 1
        return np.where(index < 0, -_STEEPEST, self._top[self._column(azimuth_rad), np.maximum(index, 0)])

    def _column(self, azimuth_rad: Floats) -> NDArray[np.int32]:
        column = np.rint((azimuth_rad - self._low_rad) / self._step_rad).astype(np.int32)
        return np.asarray(np.clip(column, 0, len(self._top) - 1))


def _wave(rng: np.random.Generator, length_m: float) -> FloatArray:
    """Smooth noise (CELLS, CELLS) of about unit variance whose bumps are `length_m` apart."""
    n = max(4, round(_CELLS * _CELL_M / (0.5 * length_m)))
    noise = cv2.resize(rng.normal(size=(n, n)), (_CELLS, _CELLS), interpolation=cv2.INTER_CUBIC)
    return np.asarray(noise / noise.std())
