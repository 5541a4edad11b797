"""A DEM's files (SRTM .hgt, GeoTIFF) resampled onto a local grid about the flight. `ground_prior` calls it.

The DEM's and MAVLink's heights are both above the sea, or the DEM's are turned so by the geoid's height that the
autopilot tells; a geoid model apart (EGM96, EGM2008) is a metre, in sigma.
"""

import math
from collections.abc import Callable
from pathlib import Path

import numpy as np

from distloc.filter.ground import Float32Array, GridGround
from distloc.geometry.earth import EARTH_RADIUS_M
from distloc.geometry.geodesy import LocalFrame
from distloc.types import FloatArray
from service.localise.terrain.blocks import Blocks, DemError
from service.localise.terrain.geotiff import open_geotiff
from service.localise.terrain.hgt import open_hgt
from service.localise.terrain.mosaic import GeoidUnknownError, heights_at
from service.localise.terrain.tile import Tile

__all__ = ["DemError", "GeoidUnknownError", "ground_from_dem", "open_dem"]

_OPENERS = {".hgt": open_hgt, ".hgt.zip": open_hgt, ".tif": open_geotiff, ".tiff": open_geotiff}
_NODES = 1201  # a side: 6 MB whatever the DEM; 50 m apart over 60 km, near SRTM's 30 and 90 m
_PART = 65_536  # nodes at a time
_MOST_NAMED = 16  # files that were passed over
_MOST_BYTES = 32_000_000  # of decoded blocks at a time: a row of a Copernicus tile's
_MOST_PIXELS = 500_000_000  # decoded for one grid: some seconds
_PATCHES, _PROBED = 5, 6  # a side: where the grid is held against the finest heights, cells in each
_WORTH_TELLING = 0.1  # of sigma, which less would widen by half a percent


def open_dem(path: Path, passed_over: list[str] | None = None) -> list[Tile]:
    """The tiles of a file or of a folder, headers read.

    The finest come first, and those alike by name. What a folder holds beside them (pictures, broken files) is passed
    over: a line for each goes to `passed_over`.
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
            _name(lines, str(error))
    if not files:
        raise DemError(f"{path}: holds no DEM: {', '.join(_OPENERS)} files are read")
    if not tiles:
        raise DemError(f"{path}: holds no DEM that can be used: {lines[0].removeprefix(str(path) + '/')}")
    return sorted(tiles, key=lambda one: (round(math.log(one.step_m), 2), one.path.name))


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

    Of the files only the blocks under the grid are read, of overviews where the grid is coarser. What a coarse grid
    loses of the finest heights is measured at some places and told in the ground's sigma, beside `sigma_m`. The
    frame's height must be above the sea. `undulation_m` is the geoid's height over the ellipsoid; GeoidUnknownError
    where it is wanted and None.
    """
    lines = [] if passed_over is None else passed_over
    step_m = 2.0 * half_width_m / (nodes - 1)
    tiles = open_dem(path, lines)
    blocks = Blocks(_MOST_BYTES, _MOST_PIXELS)
    axis_m = np.linspace(-half_width_m, half_width_m, nodes)
    coarse = [tile.at_step(step_m) for tile in tiles]
    broken: list[DemError] = []
    up_m = _ups(coarse, frame, axis_m, blocks, undulation_m, broken.append)
    for line in [*map(str, broken), *blocks.faults]:
        _name(lines, line)
    if (broken or blocks.faults) and np.isnan(up_m).all():
        raise DemError(str(broken[0]) if broken else blocks.faults[0])
    level = GridGround(up_m, -half_width_m, -half_width_m, step_m, sigma_m)
    loss_m = _loss_m(level, tiles, frame, blocks, undulation_m)
    told_m = float(np.hypot(sigma_m, loss_m)) if loss_m > _WORTH_TELLING * sigma_m else sigma_m
    return GridGround(_leaned(level), -half_width_m, -half_width_m, step_m, told_m)


