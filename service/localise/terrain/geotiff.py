"""A GeoTIFF with a DEM in it as a tile; reads the georeference of OGC 19-008r4 (GeoTIFF 1.1). `dem` calls it."""

import struct
import zlib
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from service.localise.terrain.meaning import Meaning, meaning_of, stated_beside, stated_in_metadata
from service.localise.terrain.tile import GEOGRAPHIC, DemError, Tile

_PIXEL_SCALE, _TIEPOINT, _TRANSFORMATION, _NODATA, _METADATA = _TAGS = (33550, 33922, 34264, 42113, 42112)
_PROJECTED, _GEOGRAPHIC = 1, 2  # GTModelTypeGeoKey
_PIXEL_IS_POINT = 2  # GTRasterTypeGeoKey: the tie point is a pixel's centre and not its corner
_USER_DEFINED = 32767
_PALETTE = 3  # PhotometricInterpretation
_MOST_BESIDE_BYTES = 1_000_000  # of an .aux.xml
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
            shape, kind, photometric = page.shape, page.dtype, int(page.photometric)
            segments = list(zip(page.dataoffsets, page.databytecounts, strict=False))
            decoder_fault = "" if kind is None else _decoder_fault(page)
    except _BROKEN as error:
        raise DemError(f"{path}: not a TIFF file: {_line(error)}") from error
    if len(shape) != 2 or min(shape) < 2 or kind is None or kind.kind not in "iuf" or photometric == _PALETTE:
        raise DemError(f"{path}: is {kind} of shape {shape}: a DEM has one band of numbers")
    if shape[0] * shape[1] > _MOST_PIXELS:
        raise DemError(f"{path}: {shape[1]} x {shape[0]} pixels: cut or coarsen it to {_MOST_PIXELS} pixels or fewer")
    if decoder_fault:
        raise DemError(f"{path}: its heights can't be read: {decoder_fault}")
    size, needed = path.stat().st_size, max((offset + count for offset, count in segments), default=0)
    if needed > size:
        raise DemError(f"{path}: its heights can't be read: it is cut off, {size} bytes of {needed}: fetch it again")
    west, north, step_x, step_y = _georeference(path, tags, keys)
    crs = _crs(path, keys)
    meaning = _meaning(path, tags, keys, crs)
    if kind.itemsize == 1 and not meaning.is_stated:
        raise DemError(f"{path}: is {kind}, a picture (a hillshade?) and no heights: a DEM has 16 bits or more")
    rows, cols = shape
    return Tile(
        path=path,
        epsg=crs.to_2d().to_epsg() or crs.to_epsg() or GEOGRAPHIC,
        west=west,
        north=north,
        step_x=step_x,
        step_y=step_y,
        rows=rows,
        cols=cols,
        void=_void(path, tags),
        load=lambda: _heights(path),
        meaning=meaning,
        is_in_degrees=crs.is_geographic and crs.axis_info[0].unit_name == "degree",
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


def _crs(path: Path, keys: dict[str, Any]) -> Any:
    from pyproj import CRS
    from pyproj.exceptions import CRSError

    model = keys.get("GTModelTypeGeoKey")
    name = {_PROJECTED: "ProjectedCSTypeGeoKey", _GEOGRAPHIC: "GeographicTypeGeoKey"}.get(model or 0, "")
    code = int(keys.get(name, _USER_DEFINED))
    try:
        crs = None if code == _USER_DEFINED else CRS.from_epsg(code)
    except CRSError:
        crs = None
    if crs is None or not (crs.is_projected if model == _PROJECTED else crs.is_geographic):
        raise DemError(f"{path}: its CRS has no EPSG number of a projected or geographic one: {_REMEDY}")
    return crs


def _meaning(path: Path, tags: dict[int, Any], keys: dict[str, Any], crs: Any) -> Meaning:
    beside = path.with_name(path.name + ".aux.xml")
    stated = {}
    try:
        if beside.is_file() and beside.stat().st_size <= _MOST_BESIDE_BYTES:
            stated = stated_beside(beside.read_text(encoding="utf-8", errors="replace"))
        return meaning_of(stated | stated_in_metadata(str(tags.get(_METADATA, ""))), keys, crs)
    except (OSError, ValueError) as error:
        raise DemError(f"{path}: {_line(error)}") from error


def _decoder_fault(page: Any) -> str:
    """Why its compression cannot be undone here: a codec that is not installed, or none that is known."""
    try:
        page.decode(None, 0)
    except (ValueError, NotImplementedError, ImportError) as error:
        return _line(error)
    return ""


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
        raise DemError("a GeoTIFF DEM needs the tifffile package: pip install '.[dem]' in distloc's folder") from error
    return tifffile


def _line(error: BaseException) -> str:
    return " ".join(str(error).split()) or type(error).__name__
