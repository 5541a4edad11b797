"""The connected components of a mask, found without labelling the empty rest of it.

The mask is counted in cells of 8 x 8 pixels first: what is connected in the mask is connected in cells, so that only
the boxes of cells that hang together, and hold enough, are labelled pixel by pixel.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

_CELL = 8  # as many pixels as a word has bytes
_SUM_OF_BYTES, _TOP_BYTE = np.uint64(0x0101_0101_0101_0101), np.uint64(56)


@dataclass(frozen=True, slots=True)
class Component:
    """8-connected pixels: `pixels` (h, w) is 1 where they are in their bounding box, which begins at `left`, `top`."""

    left: int
    top: int
    area: int
    pixels: NDArray[np.uint8]


def largest_components(mask: NDArray[np.uint8], least_area: int, most: int) -> list[Component]:
    """At most `most` components with `least_area` pixels or more of a mask (h, w), the largest first.

    Of two as large the upper, then the left one comes first.
    """
    cells = _counted(mask)
    number, groups, boxes = _labelled((cells > 0).view(np.uint8))
    counts = np.bincount(groups.ravel(), weights=cells.ravel(), minlength=number)
    counts[0] = 0.0
    order = np.flatnonzero(counts >= least_area)
    order = order[np.argsort(-counts[order], kind="stable")]
    if (boxes[order, cv2.CC_STAT_WIDTH] * boxes[order, cv2.CC_STAT_HEIGHT]).sum() > cells.size:
        return _components(mask, 0, 0, least_area, most)  # boxes within boxes: all at once is less
    found: list[Component] = []
    for group in order:
        if len(found) == most and found[-1].area >= counts[group]:
            break
        x, y, width, height = (int(value) for value in boxes[group, : cv2.CC_STAT_AREA])
        crop = mask[y * _CELL : (y + height) * _CELL, x * _CELL : (x + width) * _CELL]
        others = cells[y : y + height, x : x + width] * (groups[y : y + height, x : x + width] != group)
        if others.any():
            is_other = np.repeat(np.repeat(others > 0, _CELL, axis=0), _CELL, axis=1)
            crop = np.where(is_other[: crop.shape[0], : crop.shape[1]], np.uint8(0), crop)
        found += _components(crop, x * _CELL, y * _CELL, least_area, most)
        found.sort(key=_rank)
        del found[most:]
    return found


def _components(crop: NDArray[np.uint8], x: int, y: int, least_area: int, most: int) -> list[Component]:
    """Those of a part of the mask that begins at x, y."""
    crop = np.ascontiguousarray(crop)
    if cv2.connectedComponents(crop, connectivity=8)[0] == 2:  # one alone: a third of the time of sorting out several
        x0, y0, width, height = cv2.boundingRect(crop)
        pixels = (crop[y0 : y0 + height, x0 : x0 + width] > 0).view(np.uint8)
        area = cv2.countNonZero(pixels)
        return [Component(x + x0, y + y0, area, pixels)] if area >= least_area else []
    _, labels, stats = _labelled(crop)
    ranks = np.lexsort((stats[1:, cv2.CC_STAT_LEFT], stats[1:, cv2.CC_STAT_TOP], -stats[1:, cv2.CC_STAT_AREA]))
    found = []
    for label in ranks[:most] + 1:
        left, top, width, height, area = (int(value) for value in stats[label])
        if area < least_area:
            break
        pixels = (labels[top : top + height, left : left + width] == label).view(np.uint8)
        found.append(Component(x + left, y + top, area, pixels))
    return found


def _labelled(mask: NDArray[np.uint8]) -> tuple[int, NDArray[np.int32], NDArray[np.int32]]:
    number, labels, stats, _ = cv2.connectedComponentsWithStats(mask, connectivity=8)
    return number, np.asarray(labels, dtype=np.int32), np.asarray(stats, dtype=np.int32)


def _rank(component: Component) -> tuple[int, int, int]:
    return -component.area, component.top, component.left


def _counted(mask: NDArray[np.uint8]) -> NDArray[np.int64]:
    """How many pixels of each cell are positive."""
    height, width = (-(-size // _CELL) * _CELL for size in mask.shape)
    ones = (mask > 0).view(np.uint8)
    if (height, width) != mask.shape:
        ones = np.pad(ones, ((0, height - mask.shape[0]), (0, width - mask.shape[1])))
    # eight pixels to a word, eight words to a sum: no byte of it overflows
    words = np.add.reduce(ones.view(np.uint64).reshape(height // _CELL, _CELL, -1), axis=1)
    counts: NDArray[np.uint64] = words * _SUM_OF_BYTES >> _TOP_BYTE
    return counts.astype(np.int64)
