"""The pictures of one run of a command, each with its time; the source reads them on the camera's thread."""

import os
import select
import time
from collections.abc import Iterator
from dataclasses import dataclass

from service.camera.command.cutting import Cutter
from service.camera.command.pauses import MOST_DOUBT, PauseWatch
from service.camera.command.pictures import Encoded, FormatError
from service.camera.command.run import Run
from service.camera.command.times import TimeLines
from service.camera.source import Clock

_READ_BYTES = 1 << 20
_FULL = 0.5  # of the pipe, in one read: it was full, or nearly, as pages of small pieces are half empty
_LINE_S = 1.0  # a frame's time is waited for


class StreamEndedError(Exception):
    """Nothing more comes."""


@dataclass(frozen=True, slots=True)
class Arrival:
    """A picture, when its last byte came by our clock, and the time that the command wrote of it, if it writes any."""

    picture: Encoded
    arrival_ns: int
    time_ns: int | None
    is_split: bool  # cut at the wrong place, by its pauses


class Stream:
    """`pauses` is for formats that do not say where a frame begins; `silent_s` how long none may come."""

    def __init__(self, run: Run, cutter: Cutter, pauses: PauseWatch | None, clock: Clock, silent_s: float) -> None:
        self.run, self.frames = run, 0
        self.began_s = self._frame_s = time.monotonic()
        self._cutter, self._pauses, self._clock, self._silent_s = cutter, pauses, clock, silent_s
        self._buffer = bytearray(_READ_BYTES)
        self._whole: Iterator[Encoded] = iter(())
        self._lines = TimeLines()
        self._arrival_ns = self._count = 0  # of the last read
        self._poll = select.poll()
        for fd in (run.frames, run.said, *([] if run.times is None else [run.times])):
            self._poll.register(fd, select.POLLIN)

    @property
    def held(self) -> int:
        """Bytes of a picture that is not whole yet."""
        return self._cutter.held

    def next(self, wake: int) -> Arrival | None:
        """The next picture; None once `wake` can be read. StreamEndedError, or FormatError for what cannot go on."""
        self._poll.register(wake, select.POLLIN)
        while (arrival := self._arrived(wake)) is not None:
            if not (arrival.is_split and self.frames == 1):  # a program may pause as it begins
                return arrival
        return None

    def _arrived(self, wake: int) -> Arrival | None:
        while (picture := next(self._whole, None)) is None:
            if not self._fill(wake):
                return None
        self._frame_s = time.monotonic()
        self.frames += 1
        is_split = self._pauses is not None and self._pauses.is_split()
        if self._pauses is not None and self._pauses.doubt == MOST_DOUBT:
            raise FormatError(
                f"pauses in the midst of frames, {MOST_DOUBT} times: they have another size than camera.source.width x "
                "height, or another format"
            )
        arrival_ns, time_ns = self._arrival_ns, None
        if self.run.times is not None and (time_ns := self._time(wake)) is None:
            return None
        return Arrival(picture, arrival_ns, time_ns, is_split)

    def _fill(self, wake: int) -> bool:
        """Wait for bytes of frames and cut them; False once `wake` can be read."""
        waiting_s = time.monotonic()
        while True:
            ready = self._ready(self._frame_s + self._silent_s)
            if wake in ready:
                return False
            if not ready:
                part = f", {self.held} bytes of one" if self.held else ""
                raise FormatError(f"gives no frame in {self._silent_s:g} s{part}")
            if self.run.frames in ready:
                break
            if self.run.is_over:  # and what it wrote has been read: another process may hold the pipe
                raise StreamEndedError
        if self._pauses is not None:
            self._pauses.waited(
                time.monotonic() - waiting_s, self._cutter.held, self._count >= _FULL * self.run.pipe_bytes
            )
        self._count = count = os.readv(self.run.frames, [self._buffer])
        if not count:
            raise StreamEndedError
        self._arrival_ns = self._clock()
        self._whole = self._cutter.feed(memoryview(self._buffer)[:count])
        return True

    def _time(self, wake: int) -> int | None:
        """The time of the frame that came last; None once `wake` can be read."""
        end_s = time.monotonic() + _LINE_S
        self._poll.modify(self.run.frames, 0)  # it waits
        try:
            while (time_ns := self._lines.next_ns()) is None:
                ready = self._ready(end_s)
                if wake in ready:
                    return None
                if not ready or self.run.is_over:
                    raise FormatError(f"writes no time of its frame {self.frames} within {_LINE_S:g} s to descriptor 3")
            return time_ns
        finally:
            self._poll.modify(self.run.frames, select.POLLIN)

    def _ready(self, end_s: float) -> set[int]:
        """Which descriptors can be read, none once the time is over; words and times are taken up."""
        ready = {fd for fd, _ in self._poll.poll(max(0.0, end_s - time.monotonic()) * 1000.0)}
        if self.run.said in ready and not self.run.hear():
            self._poll.unregister(self.run.said)
        if self.run.times is not None and self.run.times in ready:
            if said := os.read(self.run.times, 4096):
                self._lines.feed(said)
            else:
                self._poll.unregister(self.run.times)
        return ready
