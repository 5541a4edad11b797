"""Numbers of a raster that lies in a file by blocks: only those asked for are read and decoded. `tile` calls it."""

from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from distloc.types import FloatArray

_MOST_FAULTS = 16
_LEAST_BYTES = 256  # what it costs to know that a block has nothing

IntArray = NDArray[np.intp]


class DemError(Exception):
    """A DEM can't be used: one line says which file, why and what would be right."""


@dataclass(frozen=True, slots=True, eq=False)
class Raster:
    """Numbers (rows, cols) in blocks of (block_rows, block_cols), those at the southern and eastern edge cut off.

    `read` gives one by its row and column among the blocks, or None where the file says that nothing is known; it
    raises DemError.
    """

    path: Path
    rows: int
    cols: int
    block_rows: int
    block_cols: int
    read: Callable[[int, int], NDArray[Any] | None]

    @property
    def across(self) -> int:
        """Blocks side by side."""
        return -(-self.cols // self.block_cols)

    @property
    def count(self) -> int:
        """Blocks in all."""
        return self.across * -(-self.rows // self.block_rows)


class Blocks:
    """Decoded blocks of any rasters, the last used of them up to `most_bytes`, and one more.

    What can't be read is not known; `faults` has a line for each file. DemError once over `most_pixels` were decoded:
    a raster of metres without overviews is too large to be read for a map of kilometres.
    """

    def __init__(self, most_bytes: int, most_pixels: float = float("inf")) -> None:
        self.faults: list[str] = []
        self._most_bytes, self._left_pixels = most_bytes, most_pixels
        self._held: OrderedDict[tuple[Raster, int], NDArray[Any] | None] = OrderedDict()
        self._held_bytes = 0

    def numbers(self, raster: Raster, row: IntArray, col: IntArray) -> FloatArray:
        """The numbers (N,) at rows and columns (N,); NaN where their block can't be read."""
        found = np.full(len(row), np.nan)
        block = (row // raster.block_rows) * raster.across + col // raster.block_cols
        order = np.argsort(block, kind="stable")
        starts = np.flatnonzero(np.diff(block[order], prepend=-1))
        for start, end in zip(starts, [*starts[1:], len(order)], strict=True):
            own = order[start:end]
            numbers = self._block(raster, int(block[own[0]]))
            if numbers is not None:
                found[own] = numbers[row[own] % raster.block_rows, col[own] % raster.block_cols]
        return found

    def _block(self, raster: Raster, number: int) -> NDArray[Any] | None:
        key = (raster, number)
        if key not in self._held:
            self._make_room()
            numbers = self._read(raster, number)
            self._held[key] = numbers
            self._held_bytes += _bytes(numbers)
        self._held.move_to_end(key)
        return self._held[key]

    def _read(self, raster: Raster, number: int) -> NDArray[Any] | None:
        self._left_pixels -= raster.block_rows * raster.block_cols
        if self._left_pixels < 0:
            raise DemError(
                f"{raster.path}: too many pixels are needed for the map: give it overviews (gdaladdo -r average)"
            )
        try:
            return raster.read(*divmod(number, raster.across))
        except DemError as error:
            if len(self.faults) < _MOST_FAULTS and not any(line.startswith(f"{raster.path}: ") for line in self.faults):
                self.faults.append(str(error))
            return None

    def _make_room(self) -> None:
        while self._held and self._held_bytes > self._most_bytes:
            _, gone = self._held.popitem(last=False)
            self._held_bytes -= _bytes(gone)


def _bytes(numbers: NDArray[Any] | None) -> int:
    return _LEAST_BYTES if numbers is None else numbers.nbytes
