"""A DEM's files (SRTM .hgt, GeoTIFF) resampled onto a local grid about the flight. `ground_prior` calls it.

The DEM's and MAVLink's heights are both above the sea, or the DEM's are turned so by the geoid's height that the
autopilot tells; a geoid model apart (EGM96, EGM2008) is a metre, in sigma.
"""

from pathlib import Path

import numpy as np

from distloc.filter.ground import EARTH_RADIUS_M, Float32Array, GridGround
from distloc.geometry.geodesy import LocalFrame
from distloc.types import FloatArray
from service.localise.terrain.geotiff import open_geotiff
from service.localise.terrain.tile import GEOGRAPHIC, DemError, Tile, open_hgt, sample

__all__ = ["DemError", "GeoidUnknownError", "ground_from_dem", "open_dem"]

_OPENERS = {".hgt": open_hgt, ".hgt.zip": open_hgt, ".tif": open_geotiff, ".tiff": open_geotiff}
_NODES = 1201  # a side: 6 MB whatever the DEM; 50 m apart over 60 km, near SRTM's 30 and 90 m
_BLOCK = 65_536  # nodes at a time
_MOST_NAMED = 16  # files that were passed over


class GeoidUnknownError(DemError):
    """Heights over the ellipsoid, and nobody told yet how high the geoid is."""


def open_dem(path: Path, passed_over: list[str] | None = None) -> list[Tile]:
    """The tiles of a file or of a folder, headers read.

    What a folder holds beside them (pictures, broken files) is passed over: a line for each goes to `passed_over`.
    DemError where nothing is left, and for a file that can't be used.
    """
    if not path.exists():
        raise DemError(f"{path}: no such file or folder")
    if not path.is_dir():
        return [_opened(path)]
    lines = [] if passed_over is None else passed_over
    tiles = []
    files = sorted(one for one in path.iterdir() if _kind(one))
    for file in files:
        try:
            tiles.append(_opened(file))
        except DemError as error:
            _name(lines, error)
    if not files:
        raise DemError(f"{path}: holds no DEM: {', '.join(_OPENERS)} files are read")
    if not tiles:
        raise DemError(f"{path}: holds no DEM that can be used: {lines[0].removeprefix(str(path) + '/')}")
    return tiles


def ground_from_dem(
    path: Path,
    frame: LocalFrame,
    sigma_m: float,
    half_width_m: float = 30_000.0,
    nodes: int = _NODES,
    undulation_m: float | None = None,
    passed_over: list[str] | None = None,
) -> GridGround:
    """The DEM on a square grid about the frame's origin, in its axes; not known where no tile has a height.

    Where tiles overlap, the first by name that has a height gives it. The frame's height must be above the sea.
    `undulation_m` is the geoid's height over the ellipsoid; GeoidUnknownError where it is wanted and None.
    """
    from pyproj import Transformer  # 15 MB: only who flies with a DEM pays for it

    lines = [] if passed_over is None else passed_over
    tiles = open_dem(path, lines)
    axis_m = np.linspace(-half_width_m, half_width_m, nodes)
    east_m, north_m = (part.reshape(-1) for part in np.meshgrid(axis_m, axis_m))
    places, up_minus_height_m = _level_places(frame, east_m, north_m)
    heights_m = np.full(nodes * nodes, np.nan, np.float32)
    epsg, xy = GEOGRAPHIC, places
    broken: DemError | None = None
    for tile in tiles:
        if tile.epsg != epsg:
            to_crs = Transformer.from_crs(GEOGRAPHIC, tile.epsg, always_xy=True)
            epsg, xy = tile.epsg, np.array(to_crs.transform(*places))
        try:
            _fill(heights_m, tile, xy, undulation_m)
        except GeoidUnknownError:
            raise
        except DemError as error:
            broken = error
            _name(lines, error)
    if broken is not None and np.isnan(heights_m).all():
        raise broken
    up_m = (heights_m + up_minus_height_m).reshape(nodes, nodes)
    return GridGround(up_m, -half_width_m, -half_width_m, 2.0 * half_width_m / (nodes - 1), sigma_m)


