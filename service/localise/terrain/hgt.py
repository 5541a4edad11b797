"""SRTM's .hgt, also in a .zip as it is handed out, as a tile; rows are read when they are wanted. `dem` calls it."""

import re
import zipfile
import zlib
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from service.localise.terrain.blocks import DemError, Raster
from service.localise.terrain.tile import GEOGRAPHIC, Tile

_NAME = re.compile(r"(?P<ns>[NS])(?P<lat>\d{2})(?P<ew>[EW])(?P<lon>\d{3})", re.IGNORECASE)
_SIZES = {2 * nodes**2: nodes for nodes in (1201, 3601, 7201)}  # bytes: SRTM3, SRTM1, half an arc second
_VOID = -32768.0
_BLOCK_ROWS, _ZIPPED_ROWS = 64, 512  # a .zip is unpacked from its start for each
_CHUNK_BYTES = 1 << 20
_BROKEN = (OSError, ValueError, RuntimeError, NotImplementedError, zipfile.BadZipFile, zlib.error, EOFError)


def open_hgt(path: Path) -> Tile:
    """An SRTM tile; the name gives its south-western corner."""
    name = _NAME.match(path.name)
    if name is None:
        raise DemError(f"{path}: the name of an .hgt file must say its south-western corner, as N47E008.hgt does")
    lat = int(name["lat"]) * (1 if name["ns"].upper() == "N" else -1)
    lon = int(name["lon"]) * (1 if name["ew"].upper() == "E" else -1)
    member = _member(path)
    size = path.stat().st_size if member is None else member.file_size
    nodes = _SIZES.get(size)
    if nodes is None:
        raise DemError(f"{path}: holds {size} bytes: an .hgt file has {' or '.join(map(str, sorted(_SIZES)))}")
    step, block_rows = 1.0 / (nodes - 1), _BLOCK_ROWS if member is None else _ZIPPED_ROWS
    raster = Raster(path, nodes, nodes, block_rows, nodes, _Rows(path, member, nodes, block_rows).read)
    return Tile(path, GEOGRAPHIC, lon, lat + 1.0, step, step, _VOID, raster)


class _Rows:
    """Reads blocks of whole rows; a .zip's checksum is of all that is in it and looked at once."""

    def __init__(self, path: Path, member: zipfile.ZipInfo | None, nodes: int, block_rows: int) -> None:
        self._path, self._member, self._nodes, self._block_rows = path, member, nodes, block_rows
        self._is_checked = member is None

    def read(self, row: int, _: int) -> NDArray[Any]:
        """Heights (block_rows, nodes), of the last block what is left."""
        first = row * self._block_rows
        count = min(self._block_rows, self._nodes - first)
        try:
            content = self._part(2 * self._nodes * first, 2 * self._nodes * count)
            return np.frombuffer(content, ">i2").reshape(count, self._nodes)
        except _BROKEN as error:
            raise DemError(f"{self._path}: its heights can't be read: {error}") from error

    def _part(self, start: int, count: int) -> bytes:
        if self._member is None:
            with self._path.open("rb") as file:
                file.seek(start)
                return file.read(count)
        with zipfile.ZipFile(self._path) as archive:
            if not self._is_checked:
                with archive.open(self._member) as unpacked:
                    while unpacked.read(_CHUNK_BYTES):
                        pass
                self._is_checked = True
            with archive.open(self._member) as unpacked:
                unpacked.seek(start)
                return unpacked.read(count)


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
