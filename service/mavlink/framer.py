"""Finds whole MAVLink frames in a stream of bytes and decodes them; used by the links, the replay and the autopilot.

pymavlink's own parser grows without bound on chunks that never end on a frame and loses frames after junk.
"""

import re
import struct
from typing import Any

from fastcrc import crc16
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
        return MavFrame(raw, 1, raw[3], raw[4], raw[2], raw[5])
    return MavFrame(raw, 2, raw[5], raw[6], raw[4], message_id(raw))


class Framer:
    """Cuts a stream into frames; keeps less than one frame between calls.

    Only frames whose id is in `wanted` are returned (None: all); the others are counted all the same.
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
        found: list[MavFrame] = []
        at = 0
        while at < len(buffer):
            length = check_frame(buffer, at)
            if length == NEED_MORE:
                break
            if length <= 0:
                self._count_failure(length)
                skipped_from, at = at + 1, next_magic(buffer, at + 1)
                self.bad_bytes += at - skipped_from
                continue
            self.frames += 1
            if self._wanted is None or message_id(buffer, at) in self._wanted:
                found.append(frame_from_bytes(buffer[at : at + length]))
            at += length
        self._rest = buffer[at:]
        return found

    def _count_failure(self, code: int) -> None:
        self.bad_bytes += 1
        self.bad_crc += code == BAD_CRC
        self.unknown_ids += code == UNKNOWN_ID


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
