"""A TIFF page's tiles or strips as blocks that are read and decoded one by one. `geotiff` calls it."""

import struct
import zlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from service.localise.terrain.blocks import DemError, Raster

BROKEN = (OSError, ValueError, TypeError, KeyError, IndexError, RuntimeError, struct.error, zlib.error)  # of tifffile

_MOST_BLOCK_PIXELS = 16_777_216  # 64 MB as float32 while one is read; a Copernicus tile's blocks have a million
_MOST_BLOCKS = 1_000_000  # 16 MB of offsets; a degree at one arc second has 9 or 16, by rows 3600
_PLAIN_ROWS = 64  # a block of numbers that lie as they are, in one strip


def raster_of(path: Path, page: Any) -> Raster:
    """The numbers of a page, whose file may be closed then; DemError where it is cut off or its blocks too large."""
    rows, cols = page.shape
    high, wide = (page.tilelength, page.tilewidth) if page.is_tiled else (min(page.rowsperstrip, rows), cols)
    needed = -(-rows // max(high, 1)) * -(-cols // max(wide, 1))
    if needed > _MOST_BLOCKS:
        raise DemError(f"{path}: in {needed} blocks: at most {_MOST_BLOCKS}, as gdal_translate -of COG makes them")
    offsets, counts = (np.array(told, np.uint64) for told in (page.dataoffsets, page.databytecounts))
    if min(high, wide) < 1 or len(offsets) != needed or len(counts) != needed:
        raise DemError(f"{path}: not a TIFF file: {len(offsets)} blocks for {cols} x {rows} pixels of {wide} x {high}")
    size, end = path.stat().st_size, int((offsets + counts).max(initial=0))
    if end > size:
        raise DemError(f"{path}: its heights can't be read: it is cut off, {size} bytes of {end}: fetch it again")
    if needed == 1 and page.compression == page.predictor == page.fillorder == 1 and not page.is_tiled:
        return _plain(path, page, int(offsets[0]), int(counts[0]))
    if high * wide > _MOST_BLOCK_PIXELS:
        raise DemError(f"{path}: in blocks of {wide} x {high} pixels: gdal_translate -of COG makes smaller ones")
    packed = _Packed(path, page, offsets, counts, -(-cols // wide))
    return Raster(path, rows, cols, high, wide, packed.read)


@dataclass(frozen=True, slots=True)
class _Packed:
    """Blocks that tifffile decodes."""

    path: Path
    page: Any
    offsets: NDArray[np.uint64]
    counts: NDArray[np.uint64]
    across: int

    def read(self, row: int, col: int) -> NDArray[Any] | None:
        number = row * self.across + col
        offset, count = int(self.offsets[number]), int(self.counts[number])
        if not offset or not count:  # GDAL leaves out a block in which nothing is known
            return None
        try:
            with self.path.open("rb") as file:
                file.seek(offset)
                numbers, _, (_, high, wide, _) = self.page.decode(file.read(count), number)
            return np.ascontiguousarray(numbers[0, :high, :wide, 0])
        except BROKEN as error:
            raise DemError(f"{self.path}: its heights can't be read: {line_of(error)}") from error


def _plain(path: Path, page: Any, offset: int, count: int) -> Raster:
    """One strip of numbers as they are: some rows of it are a block."""
    rows, cols = page.shape
    kind = page.dtype.newbyteorder(page.parent.byteorder)
    row_bytes = cols * kind.itemsize
    if count < rows * row_bytes:
        raise DemError(f"{path}: its heights can't be read: {count} bytes for {cols} x {rows} pixels of {kind}")

    def read(row: int, _: int) -> NDArray[Any]:
        first = row * _PLAIN_ROWS
        try:
            with path.open("rb") as file:
                file.seek(offset + first * row_bytes)
                content = file.read(min(_PLAIN_ROWS, rows - first) * row_bytes)
            return np.frombuffer(content, kind).reshape(-1, cols)
        except (OSError, ValueError) as error:
            raise DemError(f"{path}: its heights can't be read: {line_of(error)}") from error

    return Raster(path, rows, cols, _PLAIN_ROWS, cols, read)


def line_of(error: BaseException) -> str:
    """What an exception says, in one line."""
    return " ".join(str(error).split()) or type(error).__name__
