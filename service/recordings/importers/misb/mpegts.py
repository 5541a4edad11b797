"""MPEG-TS (ISO/IEC 13818-1) as far as metadata needs it: KLV with its times, and the pictures' times.

The whole file is read once, in blocks; what it may hold of it is bounded. What is cut, scrambled or lost is passed over
and counted. The pictures themselves are OpenCV's.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import BinaryIO

from service.recordings.importers.flight import ImportRefusedError
from service.recordings.importers.misb.pes import cells, crc_is_zero, header_of, kind_of, told_size

PTS_HZ = 90_000
MOST_PES_BYTES = 131_072  # metadata; a packet of ST 0601 has some hundreds
MOST_UNITS = 1_000_000  # 9 hours at 30 Hz
SYNC, PACKET = 0x47, 188
_STRIDES = (188, 192, 204)  # plain, with a time code before each (M2TS), with error correction after it
_LOOKED_AT = 8 * 204
_BLOCK_PACKETS = 4096
_MOST_PIDS = 64
_PTS_WRAP = 2**33
_PAT_PID = 0


@dataclass(frozen=True, slots=True)
class Unit:
    """Metadata of one PES packet; `pts_s` None where it has none, `video_pts_s` that of the picture before it."""

    data: bytes
    pts_s: float | None
    video_pts_s: float | None


@dataclass(slots=True)
class Contents:
    """Of one program: `is_sync` where its metadata is bound to the pictures' times (stream type 0x15)."""

    units: list[Unit] = field(default_factory=list)
    picture_pts_s: list[float] = field(default_factory=list)
    is_sync: bool = False
    lost: int = 0


@dataclass(slots=True)
class _Stream:
    kind: str  # "video", "async", "sync"
    counter: int = -1
    data: bytearray = field(default_factory=bytearray)
    is_open: bool = False
    last_pts: int | None = None  # unwrapped


def stride_of(head: bytes) -> tuple[int, int] | None:
    """Bytes from packet to packet, and where the first begins; None for what is no transport stream."""
    for stride in _STRIDES:
        for start in range(min(stride, len(head))):
            if len(head) > start + 4 * stride and all(head[start + i * stride] == SYNC for i in range(5)):
                return stride, start
    return None


def has_klv(head: bytes) -> bool:
    """Whether a file's first bytes declare a stream of KLV."""
    found = stride_of(head[: _LOOKED_AT + 4 * 204])
    if found is None:
        return False
    demuxer = _Demuxer()
    for packet in _cut(head, *found):
        demuxer.take(packet)
    return any(one.kind != "video" for one in demuxer.streams.values())


def read_contents(path: Path) -> Contents:
    """All metadata and times of a file; ImportRefusedError where it is no transport stream or holds too much."""
    with path.open("rb") as file:
        found = stride_of(file.read(_LOOKED_AT + 4 * 204))
        if found is None:
            raise ImportRefusedError(
                f"{path}: is no MPEG-TS: packets of {PACKET} bytes that begin with 0x47 are wanted"
            )
        demuxer = _Demuxer()
        file.seek(found[1])
        for block in _blocks(file, found[0]):
            for packet in _cut(block, found[0], 0):
                demuxer.take(packet)
            if len(demuxer.contents.units) > MOST_UNITS or len(demuxer.contents.picture_pts_s) > MOST_UNITS:
                raise ImportRefusedError(f"{path}: more than {MOST_UNITS} pictures or metadata packets: cut it")
    demuxer.finish()
    return demuxer.contents


def _blocks(file: BinaryIO, stride: int) -> Iterator[bytes]:
    """Runs of packets that begin in step; where the step is lost, from the next that is found."""
    rest = b""
    while chunk := file.read(_BLOCK_PACKETS * stride):
        data = rest + chunk
        while len(data) > 5 * stride:
            if data[0] != SYNC or data[stride] != SYNC:
                start = _next_step(data, stride)
                data = data[start:]
                continue
            count = _in_step(data, stride)
            yield data[: count * stride]
            data = data[count * stride :]
        rest = data
    if len(rest) >= PACKET and rest[0] == SYNC:
        yield rest


def _next_step(data: bytes, stride: int) -> int:
    at = data.find(SYNC, 1)
    while 0 <= at < len(data) - stride:
        if data[at + stride] == SYNC:
            return at
        at = data.find(SYNC, at + 1)
    return len(data) - stride  # less than a packet is kept for the next block


def _in_step(data: bytes, stride: int) -> int:
    starts = data[::stride]
    whole = len(data) // stride
    out = len(starts[:whole]) - len(starts[:whole].lstrip(bytes((SYNC,))))
    return max(1, out)


def _cut(data: bytes, stride: int, start: int) -> Iterator[bytes]:
    for at in range(start, len(data) - PACKET + 1, stride):
        yield data[at : at + PACKET]


