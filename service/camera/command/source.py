"""The source of a command's frames: starts it, reads it on the camera's thread, starts it again when it is lost."""

import logging
import os
import shutil
import threading
import time
from collections.abc import Callable

from distloc.geometry.camera import Camera
from service.camera.command.cutting import cutter_of
from service.camera.command.pauses import PauseWatch
from service.camera.command.pictures import FormatError, Layout, PictureError
from service.camera.command.run import Ended, Run
from service.camera.command.stream import Arrival, Stream, StreamEndedError
from service.camera.command.times import FrameClock
from service.camera.retries import Retries
from service.camera.source import Clock, Closing, SourceError
from service.camera.thinning import Thinning
from service.common.messages import Frame
from service.common.redact import redacted
from service.config.sections import SourceConfig

log = logging.getLogger(__name__)

_RAW = ("bgr", "nv12", "i420")
_SILENT_S = 10.0  # without a frame it is started again; or 3 of the periods asked for, where these are longer
_STEADY_S = 2.0  # one that ran for so long is started again soon; one that dies at once later and later
_TELL_S = 60.0  # the same trouble is told once in so long


class CommandSource(Closing):
    """Frames of a process, in the format that is configured; only `close` ends it.

    They are stamped with the clock (CLOCK_MONOTONIC) at their arrival, or with the time that the process writes of
    each, less `latency_ms`. One that is lost before its first frame raises SourceError, unless `is_awaited`: then, and
    later, it is started again after growing, jittered delays. `wait` (True once closed) can be replaced in tests.
    """

    def __init__(
        self,
        config: SourceConfig,
        camera: Camera,
        clock: Clock = time.monotonic_ns,
        is_awaited: bool = False,
        wait: Callable[[float], bool] | None = None,
        retries: Retries | None = None,
    ) -> None:
        super().__init__(camera)
        self.starts = 0
        self._config, self._size, self._clock, self._is_awaited = config, camera, clock, is_awaited
        self._latency_ns = round(config.latency_ms * 1e6)
        self._thinning, self._retries = Thinning(config.fps), retries or Retries()
        self._closed = threading.Event()
        self._wait = wait or self._closed.wait
        self._reading = threading.Lock()  # the process is ended by who reads it, or between two reads
        self._stream: Stream | None = None
        self._times: FrameClock | None = None
        self._number = 0
        self._told, self._told_s, self._is_told_lost, self._is_flood_told = "", 0.0, False, False
        if not is_awaited and shutil.which(config.command[0]) is None:
            raise SourceError(f"camera.source.command[0] is {config.command[0]!r}: no such program, or it may not run")
        self._wake, self._waker = os.pipe()

    def read(self) -> Frame | None:
        """The next frame, starting the command (again) if need be; None once closed."""
        with self._reading:
            while not self._closed.is_set():
                try:
                    stream = self._stream = self._stream or self._started()
                    arrival = stream.next(self._wake)
                except StreamEndedError:
                    self._lose(None)
                except FormatError as error:
                    self._lose(str(error))
                except OSError as error:
                    self._lose(f"cannot be started: {error.strerror}")
                else:
                    if arrival is not None and (frame := self._frame(arrival)) is not None:
                        return frame
        return None

    def close(self) -> None:
        """End, and with it the process and all that came of it."""
        if self._closed.is_set():
            return
        self._closed.set()
        os.write(self._waker, b"\0")
        with self._reading:
            self._end()
            os.close(self._waker)
            os.close(self._wake)

    def _started(self) -> Stream:
        config, camera = self._config, self._size
        size_px = config.width or camera.width, config.height or camera.height
        cutter = cutter_of(config.format, size_px, camera.width * camera.height)
        pauses = PauseWatch(Layout(config.format).bytes_of(size_px)) if config.format in _RAW else None
        has_times = config.times != "arrival"
        self._times = FrameClock(config.times) if has_times else None
        self.starts += 1
        return Stream(
            Run(config.command, has_times), cutter, pauses, self._clock, max(_SILENT_S, 3.0 / self._config.fps)
        )

    def _frame(self, arrival: Arrival) -> Frame | None:
        """What is due and can be used."""
        self._tell_found()
        self._tell_flood()
        try:
            stamp_ns = arrival.arrival_ns
            if self._times is not None and arrival.time_ns is not None:
                stamp_ns = self._times.stamp_ns(arrival.time_ns, arrival.arrival_ns)
            stamp_ns -= self._latency_ns
            if arrival.is_split:
                raise PictureError("it paused in its midst, as where a part is lost or camera.source.width is wrong")
            if not self._thinning.takes(stamp_ns) or not self._accepts_size(arrival.picture.size_px):
                return None
            image = arrival.picture.decoded(self._config.decode_width)
        except PictureError as error:
            self._refuse(str(error))
            return None
        self._number += 1
        return Frame(stamp_ns, f"{self._number:06d}", image) if self._accepts(image) else None

    def _lose(self, fault: str | None) -> None:
        """End what is left of a run; say why it is lost, and wait until the next. None: it ended by itself."""
        stream, ended = self._stream, self._end(has_ended=fault is None)
        if self._closed.is_set():
            return
        is_steady = stream is not None and stream.frames > 0 and time.monotonic() - stream.began_s >= _STEADY_S
        if is_steady:
            self._retries.reset()
        said = f"camera.source.command, {redacted(self._config.command[0])}: "
        if ended is not None:
            self._is_flood_told |= ended.is_flood
            said += _described(fault, ended, stream)
        else:
            said += str(fault)
        if not self._is_awaited and not self._number:
            raise SourceError(said)
        delay_s = self._retries.next_s()
        self._tell_lost(fault or str(ended and ended.why), f"{said}; it is started again, in {delay_s:.1f} s")
        self._wait(delay_s)

    def _tell_lost(self, kind: str, line: str) -> None:
        now_s = time.monotonic()
        if kind == self._told and now_s - self._told_s < _TELL_S:
            return
        self._told, self._told_s, self._is_told_lost = kind, now_s, True
        log.warning("%s", line)

    def _tell_found(self) -> None:
        stream = self._stream
        if stream is not None and self._is_told_lost and time.monotonic() - stream.began_s >= _STEADY_S:
            self._is_told_lost = False
            log.info("camera.source.command, %s: gives frames again", redacted(self._config.command[0]))

    def _tell_flood(self) -> None:
        if self._stream is not None and self._stream.run.is_flood and not self._is_flood_told:
            self._is_flood_told = True
            said = "floods its error output, over 1 MB a second: make it quieter"
            log.warning("camera.source.command, %s: %s", redacted(self._config.command[0]), said)

    def _end(self, has_ended: bool = False) -> Ended | None:
        stream, self._stream = self._stream, None
        return stream.run.end(has_ended) if stream is not None else None


def _described(fault: str | None, ended: Ended, stream: Stream | None) -> str:
    """What went wrong with a run, in words."""
    if fault or not ended.is_started:
        return ended.with_words(fault or ended.why)
    frames, held = (stream.frames, stream.held) if stream is not None else (0, 0)
    return ended.with_words(f"{ended.why} after {frames} frames" + (f", {held} bytes into the next" if held else ""))