def _name(lines: list[str], error: DemError) -> None:
    if len(lines) < _MOST_NAMED and str(error) not in lines:
        lines.append(str(error))


def _kind(path: Path) -> str:
    return next((ending for ending in _OPENERS if path.name.lower().endswith(ending)), "")


def _opened(path: Path) -> Tile:
    if not path.is_file():
        raise DemError(f"{path}: not a file")
    if path.name.startswith("._"):
        raise DemError(f"{path}: no DEM but what macOS keeps beside one: delete it")
    kind = _kind(path)
    if not kind:
        raise DemError(f"{path}: not a DEM by its name: {', '.join(_OPENERS)} files are read")
    try:
        return _OPENERS[kind](path)
    except OSError as error:
        raise DemError(f"{path}: cannot be read: {error}") from error


def _level_places(frame: LocalFrame, east_m: FloatArray, north_m: FloatArray) -> tuple[FloatArray, Float32Array]:
    """Longitude and latitude (2, N) of each node at the origin's level, and its up less its height above the sea there.

    Up grows with height one to one, but for the vertical's tilt d / R: 5 mm in height and 2 m sideways, far under a
    cell, at 30 km and 500 m above the origin's level. So a node's up is its ground's height plus that difference.
    """
    from pyproj import Transformer

    lat_deg, lon_deg, height_m = frame.origin
    geodetic_from_enu = Transformer.from_pipeline(
        "+proj=pipeline +step +inv +proj=topocentric +ellps=WGS84 "
        f"+lat_0={lat_deg!r} +lon_0={lon_deg!r} +h_0={height_m!r} "
        "+step +inv +proj=cart +ellps=WGS84 +step +proj=unitconvert +xy_in=rad +xy_out=deg"
    )
    places, difference_m = np.empty((2, len(east_m))), np.empty(len(east_m), np.float32)
    for start in range(0, len(east_m), _BLOCK):
        part = slice(start, start + _BLOCK)
        up_m = (east_m[part] ** 2 + north_m[part] ** 2) / (-2.0 * EARTH_RADIUS_M)
        places[0, part], places[1, part], heights_m = geodetic_from_enu.transform(east_m[part], north_m[part], up_m)
        difference_m[part] = up_m - heights_m
    return places, difference_m


def _fill(heights_m: Float32Array, tile: Tile, xy: FloatArray, undulation_m: float | None) -> None:
    """Write the tile's heights into `heights_m` where it has none yet; a tile that lies elsewhere is not read."""
    parts = [slice(start, start + _BLOCK) for start in range(0, len(heights_m), _BLOCK)]
    pixels = None
    if not _may_touch(tile, xy):
        return
    if tile.meaning.is_ellipsoidal and undulation_m is None:
        raise GeoidUnknownError(
            f"{tile.path}: heights over the ellipsoid: the autopilot must tell the geoid's (GPS_RAW_INT.alt_ellipsoid)"
        )
    geoid_m = undulation_m or 0.0 if tile.meaning.is_ellipsoidal else 0.0
    for part in parts:
        col, row = tile.pixels_from_place(xy[0, part], xy[1, part])
        wanted = tile.covers(col, row) & np.isnan(heights_m[part])
        if wanted.any():
            pixels = tile.load() if pixels is None else pixels
            heights_m[part][wanted] = sample(tile, pixels, col[wanted], row[wanted]) - geoid_m


def _may_touch(tile: Tile, xy: FloatArray) -> bool:
    """Whether the tile is near enough to the grid's nodes to ask each of them; a folder may hold a continent."""
    middle = xy[:, xy.shape[1] // 2]
    col, row = tile.pixels_from_place(middle[:1], middle[1:])
    reach = np.abs(xy - middle[:, None])
    wide, high = np.minimum(reach.max(axis=1), 1e9) / (tile.step_x, tile.step_y)
    return bool(-wide - 1 <= col[0] <= tile.cols + wide and -high - 1 <= row[0] <= tile.rows + high)
