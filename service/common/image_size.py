"""An image's size from its header, before anything is decoded: PNG, JPEG, BMP and TIFF; files.py asks."""

import struct
from collections.abc import Iterator

_PNG, _BMP, _JPEG = b"\x89PNG\r\n\x1a\n", b"BM", b"\xff\xd8"
_TIFF = {b"II*\0": "<", b"MM\0*": ">"}
_JPEG_FRAMES = frozenset(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}  # SOF0 to SOF15 but for DHT, JPG, DAC
_JPEG_ALONE = frozenset(range(0xD0, 0xD8)) | {0x01}  # markers without a length
_TIFF_WIDTH, _TIFF_HEIGHT = 256, 257
_MOST_SEGMENTS = 4096


def size_from_header(data: bytes) -> tuple[int, int] | None:
    """Width and height in pixels; None where it is no image of these kinds or its header is cut."""
    try:
        if data.startswith(_PNG):
            width, height = struct.unpack_from(">II", data, 16)
        elif data.startswith(_JPEG):
            return _jpeg(data)
        elif data.startswith(_BMP):
            width, height = (abs(side) for side in struct.unpack_from("<ii", data, 18))
        elif data[:4] in _TIFF:
            return _tiff(data, _TIFF[data[:4]])
        else:
            return None
    except struct.error:
        return None
    return (width, height) if width and height else None


def _jpeg(data: bytes) -> tuple[int, int] | None:
    """Of the largest frame header before the picture: what a decoder takes is no larger."""
    sizes = [struct.unpack_from(">HH", data, at + 5) for marker, at in _segments(data) if marker in _JPEG_FRAMES]
    width, height = max((size[1] for size in sizes), default=0), max((size[0] for size in sizes), default=0)
    return (width, height) if width and height else None


def _segments(data: bytes) -> Iterator[tuple[int, int]]:
    """Each marker before the picture's data, and where it stands."""
    at = 2
    for _ in range(_MOST_SEGMENTS):
        while data[at : at + 2] == b"\xff\xff":
            at += 1
        if len(data) < at + 4 or data[at] != 0xFF or data[at + 1] == 0xDA:
            return
        yield data[at + 1], at
        at += 2 if data[at + 1] in _JPEG_ALONE else 2 + max(2, int(struct.unpack_from(">H", data, at + 2)[0]))


def _tiff(data: bytes, order: str) -> tuple[int, int] | None:
    """Of the first directory, which is the one that is read."""
    (start,) = struct.unpack_from(order + "I", data, 4)
    (count,) = struct.unpack_from(order + "H", data, start)
    sides: dict[int, int] = {}
    for number in range(count):
        tag, kind = struct.unpack_from(order + "HH", data, start + 2 + 12 * number)
        if tag in (_TIFF_WIDTH, _TIFF_HEIGHT):
            sides[tag] = int(struct.unpack_from(order + ("H" if kind == 3 else "I"), data, start + 10 + 12 * number)[0])
    width, height = sides.get(_TIFF_WIDTH, 0), sides.get(_TIFF_HEIGHT, 0)
    return (width, height) if width and height else None
