"""Reads .tlog recordings: repeated [uint64 big-endian microseconds][frame], over junk and cut ends; for the replay."""

from collections.abc import Iterator
from pathlib import Path

from service.mavlink.framer import LONGEST_FRAME, NEED_MORE, UNKNOWN_ID, check_frame, next_magic, unchecked_length

STAMP_BYTES = 8
CHUNK_BYTES = 65_536
_MOST_ITEM_BYTES = 2 * (STAMP_BYTES + LONGEST_FRAME)  # a frame and what follows it
EARLIEST_US = 946_684_800_000_000  # 2000-01-01
LATEST_US = 4_102_444_800_000_000  # 2100-01-01
MOST_STEP_US = 86_400_000_000  # a larger step of the clock must be confirmed by several frames
CONFIRM_FRAMES = 5


class TlogReader:
    """Streams a recording once; a stamp counts only if a frame with a right CRC follows it and it is plausible."""

    def __init__(self, path: Path) -> None:
        self.frames = 0
        self.dropped_bytes = 0
        self._path = path
        self._last_us: int | None = None
        self._odd_us = 0
        self._odd_count = 0

    def __iter__(self) -> Iterator[tuple[int, bytes]]:
        """Each frame with the microseconds of its stamp. Raises OSError where the file cannot be read."""
        buffer, at = b"", 0
        with self._path.open("rb") as file:
            while chunk := file.read(CHUNK_BYTES):
                buffer, at = buffer[at:] + chunk, 0
                while len(buffer) - at > _MOST_ITEM_BYTES:
                    at, item = self._step(buffer, at)
                    if item is not None:
                        yield item
        while len(buffer) - at > STAMP_BYTES:
            at, item = self._step(buffer, at)
            if item is not None:
                yield item
        self.dropped_bytes += len(buffer) - at

    def _step(self, buffer: bytes, at: int) -> tuple[int, tuple[int, bytes] | None]:
        """Where to go on, and what was found: a frame, or nothing where bytes were passed over."""
        start = at + STAMP_BYTES
        length = check_frame(buffer, start)
        is_known = length != UNKNOWN_ID
        if not is_known:
            length = self._unknown_length(buffer, start)
        if length > 0:
            stamp_us = int.from_bytes(buffer[at:start], "big")
            if self._is_plausible(stamp_us):
                self.frames += is_known
                return start + length, (stamp_us, buffer[start : start + length])
            passed = STAMP_BYTES + length
        elif length == NEED_MORE:
            passed = 1
        else:
            passed = next_magic(buffer, start + 1) - start
        self.dropped_bytes += passed
        return at + passed, None

    def _unknown_length(self, buffer: bytes, start: int) -> int:
        """Of a frame whose CRC cannot be checked: a stamp near the last and a frame, or nothing, must follow."""
        end = start + unchecked_length(buffer, start)
        stamps_us = [int.from_bytes(buffer[at : at + STAMP_BYTES], "big") for at in (start - STAMP_BYTES, end)]
        if end == len(buffer):
            del stamps_us[1]
        elif next_magic(buffer, end + STAMP_BYTES) != end + STAMP_BYTES:
            return UNKNOWN_ID
        last_us = self._last_us
        is_near = last_us is not None and all(abs(stamp_us - last_us) <= MOST_STEP_US for stamp_us in stamps_us)
        return end - start if is_near else UNKNOWN_ID

    def _is_plausible(self, stamp_us: int) -> bool:
        if not EARLIEST_US <= stamp_us <= LATEST_US:
            return False
        if self._last_us is None or abs(stamp_us - self._last_us) <= MOST_STEP_US:
            self._odd_count = 0
        else:
            near = abs(stamp_us - self._odd_us) <= MOST_STEP_US
            self._odd_us, self._odd_count = stamp_us, self._odd_count + 1 if near else 1
            if self._odd_count < CONFIRM_FRAMES:
                return False
        self._last_us = stamp_us
        return True


def read_tlog(path: Path) -> Iterator[tuple[int, bytes]]:
    """(stamp_us, frame) for each whole frame of a recording."""
    return iter(TlogReader(path))
