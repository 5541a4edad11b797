"""MAVLink 2 message signing: refuses frames without a right signature, signs what goes out; one for each link. No I/O.

The rules are the MAVLink guide's. pymavlink's own check remembers a frame's time before it looks at the hash, so that
one forged frame from the future locks the true sender out: here nothing is remembered of a frame that was refused.
"""

import binascii
import hashlib
import hmac
from collections import Counter
from collections.abc import Callable
from typing import Protocol

from service.common.messages import MavFrame
from service.config.secret_file import read_secret
from service.config.sections import ConfigError, MavlinkConfig
from service.mavlink.framer import with_flags

KEY_BYTES = 32
HASH_BYTES = 6
SIGNED = 0x01  # of the incompatibility flags
EPOCH_NS = 1_420_070_400_000_000_000  # 2015-01-01 UTC, from which signatures count
TICK_NS = 10_000
TICKS_A_SECOND = 100_000
NEW_STREAM_TICKS = 60 * TICKS_A_SECOND  # a sender not heard before may be so far behind
FUTURE_TICKS = 365 * 86_400 * TICKS_A_SECOND  # a right signature from beyond is of a sender whose clock is wrong
CLOCK_SET_TICKS = 11 * 365 * 86_400 * TICKS_A_SECOND  # 2025-12-29: before it the host's clock was never set
MOST_STREAMS = 64
RADIO_STATUS = 109  # the radio puts it into the stream itself, unsigned; says nothing but the radio's own figures

Clock = Callable[[], int]  # ns of Unix time


def is_signed(frame: MavFrame) -> bool:
    """Whether it bears a signature, right or not."""
    return frame.version == 2 and bool(frame.raw[2] & SIGNED)


class LinkSigning(Protocol):
    """What a link asks of signing; `refused` counts the frames by reason."""

    refused: Counter[str]
    is_on: bool

    def accepts(self, frame: MavFrame) -> bool:
        """Whether the frame may be acted on."""
        ...

    def signed(self, raw: bytes) -> bytes:
        """The MAVLink 2 frame as it goes out."""
        ...


class Unsigned:
    """Signing switched off: takes all, signs nothing."""

    is_on = False

    def __init__(self) -> None:
        self.refused: Counter[str] = Counter()

    def accepts(self, frame: MavFrame) -> bool:
        """True."""
        return True

    def signed(self, raw: bytes) -> bytes:
        """The frame as it is."""
        return raw


class Keyring:
    """The key and the times that all links share: of two links none takes what the other heard before.

    Our time is the host's clock, or the newest that a right signature bore: a computer without a battery for its clock
    learns the autopilot's. What we sign never steps back; whom we hear isn't judged by it, as our clock may have.
    """

    def __init__(self, key: bytes, clock_ns: Clock) -> None:
        self._key = key
        self._clock_ns = clock_ns
        self._heard = self._sent = 0
        self._streams: dict[tuple[int, int, int], int] = {}

    def fault(self, frame: MavFrame) -> str | None:
        """Why the frame must be refused, or None; only then its time is remembered."""
        if not is_signed(frame):
            return None if frame.message_id == RADIO_STATUS else "unsigned"
        body, given = frame.raw[:-HASH_BYTES], frame.raw[-HASH_BYTES:]
        if not hmac.compare_digest(self._hash(body), given):
            return "wrong_signature"
        ticks = int.from_bytes(body[-6:], "little")
        stream = (body[-7], frame.system, frame.component)
        reason = self._fault_of_time(stream, ticks)
        if reason is None:
            self._streams[stream] = ticks
            self._heard = max(self._heard, ticks)
        return reason

    def signature(self, body: bytes, link_id: int) -> bytes:
        """The 13 bytes that follow a frame's checksum; each bears a later time than the one before."""
        self._sent = max(self._host_ticks(), self._heard + 1, self._sent + 1)
        block = bytes([link_id]) + self._sent.to_bytes(6, "little")
        return block + self._hash(body + block)

    def _fault_of_time(self, stream: tuple[int, int, int], ticks: int) -> str | None:
        host = self._host_ticks()
        now = max(host, self._heard)
        if host >= CLOCK_SET_TICKS and ticks > now + FUTURE_TICKS:
            return "future"
        last = self._streams.get(stream)
        if last is not None:
            return "replayed" if ticks <= last else None
        if ticks + NEW_STREAM_TICKS < now:
            return "too_old"
        return None if len(self._streams) < MOST_STREAMS else "too_many_senders"

    def _host_ticks(self) -> int:
        return max(0, (self._clock_ns() - EPOCH_NS) // TICK_NS)

    def _hash(self, body: bytes) -> bytes:
        return hashlib.sha256(self._key + body).digest()[:HASH_BYTES]


class Signed:
    """One link's signing under the shared key, with the link's own id."""

    is_on = True

    def __init__(self, keyring: Keyring, link_id: int) -> None:
        self.refused: Counter[str] = Counter()
        self._keyring = keyring
        self._link_id = link_id

    def accepts(self, frame: MavFrame) -> bool:
        """Whether it is signed with our key, and newer than what its sender signed before."""
        reason = self._keyring.fault(frame)
        if reason is not None:
            self.refused[reason] += 1
        return reason is None

    def signed(self, raw: bytes) -> bytes:
        """The frame with its flag, a new checksum and the signature."""
        body = with_flags(raw, SIGNED)
        return body + self._keyring.signature(body, self._link_id)


def signing_of_links(config: MavlinkConfig, clock_ns: Clock) -> list[LinkSigning]:
    """One for each of the config's links, in order; ConfigError where the key is none."""
    if not config.signing_key:
        return [Unsigned() for _ in config.links]
    keyring = Keyring(_key(config.signing_key), clock_ns)
    return [Signed(keyring, number) if link.signed else Unsigned() for number, link in enumerate(config.links)]


def _key(value: str) -> bytes:
    held = read_secret("mavlink.signing_key", value)
    try:
        key = held if len(held) == KEY_BYTES else binascii.unhexlify(held.strip())
    except binascii.Error:
        key = b""
    if len(key) != KEY_BYTES or not any(key):
        raise ConfigError(f"mavlink.signing_key is {value!r}: it must hold 32 bytes or 64 hex digits, not all 0")
    return key
