"""Raster tiles of a PMTiles archive, version 3 of its specification: a header, directories, tiles.

A directory's entries are kept as arrays, the last few directories of them, so that a tile costs one or two reads.
"""

import json
import struct
import zlib
from collections import OrderedDict
from pathlib import Path
from typing import BinaryIO, NamedTuple

import numpy as np

from service.common.shown import shown
from service.ground.background.pmtiles_directory import Directory, directory, tile_number
from service.ground.background.tile import IMAGES, MOST_TILE_BYTES, MOST_ZOOM, Tile, Told, is_tile
from service.ground.faults import GroundError

_HEADER = struct.Struct("<7sB 11Q 6B 4i B 2i")
_KINDS = {2: "png", 3: "jpg", 4: "webp"}
_NONE, _GZIP = 1, 2
_MOST_DIRECTORY_BYTES = 4_000_000  # a leaf's that writers make has 100 kB
_MOST_DIRECTORIES = 16
_MOST_DEPTH = 4  # the specification has a root and one level of leaves


class _Header(NamedTuple):
    root: tuple[int, int]  # offset and length
    metadata: tuple[int, int]
    leaves: int
    tiles: int
    compression: int
    kind: int
    min_zoom: int
    max_zoom: int


class PMTiles:
    """Opens it for reading alone; GroundError where it is none, or holds no images."""

    def __init__(self, path: Path) -> None:
        self._file: BinaryIO = path.open("rb")
        try:
            self._header = header = _header(self._file.read(_HEADER.size))
            self._directories: OrderedDict[int, Directory] = OrderedDict()
            self._directory(*header.root)
            metadata = json.loads(self._unpacked(*header.metadata) or b"{}")
        except (ValueError, OSError, zlib.error, RecursionError) as error:
            self._file.close()
            raise GroundError(f"--tiles {path}: is no PMTiles archive of images: {shown(error)}") from error
        named = metadata.get("attribution", "") if isinstance(metadata, dict) else ""
        self._kind = IMAGES[_KINDS[header.kind]]
        self.told = Told(
            min_zoom=min(header.min_zoom, MOST_ZOOM),
            max_zoom=min(header.max_zoom, MOST_ZOOM),
            attribution=shown(named, most=200),
        )

    def tile(self, zoom: int, x: int, y: int) -> Tile | None:
        """One image, rows counted from the north; None where there is none, or the archive is broken there."""
        if not is_tile(zoom, x, y):
            return None
        try:
            image = self._found(tile_number(zoom, x, y))
        except (ValueError, OSError, zlib.error):
            return None
        return None if image is None else Tile(image, self._kind)

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    def _found(self, number: int) -> bytes | None:
        offset, length = self._header.root
        for _ in range(_MOST_DEPTH):
            one = self._directory(offset, length)
            at = int(np.searchsorted(one.first, number, side="right")) - 1
            if at < 0:
                return None
            offset, length = int(one.offset[at]), int(one.length[at])
            if one.run[at] > 0:
                is_in_run = number - one.first[at] < one.run[at] and length <= MOST_TILE_BYTES
                return self._bytes(self._header.tiles + offset, length) if is_in_run else None
            offset += self._header.leaves
        return None

    def _directory(self, offset: int, length: int) -> Directory:
        found = self._directories.get(offset)
        if found is None:
            found = self._directories[offset] = directory(self._unpacked(offset, length))
            if len(self._directories) > _MOST_DIRECTORIES:
                self._directories.popitem(last=False)
        self._directories.move_to_end(offset)
        return found

    def _unpacked(self, offset: int, length: int) -> bytes:
        if length > _MOST_DIRECTORY_BYTES:
            raise ValueError(f"a directory of {length} bytes")
        packed = self._bytes(offset, length)
        if self._header.compression == _NONE or not packed:
            return packed
        gzip = zlib.decompressobj(16 + zlib.MAX_WBITS)
        out = gzip.decompress(packed, _MOST_DIRECTORY_BYTES)
        if gzip.unconsumed_tail:
            raise ValueError(f"a directory of over {_MOST_DIRECTORY_BYTES} bytes")
        return out

    def _bytes(self, offset: int, length: int) -> bytes:
        self._file.seek(offset)
        data = self._file.read(length)
        if len(data) != length:
            raise ValueError("it is cut off")
        return data


def _header(data: bytes) -> _Header:
    if len(data) < _HEADER.size or not data.startswith(b"PMTiles"):
        raise ValueError("it does not begin as one")
    _, version, *rest = _HEADER.unpack(data)
    if version != 3:
        raise ValueError(f"version {version}: version 3 is read")
    offsets, (_, packing, tile_packing, kind, low, high) = rest[:11], rest[11:17]
    if kind not in _KINDS:
        raise ValueError(
            f"tiles of type {kind}{' (vector)' if kind == 1 else ''}: {', '.join(_KINDS.values())} are shown"
        )
    if packing not in (_NONE, _GZIP) or tile_packing not in (0, _NONE):
        raise ValueError(
            f"compressed as {packing} and {tile_packing}: directories in gzip (2) and plain tiles (1) are read"
        )
    if max(offsets) > 1 << 62:
        raise ValueError("an offset beyond all files")
    return _Header(
        root=(offsets[0], offsets[1]),
        metadata=(offsets[2], offsets[3]),
        leaves=offsets[4],
        tiles=offsets[6],
        compression=packing,
        kind=kind,
        min_zoom=low,
        max_zoom=high,
    )
