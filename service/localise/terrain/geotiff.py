"""A GeoTIFF with a DEM in it as a tile; reads the georeference of OGC 19-008r4 (GeoTIFF 1.1). `dem` calls it."""

import logging
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from service.localise.terrain.blocks import Raster
from service.localise.terrain.geotiff_blocks import BROKEN, line_of, raster_of
from service.localise.terrain.meaning import Meaning, meaning_of, stated_beside, stated_in_metadata
from service.localise.terrain.tile import GEOGRAPHIC, DemError, Tile

_PIXEL_SCALE, _TIEPOINT, _TRANSFORMATION, _NODATA, _METADATA = _TAGS = (33550, 33922, 34264, 42113, 42112)
_PROJECTED, _GEOGRAPHIC = 1, 2  # GTModelTypeGeoKey
_PIXEL_IS_POINT = 2  # GTRasterTypeGeoKey: the tie point is a pixel's centre and not its corner
_USER_DEFINED = 32767
_PALETTE = 3  # PhotometricInterpretation
_MOST_BESIDE_BYTES = 1_000_000  # of an .aux.xml
_MOST_OVERVIEWS = 16
_REDUCED, _MASK = 1, 4  # bits of NewSubfileType
_REMEDY = "gdalwarp -t_srs EPSG:4326 makes a right one"


@dataclass(frozen=True, slots=True)
class _Georeference:
    """Centre of the first pixel and the steps east and south, in the CRS' units."""

    west: float
    north: float
    step_x: float
    step_y: float


def open_geotiff(path: Path) -> Tile:
    """A tile of one band, north up, in an EPSG geographic or projected CRS, with its overviews."""
    tifffile = _tifffile()
    try:
        with tifffile.TiffFile(path) as file:
            page = file.pages[0]
            tags = {number: page.tags[number].value for number in _TAGS if number in page.tags}
            keys = page.geotiff_tags if page.is_geotiff else {}
            _check(path, page)
            rasters = [raster_of(path, page), *(raster_of(path, one) for one in _reduced(file, page))]
    except BROKEN as error:
        raise DemError(f"{path}: not a TIFF file: {line_of(error)}") from error
    georeference = _georeference(path, tags, keys)
    crs = _crs(path, keys)
    meaning = _meaning(path, tags, keys, crs)
    if page.dtype.itemsize == 1 and not meaning.is_stated:
        raise DemError(f"{path}: is {page.dtype}, a picture (a hillshade?) and no heights: a DEM has 16 bits or more")
    first = Tile(
        path=path,
        epsg=crs.to_2d().to_epsg() or crs.to_epsg() or GEOGRAPHIC,
        west=georeference.west,
        north=georeference.north,
        step_x=georeference.step_x,
        step_y=georeference.step_y,
        void=_void(path, tags),
        raster=rasters[0],
        meaning=meaning,
        is_in_degrees=crs.is_geographic and crs.axis_info[0].unit_name == "degree",
    )
    return replace(first, overviews=tuple(_coarser(first, one) for one in rasters[1:]))


def _check(path: Path, page: Any) -> None:
    shape, kind = page.shape, page.dtype
    if len(shape) != 2 or min(shape) < 2 or kind is None or kind.kind not in "iuf" or page.photometric == _PALETTE:
        raise DemError(f"{path}: is {kind} of shape {shape}: a DEM has one band of numbers")
    if fault := _decoder_fault(page):
        raise DemError(f"{path}: its heights can't be read: {fault}")


def _reduced(file: Any, page: Any) -> list[Any]:
    """The overviews of the first page: smaller, of the same kind and no masks, the finest first."""
    pages, most = [], page.shape
    for number in range(1, _MOST_OVERVIEWS + 1):
        try:
            one = file.pages[number]
            kind = int(one.subfiletype)
            if not kind & _REDUCED or kind & _MASK:
                continue
            if one.dtype != page.dtype or len(one.shape) != 2 or not 2 <= min(one.shape) <= max(one.shape) < max(most):
                break
        except BROKEN:  # no further page, or a broken one: what there is will do
            break
        pages.append(one)
        most = one.shape
    return pages


def _coarser(first: Tile, raster: Raster) -> Tile:
    """An overview: as wide and high as the whole, edge to edge."""
    step_x = first.step_x * first.raster.cols / raster.cols
    step_y = first.step_y * first.raster.rows / raster.rows
    west, north = first.west + 0.5 * (step_x - first.step_x), first.north - 0.5 * (step_y - first.step_y)
    return replace(first, west=west, north=north, step_x=step_x, step_y=step_y, raster=raster)


def _georeference(path: Path, tags: dict[int, Any], keys: dict[str, Any]) -> _Georeference:
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
    return _Georeference(west + half * step_x, north - half * step_y, step_x, step_y)


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
        raise DemError(f"{path}: {line_of(error)}") from error


def _decoder_fault(page: Any) -> str:
    """Why its compression cannot be undone here: a codec that is not installed, or none that is known."""
    try:
        page.decode(None, 0)
    except (ValueError, NotImplementedError, ImportError) as error:
        return line_of(error)
    return ""


def _void(path: Path, tags: dict[int, Any]) -> float:
    text = str(tags.get(_NODATA, "nan")).strip("\0 ") or "nan"
    try:
        return float(text)
    except ValueError:
        raise DemError(f"{path}: its nodata tag is {text!r:.40}: a number is needed") from None


def _tifffile() -> Any:
    try:
        import tifffile
    except ImportError as error:
        raise DemError("a GeoTIFF DEM needs the tifffile package: pip install '.[dem]' in distloc's folder") from error
    logging.getLogger("tifffile").setLevel(logging.CRITICAL)  # what is wrong with a file is told in one line of ours
    return tifffile
