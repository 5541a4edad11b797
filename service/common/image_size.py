"""An image's size from its header, before anything is decoded, and the walks over its parts: PNG, JPEG, BMP and TIFF.

`files.py` asks for the size, `image_header.py` walks on.
"""

import struct
from collections.abc import Iterator, Mapping

PNG, BMP, JPEG = b"\x89PNG\r\n\x1a\n", b"BM", b"\xff\xd8"
TIFF = {b"II*\0": "<", b"MM\0*": ">"}
JPEG_FRAMES = frozenset(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}  # SOF0 to SOF15 but for DHT, JPG, DAC
_JPEG_ALONE = frozenset(range(0xD0, 0xD8)) | {0x01}  # markers without a length
TIFF_WIDTH, TIFF_HEIGHT = 256, 257
_TIFF_KINDS = {1: "B", 3: "H", 4: "I"}  # the whole numbers
_MOST_SEGMENTS = 4096
_MOST_CHUNKS = 100_000  # libpng writes 8 kB in each
_MOST_VALUES = 1_000_000  # strips of one row


def size_from_header(data: bytes) -> tuple[int, int] | None:
    """Width and height in pixels; None where it is no image of these kinds or its header is cut."""
    try:
        if data.startswith(PNG):
            width, height = struct.unpack_from(">II", data, 16)
        elif data.startswith(JPEG):
            return _jpeg(data)
        elif data.startswith(BMP):
            width, height = (abs(side) for side in struct.unpack_from("<ii", data, 18))
        elif data[:4] in TIFF:
            tags = next(tiff_directories(data), {})
            width, height = (max(tags.get(side, (0,)), default=0) for side in (TIFF_WIDTH, TIFF_HEIGHT))
        else:
            return None
    except struct.error:
        return None
    return (width, height) if width and height else None


def jpeg_segments(data: bytes) -> Iterator[tuple[int, int]]:
    """Each marker up to the picture's data, that of the data (0xDA) too, and where it stands."""
    at = 2
    for _ in range(_MOST_SEGMENTS):
        while data[at : at + 2] == b"\xff\xff":
            at += 1
        if len(data) < at + 4 or data[at] != 0xFF:
            return
        yield data[at + 1], at
        if data[at + 1] == 0xDA:
            return
        at += 2 if data[at + 1] in _JPEG_ALONE else 2 + max(2, int(struct.unpack_from(">H", data, at + 2)[0]))


def png_chunks(data: bytes) -> Iterator[tuple[bytes, bytes]]:
    """Each whole chunk's kind and its first 64 kB, to the end or where the file is cut."""
    at = len(PNG)
    for _ in range(_MOST_CHUNKS):
        if len(data) < at + 12:
            return
        (length,) = struct.unpack_from(">I", data, at)
        if len(data) < at + 12 + length:
            return
        yield data[at + 4 : at + 8], data[at + 8 : at + 8 + min(length, 65_536)]
        at += 12 + length


def tiff_directories(data: bytes) -> Iterator[Mapping[int, tuple[int, ...]]]:
    """The whole numbers under each tag of the first two pictures; struct.error where the file is cut."""
    order = TIFF[data[:4]]
    (start,) = struct.unpack_from(order + "I", data, 4)
    for _ in range(2):
        (count,) = struct.unpack_from(order + "H", data, start)
        entries = [start + 2 + 12 * number for number in range(count)]
        yield dict(_tiff_entry(data, order, at) for at in entries)
        (start,) = struct.unpack_from(order + "I", data, start + 2 + 12 * count)
        if not start:
            return


def _jpeg(data: bytes) -> tuple[int, int] | None:
    """Of the largest frame header before the picture: what a decoder takes is no larger."""
    sizes = [struct.unpack_from(">HH", data, at + 5) for marker, at in jpeg_segments(data) if marker in JPEG_FRAMES]
    width, height = max((size[1] for size in sizes), default=0), max((size[0] for size in sizes), default=0)
    return (width, height) if width and height else None


def _tiff_entry(data: bytes, order: str, at: int) -> tuple[int, tuple[int, ...]]:
    """A tag and its values; none where they are no whole numbers."""
    tag, kind, count = struct.unpack_from(order + "HHI", data, at)
    letter = _TIFF_KINDS.get(kind, "")
    if not letter or count > _MOST_VALUES:
        return tag, ()
    form = f"{order}{count}{letter}"
    is_inside = struct.calcsize(form) <= 4
    return tag, struct.unpack_from(
        form, data, at + 8 if is_inside else struct.unpack_from(order + "I", data, at + 8)[0]
    )
