"""What an image's bytes say of it beside its size: which way up it is, and why it is no single whole picture.

`files.py` asks, before it decodes.
"""

import struct
from collections.abc import Mapping
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from service.common.image_size import (
    BMP,
    JPEG,
    JPEG_FRAMES,
    PNG,
    TIFF,
    TIFF_HEIGHT,
    TIFF_WIDTH,
    jpeg_segments,
    png_chunks,
    tiff_directories,
)

UPRIGHT = 1

Level = TypeVar("Level", bound=np.generic)

_TURNS_SIDEWAYS = 5  # this EXIF orientation and those above it change width and height
_ORIENTATION, _PHOTOMETRIC, _CMYK = 274, 262, 5
_SUBFILE, _IS_SMALL_COPY, _DNG_VERSION = 254, 1, 50706
_PLACES = ((273, 279), (324, 325))  # tags of where strips and tiles begin, and of their bytes
_PLAIN_BMP = (0, 3)  # without compression
_EXIF = b"Exif\0\0"
_CUT = "is cut short: copy it anew"
_IN_CMYK = "has the four colours of print (CMYK): save it as RGB"


def orientation_of(data: bytes) -> int:
    """The EXIF orientation, 1 to 8; 1, upright, where nothing valid is said."""
    try:
        if data.startswith(JPEG):
            found = next(
                (data[at + 4 : at + 65_540] for marker, at in jpeg_segments(data) if _is_exif(data, marker, at))
            )
            tags = _first_tags(found[len(_EXIF) :])
        elif data.startswith(PNG):
            tags = _first_tags(next(content for kind, content in png_chunks(data) if kind == b"eXIf"))
        else:
            tags = _first_tags(data)
    except (StopIteration, struct.error):
        return UPRIGHT
    said = next(iter(tags.get(_ORIENTATION, ())), UPRIGHT)
    return said if UPRIGHT <= said <= 8 else UPRIGHT


def fault_of(data: bytes) -> str:
    """Why it is no single whole picture in grey or RGB, and what would be; empty: nothing speaks against it."""
    try:
        if data.startswith(JPEG):
            return _jpeg_fault(data)
        if data.startswith(PNG):
            return _png_fault(data)
        if data.startswith(BMP):
            return _bmp_fault(data)
        return _tiff_fault(data) if data[:4] in TIFF else ""
    except struct.error:
        return _CUT


def turned(image: NDArray[Level], orientation: int) -> NDArray[Level]:
    """An image (H, W, ...) as it lies by an EXIF orientation (EXIF 2.3, tag 274)."""
    if orientation >= _TURNS_SIDEWAYS:
        image = image.swapaxes(0, 1)
    rows = -1 if orientation in (3, 4, 7, 8) else 1
    columns = -1 if orientation in (2, 3, 6, 7) else 1
    return np.ascontiguousarray(image[::rows, ::columns])


def _is_exif(data: bytes, marker: int, at: int) -> bool:
    return marker == 0xE1 and data[at + 4 : at + 4 + len(_EXIF)] == _EXIF


def _first_tags(data: bytes) -> Mapping[int, tuple[int, ...]]:
    return next(tiff_directories(data), {}) if data[:4] in TIFF else {}


def _jpeg_fault(data: bytes) -> str:
    begins = len(data)
    for marker, at in jpeg_segments(data):
        if marker in JPEG_FRAMES and data[at + 9 : at + 10] == b"\x04":
            return _IN_CMYK
        if marker == 0xDA:
            begins = at
    return "" if data.find(b"\xff\xd9", begins) >= 0 else _CUT  # in the picture's data 0xFF stands before 0 alone


def _png_fault(data: bytes) -> str:
    is_whole = False
    for kind, content in png_chunks(data):
        if kind == b"acTL" and struct.unpack_from(">I", content)[0] > 1:
            return _several(str(struct.unpack_from(">I", content)[0]))
        is_whole = kind == b"IEND"
        if is_whole:
            break
    return "" if is_whole else _CUT


def _bmp_fault(data: bytes) -> str:
    (offset,) = struct.unpack_from("<I", data, 10)
    width, height, _, bits, compression = struct.unpack_from("<iiHHI", data, 18)
    row = (abs(width) * bits + 31) // 32 * 4
    return _CUT if compression in _PLAIN_BMP and offset + row * abs(height) > len(data) else ""


def _tiff_fault(data: bytes) -> str:
    first, *others = tiff_directories(data)
    if first.get(_PHOTOMETRIC) == (_CMYK,):
        return _IN_CMYK
    if _DNG_VERSION in first or next(iter(first.get(_SUBFILE, ())), 0) & _IS_SMALL_COPY:
        return "begins with a small copy of its picture, as raw ones do: develop it to JPEG or PNG"
    size = [first.get(side) for side in (TIFF_WIDTH, TIFF_HEIGHT)]
    if any([other.get(side) for side in (TIFF_WIDTH, TIFF_HEIGHT)] == size for other in others):  # else a small copy
        return _several("several")
    for places, counts in _PLACES:
        ends = [at + count for at, count in zip(first.get(places, ()), first.get(counts, ()), strict=False)]
        if max(ends, default=0) > len(data):
            return _CUT
    return ""


def _several(count: str) -> str:
    return f"holds {count} pictures: give each a file of its own"
