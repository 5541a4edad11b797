"""Where the craft's own parts are in the image: corners there stay while the scenery moves."""

from collections.abc import Iterable, Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from distloc.geometry.camera import Camera
from distloc.types import BoolArray, FloatArray

_CELLS = (32, 18)
_STILL_PX = 0.3
_MOVES_PX = 3.0
_FORGET_FRAMES = 100
_MASK_PX = 1280  # a mask is no wider
_OFTEN = 4  # times that a corner stood still in a cell


class OwnParts:
    """Counts, for each cell of the image, how often a corner stood still that ought to have moved."""

    def __init__(self, size: tuple[int, int]) -> None:
        self._size = size
        self._counts = np.zeros(_CELLS[::-1], dtype=np.int32)
        self._frames = 0

    def are_own(self, old_px: FloatArray, new_px: FloatArray, expected_px: FloatArray, found: BoolArray) -> BoolArray:
        """Which corners (n,), before and now at pixels (2, n), do not move with the scenery."""
        still = np.abs(new_px - old_px).max(axis=0) < _STILL_PX
        ought = np.linalg.norm(expected_px - old_px, axis=0) > _MOVES_PX
        own = still & ought & found
        if 2 * int((still & found).sum()) > int(found.sum()):  # it is the craft that stands still, whatever is reported
            return np.zeros_like(own)
        self._frames += 1
        if self._frames % _FORGET_FRAMES == 0:  # what was counted by mistake goes
            self._counts //= 2
        column, row = self._cells(new_px[:, own])
        np.add.at(self._counts, (row, column), 1)
        moves = ~still & ought & found
        column, row = self._cells(new_px[:, moves])
        np.add.at(self._counts, (row, column), -1)
        np.clip(self._counts, 0, 2 * _OFTEN, out=self._counts)
        return np.asarray(own)

    def allowed(self) -> NDArray[np.uint8]:
        """255 where none were seen (h, w)."""
        free = (self._counts < _OFTEN).astype(np.uint8) * 255
        return np.asarray(cv2.resize(free, self._size, interpolation=cv2.INTER_NEAREST), dtype=np.uint8)

    def _cells(self, pixels: FloatArray) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        cells = (pixels / np.array(self._size)[:, None] * np.array(_CELLS)[:, None]).astype(np.intp)
        column, row = np.clip(cells, 0, np.array(_CELLS)[:, None] - 1)
        return column, row


def own_mask(camera: Camera, polygons: Iterable[Sequence[Sequence[float]]]) -> NDArray[np.uint8] | None:
    """255 (h, w) inside polygons of the full-size image's pixels; None where there are none."""
    by = max(1, -(-camera.width // _MASK_PX))
    mask = np.zeros((max(1, camera.height // by), max(1, camera.width // by)), np.uint8)
    for polygon in polygons:
        corners_px = np.rint((np.array(polygon) + 0.5) / by - 0.5).astype(np.int32)
        cv2.fillPoly(mask, [corners_px.reshape(-1, 1, 2)], 255)
    return mask if mask.any() else None
