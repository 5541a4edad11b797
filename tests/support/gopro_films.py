"""Films with a track of GPMF as a GoPro's, packed here by the format's public description; OpenCV makes the film."""

import struct
from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray


def element(key: str, kind: str, rows: Sequence[Sequence[float]] | Sequence[bytes], code: str = "") -> bytes:
    """One element: `rows` of numbers by the struct's `code` for one row, or of bytes; padded to 4."""
    packed = [row if isinstance(row, bytes) else struct.pack(">" + code, *row) for row in rows]
    data = b"".join(packed)
    size = len(packed[0]) if packed else struct.calcsize(">" + code)
    return struct.pack(">4sBBH", key.encode(), ord(kind), size, len(packed)) + data + bytes(-len(data) % 4)


def text(key: str, value: str) -> bytes:
    raw = value.encode("latin-1")
    return struct.pack(">4sBBH", key.encode(), ord("c"), 1, len(raw)) + raw + bytes(-len(raw) % 4)


def nested(key: str, *parts: bytes) -> bytes:
    data = b"".join(parts)
    return struct.pack(">4sBBH", key.encode(), 0, 4, len(data) // 4) + data


def stream(key: str, values: NDArray[np.float64], scale: float, *notes: bytes, code: str = "h") -> bytes:
    """A STRM of whole numbers with one SCAL for all columns."""
    whole = np.round(values * scale).astype(np.int64)
    kind = {"h": "s", "i": "l", "H": "S"}[code]
    data = element(key, kind, [tuple(int(one) for one in row) for row in whole], code * values.shape[1])
    return nested("STRM", *notes, element("SCAL", "l", [(round(scale),)], "i"), data)


def device(name: str, *streams: bytes, number: int = 1) -> bytes:
    return nested("DEVC", element("DVID", "L", [(number,)], "I"), text("DVNM", name), *streams)


def write_film(path: Path, pictures: Sequence[NDArray[np.uint8]], payloads: Sequence[bytes], fps: float = 25.0) -> None:
    """The film, with one payload a second in a track beside it."""
    height, width = pictures[0].shape[:2]
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*"mp4v"), fps, (width, height))
    for picture in pictures:
        writer.write(picture)
    writer.release()
    data = path.read_bytes()
    at, movie = _top(data, b"moov")
    assert at + len(movie) == len(data), "the film's index is expected at its end"
    shift = len(_track(payloads, 0))
    start = len(data) + shift + 8
    track = _track(payloads, start)
    movie = _box(b"moov", movie[8:] + track)
    path.write_bytes(data[:at] + movie + _box(b"mdat", b"".join(payloads)))


def _top(data: bytes, kind: bytes) -> tuple[int, bytes]:
    at = 0
    while at < len(data):
        size = int.from_bytes(data[at : at + 4], "big")
        if data[at + 4 : at + 8] == kind:
            return at, data[at : at + size]
        at += size
    raise AssertionError(f"no {kind!r}")


def _box(kind: bytes, *parts: bytes) -> bytes:
    data = b"".join(parts)
    return struct.pack(">I4s", 8 + len(data), kind) + data


def _track(payloads: Sequence[bytes], start: int) -> bytes:
    """A 'meta' track of 'gpmd', one second a sample, each a chunk of its own."""
    starts = start + np.concatenate([[0], np.cumsum([len(one) for one in payloads])[:-1]])
    n = len(payloads)
    table = _box(
        b"stbl",
        _box(b"stsd", struct.pack(">II", 0, 1), _box(b"gpmd", bytes(6), struct.pack(">H", 1))),
        _box(b"stts", struct.pack(">IIII", 0, 1, n, 1000)),
        _box(b"stsc", struct.pack(">IIIII", 0, 1, 1, 1, 1)),
        _box(b"stsz", struct.pack(">III", 0, 0, n), *(struct.pack(">I", len(one)) for one in payloads)),
        _box(b"stco", struct.pack(">II", 0, n), *(struct.pack(">I", int(one)) for one in starts)),
    )
    media = _box(
        b"mdia",
        _box(b"mdhd", struct.pack(">IIIIIHH", 0, 0, 0, 1000, 1000 * n, 0, 0)),
        _box(b"hdlr", struct.pack(">I4s4s", 0, b"mhlr", b"meta"), bytes(12), b"\x0bGoPro MET  "),
        _box(b"minf", _box(b"gmhd", _box(b"gpmd", bytes(4))), table),
    )
    header = struct.pack(">IIIIII", 0xF, 0, 0, 9, 0, 1000 * n) + bytes(60)
    return _box(b"trak", _box(b"tkhd", header), media)
