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

    Of two as large the one whose first pixel is read first comes first.
    """
    cells = _counted(mask)
    left, top, across, upright = cv2.boundingRect((cells > 0).view(np.uint8))
    if across == 0:
        return []
    cells, mask = cells[top : top + upright, left : left + across], mask[top * _CELL :, left * _CELL :]
    filled = (cells > 0).view(np.uint8)
    number, labelled, table, _ = cv2.connectedComponentsWithStats(filled, connectivity=8)
    groups, boxes = np.asarray(labelled, dtype=np.int32), np.asarray(table, dtype=np.int32)
    counts = np.bincount(groups.ravel(), weights=cells.ravel(), minlength=number)
    counts[0] = 0.0
    order = np.flatnonzero(counts >= least_area)
    order = order[np.argsort(-counts[order], kind="stable")]
    boxed = (boxes[order, cv2.CC_STAT_WIDTH] * boxes[order, cv2.CC_STAT_HEIGHT]).sum()
    if order.size > 4 * most or boxed > cells.size:  # specks all over, boxes within boxes: all at once is less
        crop = mask[: upright * _CELL, : across * _CELL]
        return _components(crop, left * _CELL, top * _CELL, least_area, most)
    found: list[Component] = []
    for group in order.tolist():
        if len(found) >= most:
            found.sort(key=_rank)
            del found[most:]
            if found[-1].area > counts[group]:
                break
        x, y, width, height, number = boxes[group].tolist()
        box = slice(y, y + height), slice(x, x + width)
        crop = mask[y * _CELL : (y + height) * _CELL, x * _CELL : (x + width) * _CELL]
        if cv2.countNonZero(filled[box]) > number:
            is_other = np.repeat(np.repeat(filled[box] * (groups[box] != group), _CELL, axis=0), _CELL, axis=1)
            crop = np.where(is_other[: crop.shape[0], : crop.shape[1]], np.uint8(0), crop)
        found += _components(crop, (left + x) * _CELL, (top + y) * _CELL, least_area, most)
    return sorted(found, key=_rank)[:most]


def _components(crop: NDArray[np.uint8], x: int, y: int, least_area: int, most: int) -> list[Component]:
    """Those of a part of the mask that begins at x, y."""
    crop = np.ascontiguousarray(crop)
    number, labelled = cv2.connectedComponents(crop, connectivity=8)
    if number == 2:  # one alone
        x0, y0, width, height = cv2.boundingRect(crop)
        pixels = (crop[y0 : y0 + height, x0 : x0 + width] > 0).view(np.uint8)
        area = cv2.countNonZero(pixels)
        return [Component(x + x0, y + y0, area, pixels)] if area >= least_area else []
    labels = np.asarray(labelled, dtype=np.int32)
    places = np.flatnonzero(crop > 0)  # in reading order; of bools it is the faster
    of_place = labels.reshape(-1)[places]
    areas = np.bincount(of_place, minlength=number)
    first = np.zeros(number, np.intp)
    first[of_place[::-1]] = places[::-1]  # of several the last is kept, which is the first
    ranks = np.lexsort((first, -areas))[:most]
    return [_component(labels, places[of_place == label], x, y) for label in ranks if areas[label] >= least_area]


def _component(labels: NDArray[np.int32], places: NDArray[np.intp], x: int, y: int) -> Component:
    """That of these places in a part of the mask that begins at x, y."""
    rows, columns = np.divmod(places, labels.shape[1])
    top, left = int(rows[0]), int(columns.min())
    box = labels[top : int(rows[-1]) + 1, left : int(columns.max()) + 1]
    return Component(x + left, y + top, places.size, (box == labels[top, columns[0]]).view(np.uint8))


def _rank(component: Component) -> tuple[int, int, int]:
    return -component.area, component.top, component.left + int(component.pixels[0].argmax())


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
