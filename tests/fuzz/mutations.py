"""Bytes that are almost right: valid input cut, flipped, repeated and filled with what parsers stumble over."""

import random
import struct
from collections.abc import Sequence

from fastcrc import crc16
from pymavlink.dialects.v20 import ardupilotmega as mavlink

ODD = (
    *(b"", b"0", b"-1", b"-0.0", b"nan", b"inf", b"-inf", b"1e400", b"1e-400", b"2147483648", b"9223372036854775808"),
    *(b"true", b"''", b'"', b"'", b"[", b"]", b"{", b"}", b"=", b",", b".", b"#"),
    *(b"\n", b"\r", b"\0", b"\xff", b"\xef\xbb\xbf", b"[" * 2000, b'{"a":' * 2000),
    *(b"9" * 5000, b"../../etc/passwd", b"/dev/zero", b"%n%s", b"a." * 500),
    *(b"1979-05-27", b'"\\ud800"', "\u202e".encode(), b"0x7f", b"1_0", b"[[]]", b"{}", b"null", b"x" * 70_000),
)  # fmt: skip
_FLOATS = (float("nan"), float("inf"), float("-inf"), 1e38, -1e38, 1e-45, 0.0, 1.0, -1.0)
_MESSAGES = [
    (number, int(message.unpacker.size), bytes([message.crc_extra])) for number, message in mavlink.mavlink_map.items()
]
_COMMANDS, _COMMAND_BYTES = (75, 76), 32  # both have number, system and component at 28 to 31
_ASKED = (0.0, 251.0, 259.0, 271.0, 275.0, 276.0, 350.0)
_HEARD = (0, 2, 24, 30, 31, 33, 75, 76, 77, 111, 193, 230, 242, 265, 285)  # those that the service acts on


def mutated(rng: random.Random, data: bytes, odd: Sequence[bytes] = ODD) -> bytes:
    """The data after one to six small harms."""
    made = bytearray(data)
    for _ in range(rng.randint(1, 6)):
        at = rng.randrange(len(made) + 1)
        end = min(len(made), at + rng.choice((1, 1, 4, 20, 300)))
        what = rng.randrange(6)
        if what == 0 and at < len(made):
            made[at] ^= 1 << rng.randrange(8)
        elif what == 1:
            made[at:end] = rng.choice(odd)
        elif what == 2:
            del made[at:end]
        elif what == 3:
            made[at:at] = made[at:end] * rng.choice((1, 2, 50))
        elif what == 4:
            made[at:at] = rng.randbytes(rng.randint(1, 20))
        else:
            start = rng.randrange(len(made) + 1)
            made[at:end] = made[start : start + rng.choice((1, 10, 100))]
    return bytes(made)


def changed_value(rng: random.Random, text: bytes, odd: Sequence[bytes] = ODD) -> bytes:
    """Lines of `key = value` with one value put in another's place, or an odd one."""
    lines = text.split(b"\n")
    with_value = [number for number, line in enumerate(lines) if b"=" in line]
    for _ in range(rng.randint(1, 3)):
        number = rng.choice(with_value)
        other = lines[rng.choice(with_value)].partition(b"=")[2]
        lines[number] = lines[number].partition(b"=")[0] + b"= " + rng.choice((other, rng.choice(odd)))
    return b"\n".join(lines)


def stream(rng: random.Random) -> bytes:
    """Junk, frames with a right checksum and any payload, and frames that were harmed."""
    parts = []
    for _ in range(rng.randint(1, 4)):
        what = rng.randrange(4)
        if what == 0:
            parts.append(rng.randbytes(rng.randint(0, 64)))
        elif what == 1:
            parts.append(bytes([rng.choice((0xFD, 0xFE))]) + rng.randbytes(rng.randint(0, 40)))
        else:
            frame = any_frame(rng)
            parts.append(frame if what == 2 else mutated(rng, frame, (b"\xfd", b"\xfe", b"\0" * 300)))
    return b"".join(parts)


def any_frame(rng: random.Random) -> bytes:
    """A frame of a known message with a right checksum; mostly of the autopilot, mostly one that is acted on."""
    number, size, extra = rng.choice(_MESSAGES)
    if rng.random() < 0.7:
        number = rng.choice(_HEARD)
        size, extra = next((size, extra) for known, size, extra in _MESSAGES if known == number)
    payload = bytearray(rng.randbytes(rng.randint(1, size)))
    if size >= 4 and rng.random() < 0.5:
        at = 4 * rng.randrange((len(payload) + 3) // 4)
        payload[at : at + 4] = struct.pack("<f", rng.choice(_FLOATS))
        payload = payload[:size]
    if number in _COMMANDS and rng.random() < 0.7:
        payload = payload.ljust(_COMMAND_BYTES, b"\0")
        payload[28:32] = struct.pack("<HBB", rng.choice((511, 512)), 1, rng.choice((0, 100, 191)))
        payload[0:4] = struct.pack("<f", rng.choice((*_FLOATS, *_ASKED)))
    system, component = rng.choice(((1, 1), (1, 1), (1, 1), (255, 190), (1, 191), (0, 0), (rng.randrange(256), 1)))
    if number < 256 and rng.random() < 0.2:
        head = bytes([0xFE, len(payload), rng.randrange(256), system, component, number])
        flags = 0
    else:
        flags = int(rng.random() < 0.1)
        head = bytes([0xFD, len(payload), flags, 0, rng.randrange(256), system, component]) + number.to_bytes(
            3, "little"
        )
    body = head + payload
    return body + crc16.mcrf4xx(body[1:] + extra).to_bytes(2, "little") + rng.randbytes(13 * flags)
