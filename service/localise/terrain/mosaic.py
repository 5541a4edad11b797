"""Tiles laid side by side onto places: seams without a step, the finest first, what lacks not known. `dem` calls it."""

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from distloc.types import FloatArray
from service.localise.terrain.blocks import Blocks, DemError
from service.localise.terrain.tile import GEOGRAPHIC, Tile, sample, weights

Float32Array = NDArray[np.float32]

_PART = 65_536  # places at a time
_LEAST = 1e-4  # of a height: less is rounding


class GeoidUnknownError(DemError):
    """Heights over the ellipsoid, and nobody told yet how high the geoid is."""


def heights_at(
    tiles: Sequence[Tile],
    places: FloatArray,
    blocks: Blocks,
    undulation_m: float | None = None,
    tell: Callable[[DemError], None] = lambda _: None,
) -> Float32Array:
    """Heights above the sea (N,) at longitudes and latitudes (2, N) in degrees; NaN where no tile has one.

    Where tiles overlap the first that has a height gives it; `tell` hears of each that can't be read any further.
    GeoidUnknownError where the geoid's height over the ellipsoid is wanted and None.
    """
    laid = _Laid(places.shape[1])
    epsg, xy = GEOGRAPHIC, places
    for tile in tiles:
        if tile.epsg != epsg:
            epsg, xy = tile.epsg, places if tile.epsg == GEOGRAPHIC else _projected(tile.epsg, places)
        if not _may_touch(tile, xy):
            continue
        try:
            laid.lay(tile, blocks, xy, undulation_m)
        except GeoidUnknownError:
            raise
        except DemError as error:
            tell(error)
    return laid.heights_m()


class _Laid:
    """Heights of N places, as far as the tiles that were laid make them up."""

    def __init__(self, count: int) -> None:
        self._sum_m, self._left = np.zeros(count, np.float32), np.ones(count, np.float32)
        self._is_known = np.zeros(count, np.bool_)

    def heights_m(self) -> Float32Array:
        """(N,): beyond the outermost pixels' middles, to their edge, as at their middles."""
        share = np.maximum(np.float32(1.0) - self._left, np.float32(_LEAST))
        return np.where(self._is_known, self._sum_m / share, np.float32(np.nan))

    def lay(self, tile: Tile, blocks: Blocks, xy: FloatArray, undulation_m: float | None) -> None:
        """Add what a tile has; places (2, N) are in its CRS, in rows from the south."""
        count = len(self._left)
        for start in reversed(range(0, count, _PART)):  # as files go, from the north
            part = slice(start, start + _PART)
            col, row = tile.pixels_from_place(xy[0, part], xy[1, part])
            share = np.minimum(weights(tile, col, row), self._left[part])
            wanted = np.flatnonzero(share > _LEAST)
            if not len(wanted):
                continue
            heights_m = sample(tile, blocks, col[wanted], row[wanted]) - _geoid_m(tile, undulation_m)
            wanted, heights_m = wanted[np.isfinite(heights_m)], heights_m[np.isfinite(heights_m)]
            at = start + wanted
            self._sum_m[at] += share[wanted] * heights_m
            self._left[at] -= share[wanted]
            self._is_known[at] |= tile.covers(col[wanted], row[wanted])


def _geoid_m(tile: Tile, undulation_m: float | None) -> float:
    if not tile.meaning.is_ellipsoidal:
        return 0.0
    if undulation_m is None:
        raise GeoidUnknownError(
            f"{tile.path}: heights over the ellipsoid: the autopilot must tell the geoid's (GPS_RAW_INT.alt_ellipsoid)"
        )
    return undulation_m


def _projected(epsg: int, places: FloatArray) -> FloatArray:
    from pyproj import Transformer  # 15 MB: only who has a DEM that has a projection pays for it

    return np.array(Transformer.from_crs(GEOGRAPHIC, epsg, always_xy=True).transform(*places))


def _may_touch(tile: Tile, xy: FloatArray) -> bool:
    """Whether the tile is near enough to the places to ask each of them; a folder may hold a continent."""
    middle = xy[:, xy.shape[1] // 2]
    col, row = tile.pixels_from_place(middle[:1], middle[1:])
    reach = np.abs(xy - middle[:, None])
    wide, high = np.minimum(reach.max(axis=1), 1e9) / (tile.step_x, tile.step_y) + 1.0
    return bool(-wide <= col[0] <= tile.raster.cols + wide and -high <= row[0] <= tile.raster.rows + high)
