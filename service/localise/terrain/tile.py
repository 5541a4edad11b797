"""One file of a digital elevation model: its header is read, its heights when a place's are asked. `dem` calls it."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from distloc.types import FloatArray
from service.localise.terrain.blocks import Blocks, DemError, Raster
from service.localise.terrain.meaning import METRES, Meaning

__all__ = ["GEOGRAPHIC", "DemError", "Tile", "sample", "weights"]

GEOGRAPHIC = 4326  # EPSG's number of WGS84 longitude and latitude

_UNTOLD_VOID = -32768.0  # what a raster of 16 bits has where nothing is known, told by a tag or not
_LAND_M = (-500.0, 9000.0)  # the Dead Sea's shore is at -430, Everest at 8849: what is outside marks a void
_METRES_A_DEGREE = 111_320.0  # of latitude


@dataclass(frozen=True, slots=True)
class Tile:
    """A raster whose first row is the northernmost and first column the westernmost.

    `west`, `north` are the first pixel's centre in the units of the CRS `epsg`. `overviews` are the same on fewer
    pixels, the finest first.
    """

    path: Path
    epsg: int
    west: float
    north: float
    step_x: float
    step_y: float
    void: float
    raster: Raster
    meaning: Meaning = METRES  # of its numbers; `void` is one of them as they are
    is_in_degrees: bool = True  # x is a longitude, which comes round again after 360
    overviews: tuple["Tile", ...] = ()

    @property
    def step_m(self) -> float:
        """How far its rows are apart."""
        return self.step_y * (_METRES_A_DEGREE if self.is_in_degrees else 1.0)

    def at_step(self, step_m: float) -> "Tile":
        """The coarsest of it and its overviews that still has a row every `step_m`."""
        return next((one for one in reversed(self.overviews) if one.step_m <= step_m), self)

    def pixels_from_place(self, x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Columns and rows, fractional; longitudes are taken on the tile's side of the date line."""
        if self.is_in_degrees:
            middle = self.west + 0.5 * self.step_x * (self.raster.cols - 1)
            x = middle + (x - middle + 180.0) % 360.0 - 180.0
        return (x - self.west) / self.step_x, (self.north - y) / self.step_y

    def covers(self, col: FloatArray, row: FloatArray) -> NDArray[np.bool_]:
        """Whether each is on a pixel, out to its edge: tiles that only abut leave no gap."""
        reach = 0.5 + 1e-6
        on_row = (row >= -reach) & (row <= self.raster.rows - 1 + reach)
        return on_row & (col >= -reach) & (col <= self.raster.cols - 1 + reach)


def weights(tile: Tile, col: FloatArray, row: FloatArray) -> FloatArray:
    """The share (N,) of each height that the tile's pixels make up: 1 between them, less within a pixel beyond.

    There the neighbour that abuts has the rest, so that a height between two tiles, or four, is what it would be if
    they were one raster.
    """
    beyond_cols = np.maximum(np.maximum(-col, col - (tile.raster.cols - 1)), 0.0)
    beyond_rows = np.maximum(np.maximum(-row, row - (tile.raster.rows - 1)), 0.0)
    return np.asarray(np.maximum(1.0 - beyond_cols, 0.0) * np.maximum(1.0 - beyond_rows, 0.0))


def sample(tile: Tile, blocks: Blocks, col: FloatArray, row: FloatArray) -> FloatArray:
    """Heights in metres between pixels, bilinear; NaN where one of the four is void; past the outermost, those."""
    rows, cols = tile.raster.rows, tile.raster.cols
    scale, offset_m = tile.meaning.scale, tile.meaning.offset_m
    col, row = np.clip(col, 0.0, cols - 1.0), np.clip(row, 0.0, rows - 1.0)
    j, i = np.minimum(col.astype(np.intp), cols - 2), np.minimum(row.astype(np.intp), rows - 2)
    col, row = col - j, row - i
    number = blocks.numbers(tile.raster, np.concatenate([i, i, i + 1, i + 1]), np.concatenate([j, j + 1, j, j + 1]))
    heights = number * scale + offset_m
    is_void = ~((heights > _LAND_M[0]) & (heights < _LAND_M[1])) | (number == tile.void) | (number == _UNTOLD_VOID)
    heights[is_void] = np.nan
    north_west, north_east, south_west, south_east = heights.reshape(4, -1)
    north = north_west * (1.0 - col) + north_east * col
    south = south_west * (1.0 - col) + south_east * col
    return np.asarray(north * (1.0 - row) + south * row)
