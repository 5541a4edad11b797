"""Tiles laid side by side onto places: seams without a step, the finest first, what lacks not known. `dem` calls it."""

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from distloc.types import FloatArray
from service.localise.terrain.blocks import Blocks, DemError
from service.localise.terrain.tile import GEOGRAPHIC, Tile, sample, weights

Float32Array = NDArray[np.float32]

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

    Some ten thousand places at a time: a dozen arrays of them are made. Where tiles overlap the first that has a height
    gives it; `tell` hears of each that can't be read any further.
    GeoidUnknownError where the geoid's height over the ellipsoid is wanted and None.
    """
    laid = _Laid(places.shape[1])
    here = _Here(GEOGRAPHIC, places)
    for tile in tiles:
        if tile.epsg != here.epsg:
            here = _Here(tile.epsg, places if tile.epsg == GEOGRAPHIC else _projected(tile.epsg, places))
        if not here.is_near(tile):
            continue
        try:
            laid.lay(tile, blocks, here.xy, undulation_m)
        except GeoidUnknownError:
            raise
        except DemError as error:
            tell(error)
        if laid.is_full:
            break
    return laid.heights_m()


class _Here:
    """Places (2, N) in a CRS, and how far they lie about the middle one."""

    def __init__(self, epsg: int, xy: FloatArray) -> None:
        self.epsg, self.xy = epsg, xy
        self._middle = xy[:, xy.shape[1] // 2]
        self._reach = np.minimum(np.abs(xy - self._middle[:, None]).max(axis=1), 1e9)

    def is_near(self, tile: Tile) -> bool:
        """Whether a tile is near enough to ask it for each place; a folder may hold a continent."""
        col, row = tile.pixels_from_place(self._middle[:1], self._middle[1:])
        wide, high = self._reach / (tile.step_x, tile.step_y) + 1.0
        return bool(-wide <= col[0] <= tile.raster.cols + wide and -high <= row[0] <= tile.raster.rows + high)


class _Laid:
    """Heights of N places, as far as the tiles that were laid make them up."""

    def __init__(self, count: int) -> None:
        self._sum_m, self._left = np.zeros(count, np.float32), np.ones(count, np.float32)
        self._is_known = np.zeros(count, np.bool_)

    @property
    def is_full(self) -> bool:
        """Whether nothing is left to be told."""
        return float(self._left.max(initial=0.0)) <= _LEAST

    def heights_m(self) -> Float32Array:
        """(N,): beyond the outermost pixels' middles, to their edge, as at their middles."""
        share = np.maximum(np.float32(1.0) - self._left, np.float32(_LEAST))
        return np.where(self._is_known, self._sum_m / share, np.float32(np.nan))

    def lay(self, tile: Tile, blocks: Blocks, xy: FloatArray, undulation_m: float | None) -> None:
        """Add what a tile has; places (2, N) are in its CRS."""
        col, row = tile.pixels_from_place(*xy)
        share = np.minimum(weights(tile, col, row), self._left)
        wanted = np.flatnonzero(share > _LEAST)
        if not len(wanted):
            return
        heights_m = sample(tile, blocks, col[wanted], row[wanted]) - _geoid_m(tile, undulation_m)
        is_known = np.isfinite(heights_m)
        wanted, heights_m = wanted[is_known], heights_m[is_known]
        self._sum_m[wanted] += share[wanted] * heights_m
        self._left[wanted] -= share[wanted]
        self._is_known[wanted] |= tile.covers(col[wanted], row[wanted])


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
