"""Finds whole MAVLink frames in a stream of bytes and decodes them; used by the links, the replay and the autopilot.

pymavlink's own parser grows without bound on chunks that never end on a frame and loses frames after junk.
"""

import re
import struct
from typing import Any

import numpy as np
from fastcrc import crc16
from numpy.typing import NDArray
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from service.common.messages import MavFrame
from service.mavlink.checksums import MOST_BYTES, Checksums

MAGIC_V1 = 0xFE
MAGIC_V2 = 0xFD
SIGNATURE_BYTES = 13
LONGEST_FRAME = 10 + 255 + 2 + SIGNATURE_BYTES

# What `check_frame` returns instead of a length.
NOT_A_FRAME = 0
NEED_MORE = -1
BAD_CRC = -2
UNKNOWN_ID = -3
_NO_FRAME = (NOT_A_FRAME, BAD_CRC, UNKNOWN_ID)

_MAGIC = re.compile(rb"[\xfd\xfe]")
_KNOWN: dict[int, tuple[int, bytes]] = {
    int(number): (int(message.unpacker.size), bytes([message.crc_extra]))
    for number, message in mavlink.mavlink_map.items()
}
_FULL_BYTES = np.full(1 << 16, -1, dtype=np.int16)  # by id: the longest payload; no known id is above
_FULL_BYTES[list(_KNOWN)] = [full for full, _ in _KNOWN.values()]
_EXTRAS = np.zeros(1 << 16, dtype=np.uint8)
_EXTRAS[list(_KNOWN)] = [extra[0] for _, extra in _KNOWN.values()]
_FEW_BYTES = 1_024  # up to which it is not worth while to look at all headers at once
_UNDECIDED_BYTES = 2 * LONGEST_FRAME  # of a window: a frame of an unknown id, and what starts within it, may end beyond


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
    if raw[0] == MAGIC_V1:
        return MavFrame(raw, 1, raw[3], raw[4], raw[2], raw[5], raw[5] in _KNOWN)
    number = raw[7] | raw[8] << 8 | raw[9] << 16
    return MavFrame(raw, 2, raw[5], raw[6], raw[4], number, number in _KNOWN)


class _Promising:
    """Where in the last bytes of a buffer a checked frame starts or may yet start."""

    def __init__(self, buffer: bytes) -> None:
        self._buffer = buffer
        self._place = -1

    def next(self, at: int) -> int:
        """The first place at or after `at`, the buffer's length if there is none; asked with rising `at`."""
        if self._place < at:
            self._place = next_magic(self._buffer, at)
            while self._place < len(self._buffer) and check_frame(self._buffer, self._place) in _NO_FRAME:
                self._place = next_magic(self._buffer, self._place + 1)
        return self._place


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
        promising = _Promising(buffer)
        found: list[MavFrame] = []
        at = 0
        while at < len(buffer):
            length = check_frame(buffer, at)
            if length in _NO_FRAME and len(buffer) - at > _FEW_BYTES:
                at += self._feed_many(buffer[at : at + MOST_BYTES], found)
                continue
            if length == UNKNOWN_ID:
                length = _unknown_frame(buffer, at, promising)
            if length == NEED_MORE:
                break
            if length <= 0:
                self.bad_crc += length == BAD_CRC
                skipped_from, at = at, next_magic(buffer, at + 1)
                self.bad_bytes += at - skipped_from
                continue
            self._take([frame_from_bytes(buffer[at : at + length])], found)
            at += length
        self._rest = buffer[at:]
        return found

    def _feed_many(self, window: bytes, found: list[MavFrame]) -> int:
        """Take the frames that start in a window, but for its last `_UNDECIDED_BYTES`; how many bytes are done with."""
        lengths, is_bad = _frames_within(np.frombuffer(window, dtype=np.uint8))
        starts = _one_after_another(lengths)
        ends = starts + lengths[starts]
        spans = zip(starts.tolist(), ends.tolist(), strict=True)
        self._take([frame_from_bytes(window[start:end]) for start, end in spans], found)
        done = max(len(is_bad), int(ends.max(initial=0)))
        self.bad_bytes += done - int(np.sum(ends - starts))
        bad_before = _counts_before(is_bad)
        within = bad_before[np.minimum(ends, len(is_bad))] - bad_before[starts]
        self.bad_crc += int(bad_before[-1] - np.sum(within))
        return done

    def _take(self, frames: list[MavFrame], found: list[MavFrame]) -> None:
        known = [frame.is_known for frame in frames].count(True)
        self.frames += known
        self.unknown_ids += len(frames) - known
        found += frames if self._wanted is None else [one for one in frames if one.message_id in self._wanted]


