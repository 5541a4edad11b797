"""Hill shade of a DEM, the files that the drone takes as well, as tiles: drawn when they are asked for."""

import math
from collections import OrderedDict
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from distloc.types import FloatArray
from service.ground.background.shade import shade, tile_places
from service.ground.background.tile import Tile, Told, is_tile
from service.ground.faults import GroundError
from service.localise.terrain.dem import DemError, open_dem
from service.localise.terrain.tile import GEOGRAPHIC, sample
from service.localise.terrain.tile import Tile as DemTile

_MIN_ZOOM, _MAX_ZOOM = 10, 16  # 100 to 2 m a pixel, but none smaller than a DEM's; the browser enlarges beyond
_METRES_A_DEGREE = 111_320.0
_PIXEL_M = 156_543.0  # of zoom 0 at the equator
_MOST_HEIGHT_BYTES = 200_000_000  # of files that are held; the last one whatever it has
_MOST_DRAWN = 256


class HillShade:
    """GroundError where there is no DEM that can be used; a file that turns out broken later has no heights."""

    def __init__(self, path: Path) -> None:
        try:
            self._files = open_dem(path)
        except DemError as error:
            raise GroundError(f"--dem: {error}") from error
        self.told = Told(min_zoom=_MIN_ZOOM, max_zoom=_finest(self._files[0]), is_shade=True)
        self._heights: OrderedDict[Path, NDArray[Any] | None] = OrderedDict()
        self._drawn: OrderedDict[tuple[int, int, int], Tile | None] = OrderedDict()

    def tile(self, zoom: int, x: int, y: int) -> Tile | None:
        """One image, rows counted from the north; None where no height is known."""
        if not is_tile(zoom, x, y) or not self.told.min_zoom <= zoom <= self.told.max_zoom:
            return None
        place = (zoom, x, y)
        if place not in self._drawn:
            self._drawn[place] = self._draw(zoom, x, y)
            if len(self._drawn) > _MOST_DRAWN:
                self._drawn.popitem(last=False)
        self._drawn.move_to_end(place)
        return self._drawn[place]

    def close(self) -> None:
        """Nothing is open."""

    def _draw(self, zoom: int, x: int, y: int) -> Tile | None:
        places = tile_places(zoom, x, y)
        heights_m = self._heights_at(places.reshape(2, -1)).reshape(places.shape[1:])
        if np.isnan(heights_m).all():
            return None
        picture = shade(heights_m, places[1], zoom)
        return Tile(cv2.imencode(".png", picture)[1].tobytes(), "image/png")

    def _heights_at(self, places: FloatArray) -> FloatArray:
        """Of longitudes and latitudes (2, N), by the first file that has one; NaN where none has."""
        heights_m = np.full(places.shape[1], np.nan)
        for one in self._files:
            xy = places if one.epsg == GEOGRAPHIC else _projected(one.epsg, places)
            col, row = one.pixels_from_place(xy[0], xy[1])
            wanted = one.covers(col, row) & np.isnan(heights_m)
            if not wanted.any():
                continue
            numbers = self._loaded(one)
            if numbers is not None:
                heights_m[wanted] = sample(one, numbers, col[wanted], row[wanted])
        return heights_m

    def _loaded(self, one: DemTile) -> NDArray[Any] | None:
        if one.path not in self._heights:
            try:
                numbers = one.load()
            except DemError:
                numbers = None
            self._heights[one.path] = numbers
            self._make_room()
        self._heights.move_to_end(one.path)
        return self._heights[one.path]

    def _make_room(self) -> None:
        held = [path for path, numbers in self._heights.items() if numbers is not None]
        total = sum(numbers.nbytes for numbers in self._heights.values() if numbers is not None)
        while total > _MOST_HEIGHT_BYTES and len(held) > 1:
            gone = self._heights.pop(held.pop(0))
            total -= 0 if gone is None else gone.nbytes


def _finest(one: DemTile) -> int:
    """The zoom whose pixels are about the DEM's: smaller ones would show its facets."""
    step_m = one.step_y * (_METRES_A_DEGREE if one.is_in_degrees else 1.0)
    east = math.cos(math.radians(one.north)) if one.is_in_degrees else 0.7
    return min(max(round(math.log2(_PIXEL_M * max(east, 0.1) / step_m)), _MIN_ZOOM), _MAX_ZOOM)


def _projected(epsg: int, places: FloatArray) -> FloatArray:
    from pyproj import Transformer  # 15 MB: only who shows a DEM that has a projection pays for it

    return np.array(Transformer.from_crs(GEOGRAPHIC, epsg, always_xy=True).transform(*places))
