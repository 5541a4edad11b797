"""How large targets' segments look: what is expected of the next one, and how large that makes the target."""

import math

import numpy as np
from numpy.typing import NDArray

from distloc.geometry.camera import Camera
from distloc.types import Extent, FloatArray

_SIZES = 15  # segments whose size is what is expected
_SHARE = 0.8  # of them are smaller
_SETTLED, _ANOTHERS, _SMALL_PX = 5, 4.0, 20.0  # segments seen; times the expected size; at least so large


class SegmentSizes:
    """Widths and heights of the latest whole segments, of which parts may be missing: so many rows of them.

    `expected_px` (rows, 2) is NaN while there was none, `most_px` (rows, 2) of a segment that may be the target's.
    """

    def __init__(self, rows: int) -> None:
        self._held_px = np.full((rows, _SIZES, 2), np.nan)
        self._count = np.zeros(rows, np.intp)  # ever
        self.expected_px, self.most_px = np.full((rows, 2), np.nan), np.full((rows, 2), np.inf)

    def clear(self, rows: slice) -> None:
        """Begin anew."""
        self._held_px[rows], self._count[rows] = np.nan, 0
        self.expected_px[rows], self.most_px[rows] = np.nan, np.inf

    def add(self, rows: NDArray[np.intp], sizes_px: FloatArray) -> None:
        """A whole segment's (k, 2) in each of these rows.

        A high quantile is expected: what is missing makes a segment smaller, and only clutter beside it makes it
        larger. One many times as large as any before only hides the target.
        """
        self._held_px[rows, self._count[rows] % _SIZES] = sizes_px
        self._count[rows] += 1
        expected_px = self._quantiles(rows, _SHARE)
        is_settled = (self._count[rows] >= _SETTLED)[:, None]
        self.expected_px[rows] = expected_px
        self.most_px[rows] = np.where(is_settled, _ANOTHERS * np.maximum(expected_px, _SMALL_PX), np.inf)

    def restore(self, row: int, sizes_px: FloatArray) -> None:
        """The latest (n, 2), the oldest first."""
        for size_px in sizes_px:
            self.add(np.array([row]), size_px[None])

    def all_px(self, row: int) -> FloatArray:
        """All that are remembered (n, 2), the oldest first."""
        count = int(self._count[row])
        held_px = self._held_px[row]
        return held_px[:count].copy() if count <= _SIZES else np.roll(held_px, -(count % _SIZES), axis=0)

    def extents(
        self, rows: NDArray[np.intp], camera: Camera, depth_m: FloatArray, sigma_m: FloatArray
    ) -> list[Extent | None]:
        """Of targets so far (k,) along the camera's axis, from the median; None while no segment was whole."""
        if rows.size == 0:
            return []
        held_px, focal_px = self._held_px[rows], np.array([camera.fx, camera.fy])
        number = np.maximum(np.minimum(self._count[rows], _SIZES), 1)[:, None]
        is_held = ~np.isnan(held_px)
        mean_px = np.where(is_held, held_px, 0.0).sum(axis=1) / number
        off_px = np.where(is_held, held_px - mean_px[:, None], 0.0)
        variance_px2 = np.square(off_px).sum(axis=1) / number
        typical_px, depth_m, sigma_m = self._quantiles(rows, 0.5), depth_m[:, None], sigma_m[:, None]
        size_m = (depth_m * typical_px / focal_px).tolist()
        size_sigma_m = (np.hypot(typical_px * sigma_m, depth_m * np.sqrt(variance_px2)) / focal_px).tolist()
        return [
            Extent(width_m, width_sigma_m, height_m, height_sigma_m) if math.isfinite(width_m) else None
            for (width_m, height_m), (width_sigma_m, height_sigma_m) in zip(size_m, size_sigma_m, strict=True)
        ]

    def _quantiles(self, rows: NDArray[np.intp], share: float) -> FloatArray:
        """Linear between two of them (k, 2); NaN where there is none."""
        ordered = np.sort(self._held_px[rows], axis=1)  # NaN last
        last = np.maximum(np.minimum(self._count[rows], _SIZES) - 1, 0)
        rank = share * last
        low, at = rank.astype(np.intp), np.arange(rows.size)
        first, second = ordered[at, low], ordered[at, np.minimum(low + 1, last)]
        return np.asarray(first + (rank - low)[:, None] * (second - first))
