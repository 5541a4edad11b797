"""How large a target's segments look: what is expected of the next one, and how large that makes the target."""

from collections import deque

import numpy as np

from distloc.geometry.camera import Camera
from distloc.types import Extent, FloatArray

_SIZES = 15  # segments whose size is what is expected
_SHARE = 0.8  # of them are smaller
_SETTLED, _ANOTHERS, _SMALL_PX = 5, 4.0, 20.0  # segments seen; times the expected size; at least so large


class SegmentSizes:
    """Widths and heights of the latest whole segments, of which parts may be missing."""

    def __init__(self, sizes_px: FloatArray | None = None) -> None:
        self._sizes_px: deque[tuple[float, float]] = deque(maxlen=_SIZES)
        self.expected_px: FloatArray | None = None  # width and height (2,); None while there was none
        for width_px, height_px in [] if sizes_px is None else sizes_px:
            self._sizes_px.append((float(width_px), float(height_px)))
        self._expect()

    def add(self, width_px: float, height_px: float) -> None:
        """A whole segment's."""
        self._sizes_px.append((width_px, height_px))
        self._expect()

    def all_px(self) -> FloatArray:
        """All that are remembered (n, 2)."""
        return np.array(self._sizes_px, dtype=np.float64).reshape(-1, 2)

    def may_be(self, size_px: FloatArray) -> bool:
        """Whether a size (2,) may be the same target's: one many times as large as any before only hides it."""
        if self.expected_px is None or len(self._sizes_px) < _SETTLED:
            return True
        return bool((size_px <= _ANOTHERS * np.maximum(self.expected_px, _SMALL_PX)).all())

    def extent(self, camera: Camera, depth_m: float, sigma_m: float) -> Extent | None:
        """Of a target so far along the camera's axis, from the median; None while no segment was whole."""
        if not self._sizes_px:
            return None
        tangents = self.all_px() / np.array([camera.fx, camera.fy])
        typical: FloatArray = np.median(tangents, axis=0)
        width_m, height_m = (float(size) for size in depth_m * typical)
        sigmas_m = np.hypot(typical * sigma_m, depth_m * tangents.std(axis=0))
        return Extent(width_m, float(sigmas_m[0]), height_m, float(sigmas_m[1]))

    def _expect(self) -> None:
        """A high quantile: what is missing makes a segment smaller, and only clutter beside it makes it larger."""
        if not self._sizes_px:
            return
        ordered = np.sort(self.all_px(), axis=0)
        low, between = divmod(_SHARE * (len(ordered) - 1), 1.0)
        pair = ordered[int(low) : int(low) + 2]
        self.expected_px = pair[0] + between * (pair[-1] - pair[0])
