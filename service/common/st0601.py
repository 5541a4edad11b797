"""MISB ST 0601 UAS Datalink Local Set, both ways: packets of one key, a length, items and a checksum. Free of I/O.

The importer of films with KLV reads them, `service/publish/klv.py` writes them; each item's scale stands here once.
Items that are not in `ITEMS` are passed over.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum

KEY = bytes.fromhex("060e2b34020b01010e01030101000000")
VERSION = 19  # of ST 0601, whose table the items below follow
MOST_PACKET_BYTES = 65_536  # real ones have some hundreds
_MOST_ITEMS = 512
_MOST_TEXT_BYTES = 127
_CHECKSUM, _CHECKSUM_BYTES = 1, 4  # its tag; tag, length and value


class Tag:
    """The items that are read or written."""

    TIME_US = 2
    MISSION, PLATFORM = 3, 10  # text
    HEADING, PITCH, ROLL = 5, 6, 7
    PITCH_FULL, ROLL_FULL = 90, 91
    SENSOR_LAT, SENSOR_LON, SENSOR_ALT_MSL = 13, 14, 15
    SENSOR_HEIGHT, SENSOR_HEIGHT_EXTENDED = 75, 104
    HFOV, VFOV = 16, 17
    RELATIVE_AZIMUTH, RELATIVE_ELEVATION, RELATIVE_ROLL = 18, 19, 20
    SLANT_RANGE = 21
    CENTRE_LAT, CENTRE_LON, CENTRE_ELEVATION = 23, 24, 25
    TARGET_LAT, TARGET_LON, TARGET_ELEVATION = 40, 41, 42
    CE90, LE90 = 45, 46
    VERSION = 65
    LEAP_S, CORRECTION_US = 136, 137


class Fault(Enum):
    """Why a packet is not used."""

    LENGTH = "a length that lies"
    CHECKSUM = "a wrong checksum"
    NO_TIME = "no time stamp"


@dataclass(frozen=True, slots=True)
class Scale:
    """A linear item of `size` bytes from `low` to `high`; a signed one's lowest number says that it is not known."""

    size: int
    low: float
    high: float
    is_signed: bool = False

    def value(self, raw: bytes) -> float | None:
        """None for another size, and for what is not known."""
        if len(raw) != self.size:
            return None
        number = int.from_bytes(raw, "big", signed=self.is_signed)
        if self.is_signed:
            most = (1 << 8 * self.size - 1) - 1
            return None if number < -most else number / most * self.high
        return self.low + number / ((1 << 8 * self.size) - 1) * (self.high - self.low)

    def raw(self, value: float) -> bytes:
        """The nearest number. ValueError beyond the item's range: what it cannot say must not be said."""
        if not self.low <= value <= self.high:
            raise ValueError(f"{value} is not from {self.low} to {self.high}")
        if self.is_signed:
            return round(value / self.high * ((1 << 8 * self.size - 1) - 1)).to_bytes(self.size, "big", signed=True)
        share = (value - self.low) / (self.high - self.low)
        return round(share * ((1 << 8 * self.size) - 1)).to_bytes(self.size, "big")


@dataclass(frozen=True, slots=True)
class Whole:
    """A whole number of at most `most` bytes; written with `most`."""

    most: int
    is_signed: bool = False

    def value(self, raw: bytes) -> float | None:
        """None for no byte, or too many."""
        return int.from_bytes(raw, "big", signed=self.is_signed) if 0 < len(raw) <= self.most else None

    def raw(self, value: float) -> bytes:
        """OverflowError where it does not fit."""
        return int(value).to_bytes(self.most, "big", signed=self.is_signed)


@dataclass(frozen=True, slots=True)
class Imap:
    """IMAPB of MISB ST 1201, of 1 to `most` bytes, from `low` on; never written here."""

    low: float
    high: float
    most: int = 8

    def value(self, raw: bytes) -> float | None:
        """None for its special numbers (infinite, not a number) and for sizes that cannot be."""
        if not 0 < len(raw) <= self.most:
            return None
        number = int.from_bytes(raw, "big")
        bits = 8 * len(raw) - 1
        if number > 2**bits:
            return None
        scale = 2.0 ** (bits - math.ceil(math.log2(self.high - self.low)))
        zero = scale * self.low - math.floor(scale * self.low) if self.low < 0.0 < self.high else 0.0
        return (number - zero) / scale + self.low

    def raw(self, value: float) -> bytes:
        raise ValueError(f"{value}: items of this kind are only read")


_ANGLE, _HEIGHT_M = Scale(4, 0.0, 360.0), Scale(2, -900.0, 19_000.0)
_LAT, _LON = Scale(4, -90.0, 90.0, True), Scale(4, -180.0, 180.0, True)
_ERROR_M = Scale(2, 0.0, 4095.0)