class _Demuxer:
    """Packets in; the first program that has metadata, or the first, is followed."""

    def __init__(self) -> None:
        self.contents = Contents()
        self.streams: dict[int, _Stream] = {}
        self._map_pids: set[int] = set()
        self._video_pts_s: float | None = None

    def take(self, packet: bytes) -> None:
        if packet[0] != SYNC or packet[1] & 0x80:  # its sender says that it is damaged
            self.contents.lost += packet[0] == SYNC
            return
        pid = (packet[1] & 0x1F) << 8 | packet[2]
        is_start, scrambled, control, counter = (
            bool(packet[1] & 0x40),
            packet[3] & 0xC0,
            packet[3] >> 4 & 3,
            packet[3] & 15,
        )
        if not control & 1 or scrambled:
            return
        start = 4 + (1 + packet[4] if control & 2 else 0)
        payload = packet[start:]
        if pid == _PAT_PID or pid in self._map_pids:
            if is_start:
                self._take_table(pid, payload)
        elif pid in self.streams:
            self._take_payload(self.streams[pid], payload, is_start, counter)

    def finish(self) -> None:
        """Close what has no successor."""
        for stream in self.streams.values():
            self._close(stream)

    def _take_table(self, pid: int, payload: bytes) -> None:
        """One section that fits its packet, as PAT and PMT of such films do."""
        section = payload[1 + payload[0] :] if payload else b""
        if len(section) < 12:
            return
        end = 3 + ((section[1] & 0x0F) << 8 | section[2]) - 4  # before the CRC
        if end > len(section) - 4 or not crc_is_zero(section[: end + 4]):
            self.contents.lost += 1
            return
        if pid == _PAT_PID and section[0] == 0x00:
            for at in range(8, end - 3, 4):
                if int.from_bytes(section[at : at + 2], "big") and len(self._map_pids) < _MOST_PIDS:
                    self._map_pids.add((section[at + 2] & 0x1F) << 8 | section[at + 3])
        elif pid != _PAT_PID and section[0] == 0x02:
            self._take_map(section, end)

    def _take_map(self, section: bytes, end: int) -> None:
        at = 12 + ((section[10] & 0x0F) << 8 | section[11])
        while at + 5 <= end and len(self.streams) < _MOST_PIDS:
            kind, pid = section[at], (section[at + 1] & 0x1F) << 8 | section[at + 2]
            size = (section[at + 3] & 0x0F) << 8 | section[at + 4]
            descriptors = section[at + 5 : min(at + 5 + size, end)]
            at += 5 + size
            name = kind_of(kind, descriptors)
            if name and pid not in self.streams and not (name == "video" and self._has("video")):
                self.streams[pid] = _Stream(name)
                self.contents.is_sync |= name == "sync"

    def _has(self, kind: str) -> bool:
        return any(one.kind == kind for one in self.streams.values())

    def _take_payload(self, stream: _Stream, payload: bytes, is_start: bool, counter: int) -> None:
        is_next = stream.counter < 0 or counter == (stream.counter + 1) & 15
        if counter == stream.counter and not is_start:
            return  # sent twice, as is allowed
        stream.counter = counter
        if not is_next and stream.is_open and stream.kind != "video":
            self._drop(stream)
        if is_start:
            self._close(stream)
            stream.data[:], stream.is_open = payload, True
            if stream.kind == "video":
                self._take_picture(stream)
        elif stream.is_open:
            if len(stream.data) + len(payload) > MOST_PES_BYTES:
                self._drop(stream)
                return
            stream.data += payload
        if stream.is_open and 0 < told_size(stream.data) <= len(stream.data):
            self._close(stream)

    def _drop(self, stream: _Stream) -> None:
        stream.is_open = False
        stream.data.clear()
        self.contents.lost += 1

    def _take_picture(self, stream: _Stream) -> None:
        header = header_of(stream.data)
        stream.is_open = False
        if header is not None and header[1] is not None:
            self._video_pts_s = _unwrapped(stream, header[1]) / PTS_HZ
            self.contents.picture_pts_s.append(self._video_pts_s)

    def _close(self, stream: _Stream) -> None:
        """The metadata of a PES packet that is over."""
        if not stream.is_open:
            return
        stream.is_open = False
        header = header_of(stream.data)
        if header is None:
            self.contents.lost += 1
            return
        start, pts = header
        size = told_size(stream.data)
        data = bytes(stream.data[start : size or None])
        pts_s = None if pts is None else _unwrapped(stream, pts) / PTS_HZ
        for unit in cells(data) if stream.kind == "sync" else [data]:
            self.contents.units.append(Unit(unit, pts_s, self._video_pts_s))


def _unwrapped(stream: _Stream, pts: int) -> int:
    """On from the stream's last one: 33 bits are over after 26.5 hours."""
    if stream.last_pts is not None:
        step = (pts - stream.last_pts + _PTS_WRAP // 2) % _PTS_WRAP - _PTS_WRAP // 2
        pts = stream.last_pts + step
    stream.last_pts = pts
    return pts
