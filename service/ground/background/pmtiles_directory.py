"""Directories of a PMTiles archive: which tile lies where. Free of I/O; `pmtiles` calls it."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray


class Directory(NamedTuple):
    """Sorted by `first`, the number of the first tile; a run of 0 leads to a directory of leaves."""

    first: NDArray[np.int64]
    run: NDArray[np.int64]
    length: NDArray[np.int64]
    offset: NDArray[np.int64]


def directory(data: bytes) -> Directory:
    """As the specification writes them, section 4; ValueError where it is none."""
    count, *values = _varints(data)
    if count < 1 or len(values) != 4 * count:
        raise ValueError("a directory that is none")
    try:
        steps, run, length, told = np.array(values, np.int64).reshape(4, count)
    except OverflowError as error:
        raise ValueError("a number beyond 64 bits") from error
    offset = told - 1
    for at in np.nonzero(told == 0)[0]:  # right after the one before
        if at == 0:
            raise ValueError("a directory that begins nowhere")
        offset[at] = offset[at - 1] + length[at - 1]
    first = np.cumsum(steps)
    if (first < 0).any() or (offset < 0).any() or (np.diff(first) < 0).any():
        raise ValueError("a directory out of order")
    return Directory(first, run, length, offset)


def tile_number(zoom: int, x: int, y: int) -> int:
    """Its place on the Hilbert curve of its zoom, after all tiles of the zooms before."""
    number = ((1 << 2 * zoom) - 1) // 3
    for level in range(zoom - 1, -1, -1):
        size = 1 << level
        right, down = bool(x & size), bool(y & size)
        number += size * size * ((3 * right) ^ down)
        x, y = x & (size - 1), y & (size - 1)
        if not down:
            if right:
                x, y = size - 1 - x, size - 1 - y
            x, y = y, x
    return number


def _varints(data: bytes) -> list[int]:
    """Numbers of 7 bits a byte, the lowest first; the top bit says that there is more."""
    out, value, shift = list[int](), 0, 0
    for byte in data:
        value |= (byte & 0x7F) << shift
        if byte & 0x80:
            shift += 7
            if shift > 63:
                raise ValueError("a number beyond 64 bits")
        else:
            out.append(value)
            value = shift = 0
    if shift or not out:
        raise ValueError("it ends within a number")
    return out