ITEMS: dict[int, Scale | Whole | Imap] = {
    Tag.TIME_US: Whole(8),
    Tag.HEADING: Scale(2, 0.0, 360.0),
    Tag.PITCH: Scale(2, -20.0, 20.0, True),
    Tag.ROLL: Scale(2, -50.0, 50.0, True),
    Tag.PITCH_FULL: _LAT,
    Tag.ROLL_FULL: _LAT,
    Tag.SENSOR_LAT: _LAT,
    Tag.SENSOR_LON: _LON,
    Tag.SENSOR_ALT_MSL: _HEIGHT_M,
    Tag.SENSOR_HEIGHT: _HEIGHT_M,
    Tag.SENSOR_HEIGHT_EXTENDED: Imap(-900.0, 40_000.0),
    Tag.HFOV: Scale(2, 0.0, 180.0),
    Tag.VFOV: Scale(2, 0.0, 180.0),
    Tag.RELATIVE_AZIMUTH: _ANGLE,
    Tag.RELATIVE_ELEVATION: _LON,
    Tag.RELATIVE_ROLL: _ANGLE,
    Tag.SLANT_RANGE: Scale(4, 0.0, 5_000_000.0),
    Tag.CENTRE_LAT: _LAT,
    Tag.CENTRE_LON: _LON,
    Tag.CENTRE_ELEVATION: _HEIGHT_M,
    Tag.TARGET_LAT: _LAT,
    Tag.TARGET_LON: _LON,
    Tag.TARGET_ELEVATION: _HEIGHT_M,
    Tag.CE90: _ERROR_M,
    Tag.LE90: _ERROR_M,
    Tag.VERSION: Whole(1),
    Tag.LEAP_S: Whole(4, True),
    Tag.CORRECTION_US: Whole(8, True),
}


def holds(tag: int, value: float) -> bool:
    """Whether a linear item can say a value."""
    item = ITEMS[tag]
    return isinstance(item, Scale) and item.low <= value <= item.high


def encoded(values: Mapping[int, float], texts: Mapping[int, str]) -> bytes:
    """A packet with the items in their order: the time first, the checksum last.

    ValueError or OverflowError for a value that its item cannot say, KeyError for an item that is not known here.
    """
    raw = {tag: ITEMS[tag].raw(value) for tag, value in values.items()}
    raw |= {tag: text.encode()[:_MOST_TEXT_BYTES] for tag, text in texts.items()}
    items = b"".join(_item(tag, raw[tag]) for tag in sorted(raw, key=lambda tag: (tag != Tag.TIME_US, tag)))
    packet = KEY + _length(len(items) + _CHECKSUM_BYTES) + items + bytes((_CHECKSUM, 2))
    return packet + checksum(packet).to_bytes(2, "big")


def decoded(packet: bytes) -> dict[int, float] | Fault:
    """The known items of one packet, from its key to its end; of one that comes twice the last. No error is raised."""
    start = value_span(packet, len(KEY))
    if not packet.startswith(KEY) or start is None or start[1] != len(packet):
        return Fault.LENGTH
    if packet[-_CHECKSUM_BYTES:-2] != bytes((_CHECKSUM, 2)):
        return Fault.CHECKSUM
    if not _is_summed(packet):
        return Fault.CHECKSUM
    values: dict[int, float] = {}
    at, end = start[0], len(packet) - _CHECKSUM_BYTES
    for _ in range(_MOST_ITEMS):
        if at >= end:
            break
        tag, at = _tag(packet, at)
        span = value_span(packet, at)
        if span is None or span[1] > end:
            return Fault.LENGTH
        item = ITEMS.get(tag)
        value = None if item is None else item.value(packet[span[0] : span[1]])
        if value is not None:
            values[tag] = value
        at = span[1]
    return values if Tag.TIME_US in values else Fault.NO_TIME


def utc_s(values: Mapping[int, float]) -> float:
    """UTC of a packet's time stamp; MISP time, which counts leap seconds, where the packet says how many."""
    stamp_us = values[Tag.TIME_US] + values.get(Tag.CORRECTION_US, 0.0)
    return stamp_us * 1e-6 - values.get(Tag.LEAP_S, 0.0)


def checksum(data: bytes) -> int:
    """The sum of 16-bit words, big-endian, modulo 65,536 (ST 0601, item 1)."""
    return (256 * sum(data[::2]) + sum(data[1::2])) & 0xFFFF


def value_span(data: bytes, at: int) -> tuple[int, int] | None:
    """Where the value of a BER length at `at` begins and ends; None where that is not in `data`."""
    if at >= len(data):
        return None
    first = data[at]
    if first < 0x80:
        start, size = at + 1, first
    else:
        count = first & 0x7F
        start = at + 1 + count
        if not 0 < count <= 8 or start > len(data):
            return None
        size = int.from_bytes(data[at + 1 : start], "big")
    return (start, start + size) if start + size <= len(data) else None


def packets(data: bytes) -> list[bytes]:
    """What in a run of bytes may be a packet by its key and length, whatever lies between."""
    found: list[bytes] = []
    at = data.find(KEY)
    while at >= 0:
        span = value_span(data, at + len(KEY))
        if span is None or span[1] - at > MOST_PACKET_BYTES:
            at = data.find(KEY, at + 1)
            continue
        found.append(data[at : span[1]])
        is_whole = span[1] - at > _CHECKSUM_BYTES and _is_summed(found[-1])
        at = data.find(KEY, span[1] if is_whole else at + 1)  # one that lies may hold the next
    return found


def _is_summed(packet: bytes) -> bool:
    return int.from_bytes(packet[-2:], "big") == checksum(packet[:-2])


def _item(tag: int, raw: bytes) -> bytes:
    high = bytes((0x80 | tag >> 7,)) if tag > 0x7F else b""
    return high + bytes((tag & 0x7F,)) + _length(len(raw)) + raw


def _length(size: int) -> bytes:
    if size < 0x80:
        return bytes((size,))
    raw = size.to_bytes((size.bit_length() + 7) // 8, "big")
    return bytes((0x80 | len(raw),)) + raw


def _tag(data: bytes, at: int) -> tuple[int, int]:
    """A BER-OID tag, and where its length stands."""
    tag = 0
    for _ in range(4):
        byte = data[at]
        tag, at = tag << 7 | byte & 0x7F, at + 1
        if byte < 0x80 or at >= len(data):
            break
    return tag, at
