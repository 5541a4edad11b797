"""A GeoTIFF with a DEM in it as a tile; reads the georeference of OGC 19-008r4 (GeoTIFF 1.1). `dem` calls it."""

import struct
import zlib
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from service.localise.terrain.tile import DemError, Tile

_PIXEL_SCALE, _TIEPOINT, _TRANSFORMATION, _NODATA = _TAGS = (33550, 33922, 34264, 42113)
_PROJECTED, _GEOGRAPHIC = 1, 2  # GTModelTypeGeoKey
_PIXEL_IS_POINT = 2  # GTRasterTypeGeoKey: the tie point is a pixel's centre and not its corner
_METRE, _USER_DEFINED = 9001, 32767
_MOST_PIXELS = 64_000_000  # 256 MB as float32 while it is read; a degree at one arc second is 13 million
_BROKEN = (OSError, ValueError, TypeError, KeyError, IndexError, RuntimeError, struct.error, zlib.error)  # of tifffile
_REMEDY = "gdalwarp -t_srs EPSG:4326 makes a right one"


def open_geotiff(path: Path) -> Tile:
    """A tile of one band, north up, in an EPSG geographic or projected CRS."""
    tifffile = _tifffile()
    try:
        with tifffile.TiffFile(path) as file:
            page = file.pages[0]
            tags = {number: page.tags[number].value for number in _TAGS if number in page.tags}
            keys = page.geotiff_tags if page.is_geotiff else {}
            shape, kind = page.shape, page.dtype
    except _BROKEN as error:
        raise DemError(f"{path}: not a TIFF file: {_line(error)}") from error
    if len(shape) != 2 or min(shape) < 2 or kind is None or kind.kind not in "iuf":
        raise DemError(f"{path}: is {kind} of shape {shape}: a DEM has one band of numbers")
    if shape[0] * shape[1] > _MOST_PIXELS:
        raise DemError(f"{path}: {shape[1]} x {shape[0]} pixels: cut or coarsen it to {_MOST_PIXELS} pixels or fewer")
    west, north, step_x, step_y = _georeference(path, tags, keys)
    rows, cols = shape
    return Tile(
        path, _epsg(path, keys), west, north, step_x, step_y, rows, cols, _void(path, tags), lambda: _heights(path)
    )


def _georeference(path: Path, tags: dict[int, Any], keys: dict[str, Any]) -> tuple[float, float, float, float]:
    """Centre of the first pixel and the steps east and south, in the CRS' units."""
    scale, tie = np.ravel(tags.get(_PIXEL_SCALE, ())), np.ravel(tags.get(_TIEPOINT, ()))
    matrix = np.ravel(tags.get(_TRANSFORMATION, ()))
    if scale.size >= 2 and tie.size == 6:
        step_x, step_y = float(scale[0]), float(scale[1])
        west, north = float(tie[3] - tie[0] * step_x), float(tie[4] + tie[1] * step_y)
    elif matrix.size == 16 and matrix[1] == matrix[4] == 0.0:
        step_x, step_y, west, north = (float(value) for value in (matrix[0], -matrix[5], matrix[3], matrix[7]))
    else:
        raise DemError(f"{path}: has no georeference (scale and one tie point, unrotated): {_REMEDY}")
    if not (np.isfinite([west, north]).all() and step_x > 0.0 and step_y > 0.0):
        raise DemError(f"{path}: its pixels step {step_x} east and {step_y} south: both must be above 0; {_REMEDY}")
    half = 0.0 if keys.get("GTRasterTypeGeoKey") == _PIXEL_IS_POINT else 0.5
    return west + half * step_x, north - half * step_y, step_x, step_y


def _epsg(path: Path, keys: dict[str, Any]) -> int:
    from pyproj import CRS
    from pyproj.exceptions import CRSError

    unit = keys.get("VerticalUnitsGeoKey", _METRE)
    if unit != _METRE:
        raise DemError(f"{path}: heights in unit EPSG:{int(unit)}: metres (EPSG:{_METRE}) are needed")
    model = keys.get("GTModelTypeGeoKey")
    name = {_PROJECTED: "ProjectedCSTypeGeoKey", _GEOGRAPHIC: "GeographicTypeGeoKey"}.get(model or 0, "")
    code = int(keys.get(name, _USER_DEFINED))
    try:
        crs = None if code == _USER_DEFINED else CRS.from_epsg(code)
    except CRSError:
        crs = None
    if crs is None or not (crs.is_projected if model == _PROJECTED else crs.is_geographic):
        raise DemError(f"{path}: its CRS has no EPSG number of a projected or geographic one: {_REMEDY}")
    return code


def _void(path: Path, tags: dict[int, Any]) -> float:
    text = str(tags.get(_NODATA, "nan")).strip("\0 ") or "nan"
    try:
        return float(text)
    except ValueError:
        raise DemError(f"{path}: its nodata tag is {text!r:.40}: a number is needed") from None


def _heights(path: Path) -> NDArray[Any]:
    tifffile = _tifffile()
    try:
        return np.asarray(tifffile.imread(path, key=0))
    except _BROKEN as error:
        raise DemError(f"{path}: its heights can't be read: {_line(error)}") from error


def _tifffile() -> Any:
    try:
        import tifffile
    except ImportError as error:
        raise DemError("a GeoTIFF DEM needs the tifffile package: pip install 'distloc[dem]'") from error
    return tifffile


def _line(error: BaseException) -> str:
    return " ".join(str(error).split()) or type(error).__name__
