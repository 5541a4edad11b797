"""How large a target's segments look: what is expected of the next one, and how large that makes the target."""

import math
from collections import deque
from collections.abc import Iterable, Sequence

import numpy as np

from distloc.geometry.camera import Camera
from distloc.types import Extent, FloatArray

_SIZES = 15  # segments whose size is what is expected
_SHARE = 0.8  # of them are smaller
_SETTLED, _ANOTHERS, _SMALL_PX = 5, 4.0, 20.0  # segments seen; times the expected size; at least so large


class SegmentSizes:
    """Widths and heights of the latest whole segments, of which parts may be missing."""

    def __init__(self, sizes_px: FloatArray | None = None) -> None:
        held = [] if sizes_px is None else np.asarray(sizes_px).tolist()
        self._widths_px: deque[float] = deque((width for width, _ in held), maxlen=_SIZES)
        self._heights_px: deque[float] = deque((height for _, height in held), maxlen=_SIZES)
        self.expected_px: FloatArray | None = None  # width and height (2,); None while there was none
        self.most_px = np.full(2, np.inf)  # (2,) of a segment that may be the target's
        self._expect()

    def add(self, width_px: float, height_px: float) -> None:
        """A whole segment's."""
        self._widths_px.append(width_px)
        self._heights_px.append(height_px)
        self._expect()

    def all_px(self) -> FloatArray:
        """All that are remembered (n, 2)."""
        return np.array([self._widths_px, self._heights_px], dtype=np.float64).T.reshape(-1, 2)

    def extent(self, camera: Camera, depth_m: float, sigma_m: float) -> Extent | None:
        """Of a target so far along the camera's axis, from the median; None while no segment was whole."""
        if not self._widths_px:
            return None
        width, height = _extent(self._widths_px, depth_m, sigma_m), _extent(self._heights_px, depth_m, sigma_m)
        return Extent(width[0] / camera.fx, width[1] / camera.fx, height[0] / camera.fy, height[1] / camera.fy)

    def _expect(self) -> None:
        """A high quantile: what is missing makes a segment smaller, and only clutter beside it makes it larger.

        One many times as large as any before only hides the target.
        """
        if not self._widths_px:
            return
        expected_px = np.array([_quantile(self._widths_px, _SHARE), _quantile(self._heights_px, _SHARE)])
        self.expected_px = expected_px
        if len(self._widths_px) >= _SETTLED:
            self.most_px = _ANOTHERS * np.maximum(expected_px, _SMALL_PX)


def _quantile(sizes: Iterable[float], share: float) -> float:
    """Linear between two of them."""
    ordered = sorted(sizes)
    low, between = divmod(share * (len(ordered) - 1), 1.0)
    first, second = (ordered[int(low) : int(low) + 2] * 2)[:2]
    return first + between * (second - first)


def _extent(sizes_px: Sequence[float], depth_m: float, sigma_m: float) -> tuple[float, float]:
    """The typical size times the depth, and one standard deviation."""
    typical, mean = _quantile(sizes_px, 0.5), sum(sizes_px) / len(sizes_px)
    variance = sum((one - mean) ** 2 for one in sizes_px) / len(sizes_px)
    return depth_m * typical, math.hypot(typical * sigma_m, depth_m * math.sqrt(variance))
