"""Finds whole MAVLink frames in a stream of bytes and decodes them; used by the links, the replay and the autopilot.

pymavlink's own parser grows without bound on chunks that never end on a frame and loses frames after junk.
"""

import re
import struct
from bisect import bisect_left
from typing import Any

import numpy as np
from fastcrc import crc16
from numpy.typing import NDArray
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from service.common.messages import MavFrame

MAGIC_V1 = 0xFE
MAGIC_V2 = 0xFD
SIGNATURE_BYTES = 13
LONGEST_FRAME = 10 + 255 + 2 + SIGNATURE_BYTES

# What `check_frame` returns instead of a length.
NOT_A_FRAME = 0
NEED_MORE = -1
BAD_CRC = -2
UNKNOWN_ID = -3

_MAGIC = re.compile(rb"[\xfd\xfe]")
_KNOWN: dict[int, tuple[int, bytes]] = {
    int(number): (int(message.unpacker.size), bytes([message.crc_extra]))
    for number, message in mavlink.mavlink_map.items()
}
_FULL_BYTES = np.full(1 << 16, -1, dtype=np.int16)  # by id: the longest payload; no known id is above
_FULL_BYTES[list(_KNOWN)] = [full for full, _ in _KNOWN.values()]
_FEW_BYTES = 1_024  # up to which it is not worth while to look for all headers at once


def next_magic(buffer: bytes, at: int) -> int:
    """Where the next byte that may start a frame is, at or after `at`; the buffer's length if there is none."""
    found = _MAGIC.search(buffer, at)
    return found.start() if found else len(buffer)


def check_frame(buffer: bytes, at: int) -> int:  # noqa: PLR0911 (a ladder of guards)
    """Length of the whole frame with a right CRC at `at`, or one of the codes above (all <= 0)."""
    left = len(buffer) - at
    if left < 1:
        return NEED_MORE
    if buffer[at] == MAGIC_V2:
        header = 10
        if left < header:
            return NOT_A_FRAME if left > 2 and buffer[at + 2] & ~1 else NEED_MORE
        if buffer[at + 2] & ~1:
            return NOT_A_FRAME
        number = buffer[at + 7] | buffer[at + 8] << 8 | buffer[at + 9] << 16
        trailer = SIGNATURE_BYTES if buffer[at + 2] & 1 else 0
    elif buffer[at] == MAGIC_V1:
        header, trailer = 6, 0
        if left < header:
            return NEED_MORE
        number = buffer[at + 5]
    else:
        return NOT_A_FRAME
    known = _KNOWN.get(number)
    if known is None:
        return UNKNOWN_ID
    full, extra = known
    if buffer[at + 1] > full:
        return NOT_A_FRAME
    end = at + header + buffer[at + 1]
    if at + left < end + 2 + trailer:
        return NEED_MORE
    if crc16.mcrf4xx(buffer[at + 1 : end] + extra) != buffer[end] | buffer[end + 1] << 8:
        return BAD_CRC
    return end + 2 + trailer - at


def unchecked_length(buffer: bytes, at: int) -> int:
    """Length that the whole header at `at` gives its frame, where `check_frame` knows no such id."""
    if buffer[at] == MAGIC_V1:
        return 6 + buffer[at + 1] + 2
    return 10 + buffer[at + 1] + 2 + (SIGNATURE_BYTES if buffer[at + 2] & 1 else 0)


def message_id(buffer: bytes, at: int = 0) -> int:
    """The id in the header of the frame that starts at `at`."""
    if buffer[at] == MAGIC_V1:
        return buffer[at + 5]
    return buffer[at + 7] | buffer[at + 8] << 8 | buffer[at + 9] << 16


def with_flags(raw: bytes, flags: int) -> bytes:
    """An unsigned MAVLink 2 frame of a known id with these incompatibility flags, its checksum made anew."""
    body = raw[:2] + bytes([flags]) + raw[3:-2]
    return body + crc16.mcrf4xx(body[1:] + _KNOWN[message_id(raw)][1]).to_bytes(2, "little")


def frame_from_bytes(raw: bytes) -> MavFrame:
    """The frame of bytes that `check_frame` found whole."""
    number = message_id(raw)
    if raw[0] == MAGIC_V1:
        return MavFrame(raw, 1, raw[3], raw[4], raw[2], number, number in _KNOWN)
    return MavFrame(raw, 2, raw[5], raw[6], raw[4], number, number in _KNOWN)


def _is_promising(code: int) -> bool:
    return code > 0 or code == NEED_MORE


class _Headers:
    """Where in a buffer a frame may start: in a long one only where a header, seen as a whole, makes sense."""

    def __init__(self, buffer: bytes) -> None:
        self._buffer = buffer
        self._places: list[int] | None = None
        self._known: list[int] = []  # those of them with an id that we know
        self._promising = -1

    def next(self, at: int) -> int:
        """The first place at or after `at`; the buffer's length if there is none."""
        if self._is_short(at):
            return next_magic(self._buffer, at)
        return _first(self._places or [], at, len(self._buffer))

    def next_promising(self, at: int) -> int:
        """The first place at or after `at` where a checked frame starts or may yet; asked with rising `at`."""
        while self._promising < at:
            place = self._next_known(at)
            while place < len(self._buffer) and not _is_promising(check_frame(self._buffer, place)):
                place = self._next_known(place + 1)
            self._promising = place
        return self._promising

    def _next_known(self, at: int) -> int:
        return next_magic(self._buffer, at) if self._is_short(at) else _first(self._known, at, len(self._buffer))

    def _is_short(self, at: int) -> bool:
        if self._places is None and len(self._buffer) - at > _FEW_BYTES:
            self._places, self._known = _header_places(self._buffer)
        return self._places is None


