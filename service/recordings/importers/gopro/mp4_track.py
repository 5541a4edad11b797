"""MP4 (ISO/IEC 14496-12) as far as GoPro's telemetry needs it: where its track's samples lie, and when they begin.

Boxes are read one by one from the file; only the tables of one track are held. Sizes are checked against the file's
before anything is read or made, so that a length that lies costs nothing.
"""

import struct
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray

from service.recordings.importers.flight import ImportRefusedError

FORMAT = b"gpmd"
MOST_TABLE_BYTES = 64_000_000
MOST_SAMPLES = 200_000  # 2 days at one a second
MOST_SAMPLE_BYTES = 16_000_000
MOST_BYTES = 2_000_000_000  # of telemetry in all
_MOST_BOXES = 10_000
_MOST_TRACKS = 64
_MOST_TIME_SCALE = 1_000_000_000


@dataclass(frozen=True)
class Track:
    """Samples of telemetry: `offsets` and `sizes` (n,) in bytes, `times_s` (n + 1,) when each begins, and the end."""

    offsets: NDArray[np.int64]
    sizes: NDArray[np.int64]
    times_s: NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class _Box:
    kind: bytes
    start: int  # of its content
    end: int


def has_telemetry(path: Path) -> bool:
    """Whether a file is an MP4 with a track of GPMF; False for whatever else."""
    try:
        with path.open("rb") as file:
            return _telemetry(file, _end(file)) is not None
    except (OSError, ImportRefusedError, _BrokenError):
        return False


def read_track(path: Path) -> Track:
    """The track of GPMF; ImportRefusedError where there is none, or its tables are broken."""
    with path.open("rb") as file:
        end = _end(file)
        try:
            found = _telemetry(file, end)
            if found is None:
                raise ImportRefusedError(f"{path}: has no track of GPMF: a film as a GoPro writes it is wanted")
            return _track(file, found, end)
        except _BrokenError as error:
            raise ImportRefusedError(f"{path}: its track of telemetry is broken: {error}") from error


def payloads(path: Path, track: Track) -> Iterator[bytes]:
    """The samples' bytes, one at a time; one beyond the end of a file that was cut is empty."""
    with path.open("rb") as file:
        for offset, size in zip(track.offsets.tolist(), track.sizes.tolist(), strict=True):
            file.seek(offset)
            data = file.read(size)
            yield data if len(data) == size else b""


class _BrokenError(Exception):
    """What of a box is not as it must be."""


def _end(file: BinaryIO) -> int:
    return file.seek(0, 2)


def _telemetry(file: BinaryIO, end: int) -> tuple[_Box, int] | None:
    """The sample table of the first GPMF track, and its time scale."""
    movie = _first(file, 0, end, b"moov")
    if movie is None:
        return None
    tracks = [one for one in _boxes(file, movie.start, movie.end) if one.kind == b"trak"]
    for track in tracks[:_MOST_TRACKS]:
        media = _first(file, track.start, track.end, b"mdia")
        info = media and _first(file, media.start, media.end, b"minf")
        table = info and _first(file, info.start, info.end, b"stbl")
        header = media and _first(file, media.start, media.end, b"mdhd")
        if table is None or header is None:
            continue
        described = _first(file, table.start, table.end, b"stsd")
        if described is not None and _content(file, described, 16)[12:16] == FORMAT:
            return table, _time_scale(_content(file, header, 24))
    return None


def _boxes(file: BinaryIO, start: int, end: int) -> Iterator[_Box]:
    at = start
    for _ in range(_MOST_BOXES):
        if at + 8 > end:
            return
        file.seek(at)
        head = file.read(16)
        size, kind = struct.unpack_from(">I4s", head)
        content = at + 8
        if size == 1:
            if len(head) < 16:
                return
            size, content = int.from_bytes(head[8:16], "big"), at + 16
        elif size == 0:
            size = end - at
        if size < content - at or at + size > end:
            if kind == b"moov":
                raise _BrokenError(f"the box 'moov' says {size} bytes, more than the file has: is it cut off?")
            return
        yield _Box(kind, content, at + size)
        at += size


def _first(file: BinaryIO, start: int, end: int, kind: bytes) -> _Box | None:
    return next((one for one in _boxes(file, start, end) if one.kind == kind), None)


def _content(file: BinaryIO, box: _Box, most: int = MOST_TABLE_BYTES) -> bytes:
    file.seek(box.start)
    return file.read(min(box.end - box.start, most))


def _time_scale(header: bytes) -> int:
    at = 20 if header[:1] == b"\x01" else 12
    scale = int.from_bytes(header[at : at + 4], "big")
    if not 0 < scale <= _MOST_TIME_SCALE:
        raise _BrokenError(f"a time scale of {scale}")
    return scale


