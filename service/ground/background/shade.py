"""Hill shade: how light falls on heights, from the north-west, as maps have it. Free of I/O."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from distloc.types import FloatArray

TILE_PX = 256
_EQUATOR_M = 40_075_016.686
_LIGHT = np.array([-0.5, 0.5, np.sqrt(0.5)])  # east, north, up: azimuth 315 degrees, 45 above the horizon
_STEEPER = 1.6  # than it is, as the eye wants it
_DARK, _BRIGHT = 0.5, 0.4  # the most that a pixel is blackened or whitened


def tile_places(zoom: int, x: int, y: int) -> FloatArray:
    """Longitude and latitude (2, 258, 258) in degrees of a tile's pixels and of one more all round."""
    along = (np.arange(-1, TILE_PX + 1) + 0.5) / TILE_PX
    lon_deg = (x + along) / (1 << zoom) * 360.0 - 180.0
    lat_deg = np.degrees(np.arctan(np.sinh(np.pi * (1.0 - 2.0 * (y + along) / (1 << zoom)))))
    return np.stack(np.meshgrid(lon_deg, lat_deg))


def shade(heights_m: NDArray[np.floating[Any]], lat_deg: FloatArray, zoom: int) -> NDArray[np.uint8]:
    """Black or white and how opaque (256, 256, 4), blue, green, red, alpha; clear where a height is NaN.

    `heights_m` and `lat_deg` are those of `tile_places`, the first row the northernmost.
    """
    step_m = _EQUATOR_M * np.cos(np.radians(lat_deg[1:-1, 1:-1])) / (TILE_PX << zoom)
    east = _STEEPER * (heights_m[1:-1, 2:] - heights_m[1:-1, :-2]) / (2.0 * step_m)
    north = _STEEPER * (heights_m[:-2, 1:-1] - heights_m[2:, 1:-1]) / (2.0 * step_m)
    light = (_LIGHT[2] - _LIGHT[0] * east - _LIGHT[1] * north) / np.sqrt(1.0 + east**2 + north**2)
    more = np.nan_to_num(light - _LIGHT[2])  # than level ground has
    opaque = np.where(more < 0.0, _DARK * np.minimum(-more / _LIGHT[2], 1.0), _BRIGHT * more / (1.0 - _LIGHT[2]))
    out = np.zeros((*more.shape, 4), np.uint8)
    out[..., :3] = np.where(more > 0.0, 255, 0)[..., None]
    out[..., 3] = np.round(255.0 * opaque)
    return out