def _unknown_frame(buffer: bytes, at: int, promising: _Promising) -> int:
    """Length of the frame of an unknown id at `at`, or NEED_MORE or NOT_A_FRAME."""
    end = at + unchecked_length(buffer, at)
    within = promising.next(at + 1)
    if within < min(end, len(buffer)):
        may_wait = len(buffer) - at < LONGEST_FRAME
        return NEED_MORE if may_wait and check_frame(buffer, within) == NEED_MORE else NOT_A_FRAME
    if end > len(buffer):
        return NEED_MORE
    return end - at if end == len(buffer) or buffer[end] in (MAGIC_V1, MAGIC_V2) else NOT_A_FRAME


def _frames_within(data: NDArray[np.uint8]) -> tuple[NDArray[np.int16], NDArray[np.bool_]]:
    """What `check_frame` and `_unknown_frame` say of each byte but the last `_UNDECIDED_BYTES`, all at once.

    By byte: the length of the frame that starts there or 0, and whether one of a known id with a wrong CRC does.
    """
    magic = np.flatnonzero(_is_magic(data[:-LONGEST_FRAME]))
    is_v1 = data[magic] == MAGIC_V1
    v1, v2 = magic[is_v1], magic[~is_v1]
    flags = data[v2 + 2]
    v2, flags = v2[flags <= 1], flags[flags <= 1]
    ids_v1, ids_v2 = data[v1 + 5], data[v2 + 7] | data[v2 + 8].astype(np.uint16) << 8
    at = np.concatenate([v1, v2])
    full = np.concatenate([_FULL_BYTES[ids_v1], np.where(data[v2 + 9] == 0, _FULL_BYTES[ids_v2], -1)])
    payload = data[at + 1]
    ends = payload + np.concatenate([v1 + 6, v2 + 10])
    frame_ends = ends + 2
    frame_ends[len(v1) :] += flags * np.intp(SIGNATURE_BYTES)
    fits = (full >= 0) & (payload <= full)
    is_good = fits.copy()
    extras = np.concatenate([_EXTRAS[ids_v1], _EXTRAS[ids_v2]])[fits]
    is_good[fits] = Checksums(data).are_right(at[fits] + 1, ends[fits], extras)
    good = np.append(np.sort(at[is_good]), len(data))
    unknown = np.flatnonzero((full < 0) & _is_magic(data[frame_ends]))
    unknown = unknown[good[np.searchsorted(good, at[unknown], side="right")] >= frame_ends[unknown]]

    lengths, is_bad = np.zeros(len(data), np.int16), np.zeros(len(data), np.bool_)
    is_bad[at[fits & ~is_good]] = True
    for taken in (is_good, unknown):
        lengths[at[taken]] = frame_ends[taken] - at[taken]
    return lengths[:-_UNDECIDED_BYTES], is_bad[:-_UNDECIDED_BYTES]


def _one_after_another(lengths: NDArray[np.int16]) -> NDArray[np.intp]:
    """Where the frames start that are left where each that is taken hides those that start within it."""
    starts = np.flatnonzero(lengths)
    ends = np.minimum(starts + lengths[starts], len(lengths))
    followers = _counts_before(lengths > 0)[ends].data
    index, taken = 0, []
    while index < len(starts):
        taken.append(index)
        index = followers[index]
    return starts[taken]


def _counts_before(flags: NDArray[np.bool_]) -> NDArray[np.intp]:
    """How many flags are set before each place, and before the end."""
    return np.concatenate([[0], np.cumsum(flags, dtype=np.intp)])


def _is_magic(data: NDArray[np.uint8]) -> NDArray[np.bool_]:
    return np.asarray((data == MAGIC_V1) | (data == MAGIC_V2))


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