def _first(places: list[int], at: int, end: int) -> int:
    index = bisect_left(places, at)
    return places[index] if index < len(places) else end


class Framer:
    """Cuts a stream into frames; keeps less than one frame between calls.

    Only frames whose id is in `wanted` are returned (None: all); the others are counted all the same. One of an unknown
    id is taken at its header's word where the next frame or nothing follows it and no checked frame starts within.
    """

    def __init__(self, wanted: frozenset[int] | None = None) -> None:
        self.frames = 0
        self.bad_bytes = 0
        self.bad_crc = 0
        self.unknown_ids = 0
        self._wanted = wanted
        self._rest = b""

    def feed(self, data: bytes) -> list[MavFrame]:
        """The whole frames that these bytes complete, in order."""
        buffer = self._rest + data
        headers = _Headers(buffer)
        found: list[MavFrame] = []
        at = 0
        while at < len(buffer):
            length = check_frame(buffer, at)
            is_known = length != UNKNOWN_ID
            if not is_known:
                length = _unknown_frame(buffer, at, headers)
            if length == NEED_MORE:
                break
            if length <= 0:
                self.bad_crc += length == BAD_CRC
                skipped_from, at = at, headers.next(at + 1)
                self.bad_bytes += at - skipped_from
                continue
            self.frames += is_known
            self.unknown_ids += not is_known
            if self._wanted is None or message_id(buffer, at) in self._wanted:
                found.append(frame_from_bytes(buffer[at : at + length]))
            at += length
        self._rest = buffer[at:]
        return found


def _unknown_frame(buffer: bytes, at: int, headers: _Headers) -> int:
    """Length of the frame of an unknown id at `at`, or NEED_MORE or NOT_A_FRAME."""
    end = at + unchecked_length(buffer, at)
    within = headers.next_promising(at + 1)
    if within < min(end, len(buffer)):
        may_wait = len(buffer) - at < LONGEST_FRAME
        return NEED_MORE if may_wait and check_frame(buffer, within) == NEED_MORE else NOT_A_FRAME
    if end > len(buffer):
        return NEED_MORE
    return end - at if end == len(buffer) or buffer[end] in (MAGIC_V1, MAGIC_V2) else NOT_A_FRAME


def _header_places(buffer: bytes) -> tuple[list[int], list[int]]:
    """Where whole frames may start, and those of an id that we know.

    They are all magic bytes of the last few hundred bytes, of the others those with a fit header.
    """
    data = np.frombuffer(buffer, dtype=np.uint8)
    magic = np.flatnonzero((data == MAGIC_V1) | (data == MAGIC_V2))
    tail = magic[magic > len(data) - 2 * LONGEST_FRAME]
    magic = magic[: len(magic) - len(tail)]
    is_v2 = data[magic] == MAGIC_V2
    v1, v2 = magic[~is_v2], magic[is_v2]
    v2 = v2[data[v2 + 2] <= 1]
    lengths_v1, lengths_v2 = data[v1 + 1].astype(np.int32), data[v2 + 1].astype(np.int32)
    full_v1 = _FULL_BYTES[data[v1 + 5]]
    full_v2 = _FULL_BYTES[data[v2 + 7] | data[v2 + 8].astype(np.int32) << 8]
    full_v2 = np.where(data[v2 + 9] == 0, full_v2, -1)
    fits_v1 = np.where(full_v1 >= 0, lengths_v1 <= full_v1, _is_magic(data, v1 + lengths_v1 + 8))
    ends_v2 = v2 + lengths_v2 + 12 + SIGNATURE_BYTES * data[v2 + 2].astype(np.int32)
    fits_v2 = np.where(full_v2 >= 0, lengths_v2 <= full_v2, _is_magic(data, ends_v2))
    known = np.concatenate([v1[fits_v1 & (full_v1 >= 0)], v2[fits_v2 & (full_v2 >= 0)], tail])
    unknown = np.concatenate([v1[fits_v1 & (full_v1 < 0)], v2[fits_v2 & (full_v2 < 0)]])
    return np.sort(np.concatenate([known, unknown])).tolist(), np.sort(known).tolist()


def _is_magic(data: NDArray[np.uint8], at: NDArray[np.intp]) -> NDArray[np.bool_]:
    return np.asarray((data[at] == MAGIC_V1) | (data[at] == MAGIC_V2))


class Decoder:
    """Turns frames into pymavlink's messages with a `MAVLink` of its own, whose stream buffer is never used."""

    def __init__(self) -> None:
        self._mav = mavlink.MAVLink(None)

    def decode(self, frame: MavFrame) -> Any | None:
        """The message, or None where it cannot be decoded."""
        try:
            return self._mav.decode(bytearray(frame.raw))
        except (mavlink.MAVError, struct.error, ValueError, TypeError):
            return None


_DECODER = Decoder()


def decode(frame: MavFrame) -> Any | None:
    """The frame's pymavlink message, or None where it cannot be decoded."""
    return _DECODER.decode(frame)
