"""Hill shade of a DEM, the files that the drone takes as well, as tiles: drawn when they are asked for."""

import math
from collections import OrderedDict
from pathlib import Path

import cv2
import numpy as np

from service.ground.background.shade import shade, tile_places
from service.ground.background.tile import Tile, Told, is_tile
from service.ground.faults import GroundError
from service.localise.terrain.blocks import Blocks, DemError
from service.localise.terrain.dem import open_dem
from service.localise.terrain.mosaic import heights_at
from service.localise.terrain.tile import Tile as DemTile

_MIN_ZOOM, _MAX_ZOOM = 10, 16  # 100 to 2 m a pixel, but none smaller than a DEM's; the browser enlarges beyond
_PIXEL_M = 156_543.0  # of zoom 0 at the equator
_MOST_HEIGHT_BYTES = 100_000_000  # of decoded heights that are held
_MOST_DRAWN = 256


class HillShade:
    """GroundError where there is no DEM that can be used; a file that turns out broken later has no heights."""

    def __init__(self, path: Path) -> None:
        try:
            self._files = open_dem(path)
        except DemError as error:
            raise GroundError(f"--dem: {error}") from error
        self.told = Told(min_zoom=_MIN_ZOOM, max_zoom=_finest(self._files[0]), is_shade=True)
        self._blocks = Blocks(_MOST_HEIGHT_BYTES)
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
        pixel_m = _PIXEL_M * math.cos(math.radians(float(places[1].mean()))) / (1 << zoom)
        files = [one.at_step(pixel_m) for one in self._files]
        # a geoid's height is the same all over a picture, so any will do
        heights_m = heights_at(files, places.reshape(2, -1), self._blocks, undulation_m=0.0).reshape(places.shape[1:])
        if np.isnan(heights_m).all():
            return None
        picture = shade(heights_m, places[1], zoom)
        return Tile(cv2.imencode(".png", picture)[1].tobytes(), "image/png")


def _finest(one: DemTile) -> int:
    """The zoom whose pixels are about the DEM's: smaller ones would show its facets."""
    east = math.cos(math.radians(one.north)) if one.is_in_degrees else 0.7
    return min(max(round(math.log2(_PIXEL_M * max(east, 0.1) / one.step_m)), _MIN_ZOOM), _MAX_ZOOM)