def _track(file: BinaryIO, found: tuple[_Box, int], end: int) -> Track:
    table, scale = found
    inner = {one.kind: one for one in _boxes(file, table.start, table.end)}
    sizes = _sizes(file, inner)
    offsets = _offsets(_chunks(file, inner), _runs(file, inner), sizes)
    durations = _durations(file, inner, len(sizes))
    is_in = (offsets >= 0) & (offsets + sizes <= end)
    sizes = np.where(is_in, sizes, 0)  # of a file that was cut
    if int(sizes.sum()) > MOST_BYTES:
        raise _BrokenError(f"more than {MOST_BYTES} bytes of telemetry")
    times_s = np.concatenate([[0.0], np.cumsum(durations)]) / scale
    return Track(np.where(is_in, offsets, 0), sizes, times_s)


def _numbers(
    file: BinaryIO, inner: dict[bytes, _Box], kind: bytes, columns: int, dtype: str = ">u4"
) -> NDArray[np.int64]:
    """(n, columns) of a full box that has a count before its rows."""
    box = inner.get(kind)
    if box is None:
        raise _BrokenError(f"no box '{kind.decode()}'")
    data = _content(file, box)
    count = int.from_bytes(data[4:8], "big")
    row = columns * np.dtype(dtype).itemsize
    if count > MOST_SAMPLES or 8 + count * row > len(data):
        raise _BrokenError(f"the box '{kind.decode()}' says {count} rows, more than it has")
    return np.frombuffer(data, dtype=dtype, count=count * columns, offset=8).astype(np.int64).reshape(count, columns)


def _sizes(file: BinaryIO, inner: dict[bytes, _Box]) -> NDArray[np.int64]:
    box = inner.get(b"stsz")
    if box is None:
        raise _BrokenError("no box 'stsz'")
    data = _content(file, box)
    if len(data) < 12:
        raise _BrokenError("the box 'stsz' is cut off")
    common, count = struct.unpack_from(">II", data, 4)
    if not 0 < count <= MOST_SAMPLES or (not common and 12 + 4 * count > len(data)):
        raise _BrokenError(f"the box 'stsz' says {count} samples")
    sizes = (
        np.full(count, common, dtype=np.int64)
        if common
        else np.frombuffer(data, dtype=">u4", count=count, offset=12).astype(np.int64)
    )
    if sizes.max() > MOST_SAMPLE_BYTES:
        raise _BrokenError(f"a sample of {sizes.max()} bytes")
    return sizes


def _chunks(file: BinaryIO, inner: dict[bytes, _Box]) -> NDArray[np.int64]:
    if b"co64" in inner:
        return _numbers(file, inner, b"co64", 1, ">i8")[:, 0]
    return _numbers(file, inner, b"stco", 1)[:, 0]


def _runs(file: BinaryIO, inner: dict[bytes, _Box]) -> NDArray[np.int64]:
    """(k, 2) first chunk (from 0) and samples in each chunk from there."""
    runs = _numbers(file, inner, b"stsc", 3)[:, :2]
    if not len(runs) or runs[0, 0] != 1 or (np.diff(runs[:, 0]) <= 0).any() or (runs[:, 1] <= 0).any():
        raise _BrokenError("the box 'stsc' does not say how many samples each chunk has")
    return np.column_stack([runs[:, 0] - 1, runs[:, 1]])


def _offsets(chunks: NDArray[np.int64], runs: NDArray[np.int64], sizes: NDArray[np.int64]) -> NDArray[np.int64]:
    """Where each sample begins: a chunk's lie one behind the other."""
    counts = runs[np.searchsorted(runs[:, 0], np.arange(len(chunks)), side="right") - 1, 1]
    if not len(chunks) or int(counts.sum()) < len(sizes):
        raise _BrokenError(f"its {len(chunks)} chunks hold fewer samples than the {len(sizes)} that it says")
    ends = np.cumsum(counts)
    of_chunk = np.searchsorted(ends, np.arange(len(sizes)), side="right")
    before = np.concatenate([[0], np.cumsum(sizes)])
    first = np.minimum(ends[of_chunk] - counts[of_chunk], len(sizes))
    return np.asarray(chunks[of_chunk] + before[:-1] - before[first])


def _durations(file: BinaryIO, inner: dict[bytes, _Box], count: int) -> NDArray[np.int64]:
    rows = _numbers(file, inner, b"stts", 2)
    if not len(rows) or int(np.minimum(rows[:, 0], count).sum()) < count:
        raise _BrokenError("the box 'stts' has times for fewer samples")
    rows = rows[np.concatenate([[0], np.cumsum(np.minimum(rows[:, 0], count))[:-1]]) < count]
    return np.repeat(rows[:, 1], np.minimum(rows[:, 0], count))[:count]
