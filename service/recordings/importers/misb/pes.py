"""Parts of a transport stream: a stream's kind, PES headers, metadata access units, a table's checksum. Free of I/O."""

_PRIVATE, _METADATA = 0x06, 0x15
_VIDEO = frozenset({0x01, 0x02, 0x10, 0x1B, 0x24})  # MPEG-1, 2, 4, H.264, H.265
_REGISTRATION, _KLVA = 0x05, b"KLVA"
_CELL_HEADER = 5


def kind_of(kind: int, descriptors: bytes) -> str | None:
    """Video, or KLV that is sync or async; None for whatever else."""
    if kind in _VIDEO:
        return "video"
    if kind not in (_PRIVATE, _METADATA):
        return None
    at, is_klva = 0, False
    while at + 2 <= len(descriptors):
        tag, size = descriptors[at], descriptors[at + 1]
        value = descriptors[at + 2 : at + 2 + size]
        is_klva |= tag == _REGISTRATION and value[:4] == _KLVA
        is_klva |= tag == 0x26 and _KLVA in value  # a metadata descriptor's format identifier
        at += 2 + size
    return ("sync" if kind == _METADATA else "async") if is_klva else None


def told_size(data: bytes | bytearray) -> int:
    """Of the whole PES packet; 0 where it does not say."""
    if len(data) < 6:
        return 0
    told = data[4] << 8 | data[5]
    return told + 6 if told else 0


def header_of(data: bytes | bytearray) -> tuple[int, int | None] | None:
    """Where a PES packet's data begins, and its time stamp."""
    if len(data) < 9 or data[:3] != b"\x00\x00\x01" or data[6] & 0xC0 != 0x80:
        return None
    start = 9 + data[8]
    if start > len(data):
        return None
    if not data[7] & 0x80 or start < 14:
        return start, None
    a, b, c, d, e = data[9:14]
    return start, (a >> 1 & 7) << 30 | b << 22 | (c >> 1) << 15 | d << 7 | e >> 1


def cells(data: bytes) -> list[bytes]:
    """Metadata access units (ISO/IEC 13818-1, 2.12.4): header and data, by turns; parts of one are put together."""
    whole: list[bytes] = []
    open_part = b""
    at = 0
    while at + _CELL_HEADER <= len(data):
        fragment, size = data[at + 2] >> 6, data[at + 3] << 8 | data[at + 4]
        part = data[at + _CELL_HEADER : at + _CELL_HEADER + size]
        at += _CELL_HEADER + size
        if fragment == 0b11:
            whole.append(part)
        elif fragment == 0b10:
            open_part = part
        else:
            open_part += part
            if fragment == 0b01:
                whole.append(open_part)
                open_part = b""
    return whole


def crc_is_zero(section: bytes) -> bool:
    """CRC-32/MPEG-2 over a section with its own."""
    crc = 0xFFFFFFFF
    for byte in section:
        crc ^= byte << 24
        for _ in range(8):
            crc = crc << 1 ^ (0x04C11DB7 if crc & 0x80000000 else 0)
        crc &= 0xFFFFFFFF
    return crc == 0
