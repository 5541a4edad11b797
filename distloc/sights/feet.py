"""Plumes that have grown together in the picture: each stands on a foot of its own. The detections ask."""

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from distloc.sights.components import Component

_LEAST, _SHARE = 3, 0.5  # how far a foot stands out: at least, of what is looked at; and of its width there
_OTHERS_SHARE = 0.25  # of the width of that beside it
_MOST = 128  # pixels of a side that are looked at


def plumes_of(component: Component, least_area: int) -> list[Component]:
    """The plumes that a component of a mask shows, from left to right; itself where it has one foot.

    The notch between two feet rises over the shallower by half that foot's width at least: smoke that leans is lumpy
    beneath, and trees before it make its lower edge ragged, but neither as tall as it is wide. A plume takes the
    columns up to the notches; one with fewer pixels than `least_area` is left with its neighbour.
    """
    notches = _notches(component.pixels)
    edges, total = [0], np.cumsum(component.pixels.sum(axis=0, dtype=np.int64)) if notches else np.zeros(1, np.int64)
    for notch in notches:
        before = int(total[edges[-1] - 1]) if edges[-1] else 0
        if total[notch - 1] - before >= least_area and component.area - total[notch - 1] >= least_area:
            edges.append(notch)
    if len(edges) == 1:
        return [component]
    edges.append(component.pixels.shape[1])
    return [_part(component, left, right) for left, right in pairwise(edges)]


def _part(component: Component, left: int, right: int) -> Component:
    columns = component.pixels[:, left:right]
    across, upright = np.flatnonzero(columns.any(axis=0)), np.flatnonzero(columns.any(axis=1))
    top, first = int(upright[0]), int(across[0])
    pixels = np.ascontiguousarray(columns[top : int(upright[-1]) + 1, first : int(across[-1]) + 1])
    area = int(np.count_nonzero(pixels))
    return Component(component.left + left + first, component.top + top, area, pixels)


def _notches(pixels: NDArray[np.uint8]) -> list[int]:
    """The columns, rising, at which the lower edge of (h, w) is highest between two feet.

    Columns flood from below: where two basins meet, how deep the shallower is says whether it is a foot.
    """
    stride = -(-max(pixels.shape) // _MOST)
    up = pixels[::-1, ::stride].argmax(axis=0) // stride  # no column is empty, for the component hangs together
    over = up - np.maximum(np.minimum.accumulate(up), np.minimum.accumulate(up[::-1])[::-1])
    if over.max() < _LEAST:
        return []
    heights: list[int] = up.tolist()
    basin: list[int] = [-1] * len(heights)  # the column that stands for that of each
    lowest, width = heights.copy(), [1] * len(heights)
    found = []
    for column in np.argsort(up, kind="stable").tolist():
        basin[column] = column
        for beside in (column - 1, column + 1):
            if not (0 <= beside < len(basin) and basin[beside] >= 0):
                continue
            one, other = _root_of(basin, column), _root_of(basin, beside)
            if lowest[one] < lowest[other]:
                one, other = other, one
            out = heights[column] - lowest[one]
            is_foot = out >= max(_LEAST, _SHARE * width[one])
            if is_foot and heights[column] - lowest[other] >= _OTHERS_SHARE * width[other]:
                found.append(column * stride)
            basin[one] = other
            width[other] += width[one]
    return sorted(column for column in found if column > 0)


def _root_of(basin: list[int], column: int) -> int:
    while basin[column] != column:
        column = basin[column]
    return column