def _ups(
    tiles: list[Tile],
    frame: LocalFrame,
    axis_m: FloatArray,
    blocks: Blocks,
    undulation_m: float | None,
    tell: Callable[[DemError], None] = lambda _: None,
) -> Float32Array:
    """Ups (N, N) of the tiles' heights on a grid of these easts and norths (N,), at the origin's level; NaN unknown."""
    up_m = np.empty((len(axis_m), len(axis_m)), np.float32)
    rows = max(_PART // len(axis_m), 1)
    for start in reversed(range(0, len(axis_m), rows)):  # as files go, from the north
        part = slice(start, start + rows)
        east_m, north_m = (one.reshape(-1) for one in np.meshgrid(axis_m, axis_m[part]))
        places, up_minus_height_m = _level_places(frame, east_m, north_m)
        ups_m = heights_at(tiles, places, blocks, undulation_m, tell) + up_minus_height_m
        up_m[part] = ups_m.reshape(-1, len(axis_m))
    return up_m


def _leaned(level: GridGround) -> Float32Array:
    """Ups (rows, cols) of places at the origin's level, moved to where what stands over these really is.

    The vertical leans outwards by d / R: 19 m sideways for a summit of 2,000 m at 60 km.
    """
    leaned = np.empty_like(level.up_m)
    last_m = -level.west_m
    axis_m = np.linspace(level.west_m, last_m, len(leaned))
    for i, north_m in enumerate(axis_m):
        height_m = level.up_m[i] + (np.square(axis_m) + north_m**2) / (2.0 * EARTH_RADIUS_M)
        back = 1.0 - np.nan_to_num(height_m) / EARTH_RADIUS_M
        ups_m, is_known = level.heights_m(*np.clip([axis_m * back, north_m * back], level.west_m, last_m))
        leaned[i] = np.where(is_known, ups_m, level.up_m[i])
    return leaned


def _loss_m(
    level: GridGround, tiles: list[Tile], frame: LocalFrame, blocks: Blocks, undulation_m: float | None
) -> float:
    """How far the grid is from the finest heights between its nodes, root mean square of its rougher half."""
    first = np.linspace(0, max(len(level.up_m) - 1 - _PROBED, 0), _PATCHES).astype(np.intp)
    cells = np.minimum(first[:, None] + np.arange(_PROBED), len(level.up_m) - 2).reshape(-1)
    axis_m = level.west_m + level.step_m * (cells + 0.5)
    finest_m = _ups(tiles, frame, axis_m, blocks, undulation_m)
    east_m, north_m = (one.reshape(-1) for one in np.meshgrid(axis_m, axis_m))
    grid_m, is_known = level.heights_m(east_m, north_m)
    squares = np.where(is_known, np.square(finest_m.reshape(-1) - grid_m), np.nan).reshape(
        _PATCHES, _PROBED, _PATCHES, _PROBED
    )
    counts = np.isfinite(squares).sum(axis=(1, 3))
    patches = np.sort((np.nansum(squares, axis=(1, 3)) / np.maximum(counts, 1))[counts > 0])
    rougher = patches[len(patches) // 2 :]
    return float(np.sqrt(rougher.mean())) if len(rougher) else 0.0


def _name(lines: list[str], line: str) -> None:
    if len(lines) < _MOST_NAMED and line not in lines:
        lines.append(line)


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

    Up grows with height one to one, but for the vertical's lean: a tenth of a metre at 60 km and 2,000 m above the
    origin's level. So a node's up is its ground's height plus that difference.
    """
    from pyproj import Transformer

    lat_deg, lon_deg, height_m = frame.origin
    geodetic_from_enu = Transformer.from_pipeline(
        "+proj=pipeline +step +inv +proj=topocentric +ellps=WGS84 "
        f"+lat_0={lat_deg!r} +lon_0={lon_deg!r} +h_0={height_m!r} "
        "+step +inv +proj=cart +ellps=WGS84 +step +proj=unitconvert +xy_in=rad +xy_out=deg"
    )
    up_m = (east_m**2 + north_m**2) / (-2.0 * EARTH_RADIUS_M)
    lon_deg, lat_deg, heights_m = geodetic_from_enu.transform(east_m, north_m, up_m)
    return np.stack([lon_deg, lat_deg]), np.asarray(up_m - heights_m, np.float32)
