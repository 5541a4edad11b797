"""The whole records of a damaged DataFlash log: others' indexers stop at the first record that they do not know.

Records are a3 95, a byte of type, and as many bytes as the type's own FMT says (ArduPilot's LogStructure).
"""

import mmap
from pathlib import Path
from typing import BinaryIO

HEAD = b"\xa3\x95"
_FMT, _FMT_BYTES = 0x80, 89
_LEAST_BYTES = 4
_PIECE = 1 << 20


def undamaged_copy(path: Path, copy: Path) -> int:
    """Write the records of `path` that are whole to `copy`; how many places were skipped between them."""
    places, start = 0, 0
    with path.open("rb") as file, copy.open("xb") as out, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as data:
        lengths = {_FMT: _FMT_BYTES}
        at = 0
        while at + 3 <= len(data):
            length = lengths.get(data[at + 2], 0) if data[at : at + 2] == HEAD else 0
            if length and at + length <= len(data):
                if data[at + 2] == _FMT and data[at + 4] >= _LEAST_BYTES:
                    lengths.setdefault(data[at + 3], data[at + 4])
                at += length
                continue
            _put(data, start, at, out)
            start = at = _next(data, at + 1, lengths)
            places += at < len(data)
        _put(data, start, min(at, len(data)), out)
    return places


def _put(data: mmap.mmap, start: int, end: int, out: BinaryIO) -> None:
    for first in range(start, end, _PIECE):
        out.write(data[first : min(end, first + _PIECE)])


def _next(data: mmap.mmap, at: int, lengths: dict[int, int]) -> int:
    """Where a record begins behind which another one does, or the log ends; its length where there is none."""
    while (at := data.find(HEAD, at)) >= 0:
        length = lengths.get(data[at + 2], 0) if at + 2 < len(data) else 0
        after = at + length
        if length and (data[after : after + 2] == HEAD or after == len(data)):
            return at
        at += 1
    return len(data)
