"""The horizon's line in a frame whose pose is unknown; the classical segmenter calls it."""

import cv2
import numpy as np
from numpy.typing import NDArray

from service.segmenters.level_view import HorizonLine

_WIDTH = 64  # a line across the whole frame shows at this width, and the sky's and the land's details do not
_ANGLES_RAD = np.radians(np.arange(-60.0, 61.0, 3.0))
_FULL_DROP = 20.0  # levels over two pixels: a stronger edge counts no more, so that one bright field makes no horizon
_EDGE_WEIGHT = 2.0
_LEAST_EDGE = 0.9  # of the line must be an edge with the brighter side above; a plume's flank has less
_LEAST_SHARE = 0.04  # of the frame on either side


class HorizonFinder:
    """Tries every line across a small copy of the frame: bright above, dark below, and an edge all along."""

    def __init__(self, width: int, height: int) -> None:
        self._size = (_WIDTH, max(8, round(_WIDTH * height / width)))
        v, u = np.mgrid[0 : self._size[1], 0 : self._size[0]].astype(np.float64)
        u, v = u.ravel() - 0.5 * (self._size[0] - 1), v.ravel() - 0.5 * (self._size[1] - 1)
        self._reach = int(np.ceil(np.hypot(*self._size) / 2.0))
        self._across, self._down = np.sin(_ANGLES_RAD)[:, None], np.cos(_ANGLES_RAD)[:, None]
        row = np.round(self._down * v - self._across * u).astype(np.int64) + self._reach
        self._shape = (len(_ANGLES_RAD), 2 * self._reach + 1)
        self._bins = (row + np.arange(self._shape[0])[:, None] * self._shape[1]).ravel()
        self._count = self._sums(np.ones(row.size))

    def find(self, light: NDArray[np.uint8]) -> HorizonLine | None:
        """The line in a grey frame (h, w); None where there is none, as in a look at the ground."""
        small = cv2.resize(light, self._size, interpolation=cv2.INTER_AREA).astype(np.float32)
        edge = self._edge(small)
        score = self._separation(small) + _EDGE_WEIGHT * edge
        best = np.unravel_index(int(score.argmax()), score.shape)
        if edge[best] < _LEAST_EDGE or not np.isfinite(score[best]):
            return None
        return HorizonLine(float(_ANGLES_RAD[best[0]]), (float(best[1]) - self._reach + 0.5) / _WIDTH)

    def _separation(self, small: NDArray[np.float32]) -> NDArray[np.float64]:
        """The variance between the sides over the whole (Otsu 1979, eqs. 12, 14); -inf where one is too small."""
        above = np.cumsum(self._count, axis=1)
        below = small.size - above
        light_above = np.cumsum(self._sums(np.tile(small.ravel(), self._shape[0])), axis=1)
        light_below = float(small.sum()) - light_above
        least = _LEAST_SHARE * small.size
        is_split = (above > least) & (below > least)
        drop = light_above / np.maximum(above, 1.0) - light_below / np.maximum(below, 1.0)
        share = above * below / float(small.size) ** 2
        return np.where(is_split & (drop > 0.0), share * drop**2 / (float(small.var()) + 1.0), -np.inf)

    def _edge(self, small: NDArray[np.float32]) -> NDArray[np.float64]:
        """How much of each line is an edge that darkens downwards, 1 is all of it; short lines count less."""
        smooth = cv2.GaussianBlur(small, (0, 0), 1.0)
        right = cv2.Sobel(smooth, cv2.CV_32F, 1, 0, ksize=3).ravel() / 4.0
        downwards = cv2.Sobel(smooth, cv2.CV_32F, 0, 1, ksize=3).ravel() / 4.0
        drop = np.clip((self._across * right - self._down * downwards) / _FULL_DROP, -1.0, 1.0)
        pixels = _of_three(self._count)
        return _of_three(self._sums(drop.ravel())) / np.maximum(pixels, 1.5 * min(self._size))

    def _sums(self, values: NDArray[np.floating]) -> NDArray[np.float64]:
        sums = np.bincount(self._bins, values, minlength=self._shape[0] * self._shape[1])
        return np.asarray(sums, dtype=np.float64).reshape(self._shape)


def _of_three(lines: NDArray[np.float64]) -> NDArray[np.float64]:
    """Each line's value with its two neighbours' added."""
    padded = np.pad(lines, ((0, 0), (1, 1)))
    return np.asarray(padded[:, :-2] + padded[:, 1:-1] + padded[:, 2:])
