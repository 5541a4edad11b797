"""One file of a digital elevation model, header read and heights not yet, and SRTM's .hgt as one. `dem` calls it."""

import re
import zipfile
import zlib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from distloc.types import FloatArray
from service.localise.terrain.meaning import METRES, Meaning

GEOGRAPHIC = 4326  # EPSG's number of WGS84 longitude and latitude

_UNTOLD_VOID = -32768.0  # what a raster of 16 bits has where nothing is known, told by a tag or not
_LAND_M = (-500.0, 9000.0)  # the Dead Sea's shore is at -430, Everest at 8849: what is outside marks a void
_HGT_NAME = re.compile(r"(?P<ns>[NS])(?P<lat>\d{2})(?P<ew>[EW])(?P<lon>\d{3})", re.IGNORECASE)
_HGT_SIZES = {2 * nodes**2: nodes for nodes in (1201, 3601, 7201)}  # bytes: SRTM3, SRTM1, half an arc second


class DemError(Exception):
    """A DEM can't be used: one line says which file, why and what would be right."""


@dataclass(frozen=True, slots=True)
class Tile:
    """A raster whose first row is the northernmost and first column the westernmost.

    `west`, `north` are the first pixel's centre in the units of the CRS `epsg`. `load` reads the heights (rows, cols).
    """

    path: Path
    epsg: int
    west: float
    north: float
    step_x: float
    step_y: float
    rows: int
    cols: int
    void: float
    load: Callable[[], NDArray[Any]]
    meaning: Meaning = METRES  # of its numbers; `void` is one of them as they are
    is_in_degrees: bool = True  # x is a longitude, which comes round again after 360

    def pixels_from_place(self, x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Columns and rows, fractional; longitudes are taken on the tile's side of the date line."""
        if self.is_in_degrees:
            middle = self.west + 0.5 * self.step_x * (self.cols - 1)
            x = middle + (x - middle + 180.0) % 360.0 - 180.0
        return (x - self.west) / self.step_x, (self.north - y) / self.step_y

    def covers(self, col: FloatArray, row: FloatArray) -> NDArray[np.bool_]:
        """Whether each is on a pixel, out to its edge: tiles that only abut leave no gap."""
        reach = 0.5 + 1e-6
        return (col >= -reach) & (col <= self.cols - 1 + reach) & (row >= -reach) & (row <= self.rows - 1 + reach)


def sample(tile: Tile, numbers: NDArray[Any], col: FloatArray, row: FloatArray) -> FloatArray:
    """Heights in metres between pixels, bilinear; NaN where one of the four is void; past the outermost, those."""
    rows, cols = numbers.shape
    scale, offset_m = tile.meaning.scale, tile.meaning.offset_m
    col, row = np.clip(col, 0.0, cols - 1.0), np.clip(row, 0.0, rows - 1.0)
    j, i = np.minimum(col.astype(np.intp), cols - 2), np.minimum(row.astype(np.intp), rows - 2)
    col, row = col - j, row - i

    def at(down: int, right: int) -> FloatArray:
        number = numbers[i + down, j + right].astype(np.float64)
        height = number * scale + offset_m
        is_void = ~((height > _LAND_M[0]) & (height < _LAND_M[1])) | (number == tile.void) | (number == _UNTOLD_VOID)
        return np.where(is_void, np.nan, height)

    north = at(0, 0) * (1.0 - col) + at(0, 1) * col
    south = at(1, 0) * (1.0 - col) + at(1, 1) * col
    return np.asarray(north * (1.0 - row) + south * row)


def open_hgt(path: Path) -> Tile:
    """An SRTM tile, also as it is handed out, in a .zip; the name gives its south-western corner."""
    name = _HGT_NAME.match(path.name)
    if name is None:
        raise DemError(f"{path}: the name of an .hgt file must say its south-western corner, as N47E008.hgt does")
    lat = int(name["lat"]) * (1 if name["ns"].upper() == "N" else -1)
    lon = int(name["lon"]) * (1 if name["ew"].upper() == "E" else -1)
    member = _member(path)
    size = path.stat().st_size if member is None else member.file_size
    nodes = _HGT_SIZES.get(size)
    if nodes is None:
        raise DemError(f"{path}: holds {size} bytes: an .hgt file has {' or '.join(map(str, sorted(_HGT_SIZES)))}")
    step = 1.0 / (nodes - 1)
    return Tile(
        path, GEOGRAPHIC, lon, lat + 1.0, step, step, nodes, nodes, -32768.0, lambda: _hgt_heights(path, member, nodes)
    )


def _member(path: Path) -> zipfile.ZipInfo | None:
    if path.suffix.lower() != ".zip":
        return None
    try:
        with zipfile.ZipFile(path) as archive:
            found = [one for one in archive.infolist() if one.filename.lower().endswith(".hgt") and not _is_twin(one)]
    except (OSError, zipfile.BadZipFile) as error:
        raise DemError(f"{path}: not a .zip file: {error}") from error
    if len(found) != 1:
        raise DemError(f"{path}: holds {len(found)} .hgt files: one was expected")
    return found[0]


def _is_twin(one: zipfile.ZipInfo) -> bool:
    """Whether macOS made it beside the file."""
    return one.filename.startswith("__MACOSX/") or Path(one.filename).name.startswith("._")


def _hgt_heights(path: Path, member: zipfile.ZipInfo | None, nodes: int) -> NDArray[Any]:
    try:
        if member is None:
            content = path.read_bytes()
        else:
            with zipfile.ZipFile(path) as archive:
                content = archive.read(member)
        return np.frombuffer(content, ">i2").reshape(nodes, nodes)
    except (OSError, ValueError, RuntimeError, NotImplementedError, zipfile.BadZipFile, zlib.error) as error:
        raise DemError(f"{path}: its heights can't be read: {error}") from error
