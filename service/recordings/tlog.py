"""Reads .tlog recordings: repeated [uint64 big-endian microseconds][frame], over junk and cut ends; for the replay."""

from collections.abc import Iterator
from pathlib import Path

from service.mavlink.framer import LONGEST_FRAME, NEED_MORE, UNKNOWN_ID, check_frame, next_magic, unchecked_length
from service.recordings.log_clock import LogClock, Span

STAMP_BYTES = 8
CHUNK_BYTES = 65_536
_MOST_ITEM_BYTES = 2 * (STAMP_BYTES + LONGEST_FRAME)  # a frame and what follows it
LATEST_US = 4_102_444_800_000_000  # 2100-01-01; the earliest is 1970, where a computer without a clock begins
_NEAR_US = 86_400_000_000  # of the frame before, for one that cannot be checked


class TlogReader:
    """Streams a recording once; a stamp counts only if a frame with a right CRC follows it and others bear it out.

    `unstamped` counts whole frames without a stamp, as in a raw stream; `wild` those whose stamp stands alone.
    """

    def __init__(self, path: Path) -> None:
        self.frames = 0
        self.unstamped = 0
        self._dropped_bytes = 0
        self.path = path
        self._clock = LogClock()
        self._last_us: int | None = None

    @property
    def wild(self) -> int:
        """Records whose stamp no other bears out."""
        return self._clock.wild

    @property
    def dropped_bytes(self) -> int:
        """What was passed over."""
        return self._dropped_bytes + self._clock.wild_bytes + STAMP_BYTES * self._clock.wild

    @property
    def spans(self) -> list[Span]:
        """The stretches on one clock so far: one, unless the clock was set."""
        return self._clock.spans

    def __iter__(self) -> Iterator[tuple[int, bytes]]:
        """Each frame with its stamp in microseconds, even where the log's clock was set: see LogClock.

        Raises OSError where the file cannot be read.
        """
        for stamp_us, raw in self._stamped():
            for record in self._clock.take(stamp_us, raw):
                self.frames += 1
                yield record
        for record in self._clock.end():
            self.frames += 1
            yield record

    def _stamped(self) -> Iterator[tuple[int, bytes]]:
        buffer, at = b"", 0
        with self.path.open("rb") as file:
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
        self._dropped_bytes += len(buffer) - at

    def _step(self, buffer: bytes, at: int) -> tuple[int, tuple[int, bytes] | None]:
        """Where to go on, and what was found: a frame, or nothing where bytes were passed over."""
        start = at + STAMP_BYTES
        length = check_frame(buffer, start)
        is_known = length != UNKNOWN_ID
        if not is_known:
            length = self._unknown_length(buffer, start)
        if length > 0:
            stamp_us = int.from_bytes(buffer[at:start], "big")
            if stamp_us <= LATEST_US:
                self._last_us = stamp_us
                return start + length, (stamp_us, buffer[start : start + length])
            passed = STAMP_BYTES + length
        elif (length_here := check_frame(buffer, at)) > 0:
            self.unstamped += 1
            passed = length_here
        elif length == NEED_MORE:
            passed = 1
        else:
            passed = next_magic(buffer, start + 1) - start
        self._dropped_bytes += passed
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
        is_near = last_us is not None and all(abs(stamp_us - last_us) <= _NEAR_US for stamp_us in stamps_us)
        return end - start if is_near else UNKNOWN_ID


def read_tlog(path: Path) -> Iterator[tuple[int, bytes]]:
    """(stamp_us, frame) for each whole frame of a recording."""
    return iter(TlogReader(path))
