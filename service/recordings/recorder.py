"""Writes a recording while flying: MAVLink frames heard and sent, camera frames, config.

A thread of its own; the service goes on whatever happens to the disk, and what failed is tried again.
"""

import contextlib
import logging
import os
import queue
import struct
import threading
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, BinaryIO, TextIO

import cv2
import numpy as np
from numpy.typing import NDArray

from service.common.files import write_whole
from service.recordings.flights import Flights

_log = logging.getLogger(__name__)

Image = NDArray[np.uint8]
QUEUE_TELEMETRY = 4096  # several seconds at 500 messages/s
QUEUE_FRAMES = 4  # full HD is 6 MB each
JPEG_QUALITY = 90
FLUSH_PERIOD_S = 0.25  # what a killed process loses of the telemetry; a thread woken for each message doubles its cost
CLOSE_TIMEOUT_S = 5.0
RETRY_PERIOD_S = 5.0
HUNG_NS = 3_000_000_000  # a disk that takes so long takes nothing
TIDY_PERIOD_NS = 10_000_000_000
LONGEST_ROW = 4096

_STAMP = struct.Struct(">Q")


class Recorder:
    """A recording in a flight's folder of its own below the one given to `open`; a new try goes on in the same one.

    `state` is closed, recording, hung: since when, or stopped: why, until the next try.

    Stamps are the host's nanoseconds; they are written as microseconds with `unix_offset_ns` added, fixed at `open`
    (by default what turns CLOCK_MONOTONIC into UTC). When the queue is full the newest is dropped and counted.
    """

    def __init__(
        self,
        unix_offset_ns: int | None = None,
        save_frames: bool = True,
        keep_flights: int = 50,
        least_free_gb: float = 0.0,
        clock: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        self._state = "closed"
        self.written = 0
        self.dropped = 0
        self.errors = 0
        self._has_failed = False
        self._beat_ns = 0  # when the thread last had the disk's answer
        self._tidy_ns = 0
        self._clock = clock
        self._unix_offset_ns = unix_offset_ns
        self._offset_ns = 0
        self._save_frames = save_frames
        self._telemetry: queue.Queue[tuple[int, bytes]] = queue.Queue(QUEUE_TELEMETRY)
        self._frames: queue.Queue[tuple[int, str, Image]] = queue.Queue(QUEUE_FRAMES)
        self._wake = threading.Event()
        self._closing = False
        self._thread: threading.Thread | None = None
        self._flights = Flights(Path(), keep_flights, least_free_gb * 1e9)
        self._device: int | None = None
        self._templates: Mapping[str, bytes] = {}

    @property
    def is_lost(self) -> bool:
        """Whether what should be recorded is not: the disk refuses it, or has not answered for 3 s."""
        return self._has_failed or self._hung_s() > 0.0

    @property
    def state(self) -> str:
        """For the status: what the thread does, or that it waits for the disk."""
        hung_s = self._hung_s()
        return f"hung: the disk has not answered for {hung_s:.0f} s" if hung_s else self._state

    @property
    def counters(self) -> dict[str, int | float | str | None]:
        """For the status message."""
        return {
            "recorder_state": self.state,
            "recorder_written": self.written,
            "recorder_dropped": self.dropped,
            "recorder_errors": self.errors,
            "recorder_flight": None if (flown := self._flights.flown) is None else flown.name,
        }

    def open(self, folder: Path | str, config_toml_text: str, templates: Mapping[str, bytes] | None = None) -> None:
        """Start writing to a new flight below `folder`; where that fails the state says so and nothing is raised.

        `templates` are the pictures of the config's landmarks, by their names.
        """
        if self._thread is not None:
            raise ValueError("the recorder is open already: close it first")
        now_offset_ns = time.time_ns() - time.monotonic_ns()
        offset_ns = now_offset_ns if self._unix_offset_ns is None else self._unix_offset_ns
        self._offset_ns = max(0, offset_ns)  # a clock set before this boot's 1970 would give all the same stamp
        self._flights.parent, self._flights.flown, self._device = Path(folder), None, None
        self._closing, self._templates = False, templates or {}
        self._beat_ns, self._tidy_ns = self._clock(), 0
        self._state = "recording"
        self._thread = threading.Thread(target=self._run, args=(config_toml_text,), name="recorder", daemon=True)
        self._thread.start()

    def telemetry(self, stamp_ns: int, raw: bytes) -> None:
        """Queue one whole MAVLink frame, heard or sent."""
        if self._state == "recording":
            self._put(self._telemetry, (stamp_ns, raw))
            if self._telemetry.qsize() > QUEUE_TELEMETRY // 2:
                self._wake.set()

    def frame(self, stamp_ns: int, name: str, image: Image | None) -> None:
        """Queue one camera frame for frames/`name`.jpg; the image must not be written to afterwards."""
        if self._state == "recording" and self._save_frames and image is not None:
            self._put(self._frames, (stamp_ns, name, image))
            self._wake.set()

    def close(self) -> None:
        """Write what is queued and close the files; gives up after CLOSE_TIMEOUT_S."""
        if self._thread is None:
            return
        self._closing = True
        self._wake.set()
        self._thread.join(CLOSE_TIMEOUT_S)
        self._thread = None
        if self._state == "recording":
            self._state = "closed"

    def _hung_s(self) -> float:
        """Seconds since the disk last answered, once it is too long; 0 while it answers or nothing is asked of it."""
        waited_ns = self._clock() - self._beat_ns
        return waited_ns * 1e-9 if self._state == "recording" and waited_ns > HUNG_NS else 0.0

    def _put(self, items: "queue.Queue[Any]", item: object) -> None:
        try:
            items.put_nowait(item)
        except queue.Full:
            self.dropped += 1

    def _run(self, config_toml_text: str) -> None:
        while True:
            try:
                return self._record(config_toml_text)
            except Exception as error:  # whatever it is, the flight goes on and the next try may do
                reason = str(error) or type(error).__name__
                if not self._has_failed:
                    _log.warning("recording stopped: %s", reason)
                self.errors += 1
                self._has_failed, self._state = True, f"stopped: {reason}"
                self._discard()
            self._wake.clear()
            if not self._closing:
                self._wake.wait(RETRY_PERIOD_S)
            if self._closing:
                return

    def _record(self, config_toml_text: str) -> None:
        with contextlib.ExitStack() as files:
            telemetry, rows = self._start(files, config_toml_text)
            self._beat_ns = self._clock()
            self._state, written = "recording", self.written
            while True:
                closing = self._closing
                self._drain(telemetry, rows)
                self._tidy()
                self._beat_ns = self._clock()
                # a file that opens may still not take a byte
                self._has_failed = self._has_failed and self.written == written
                if closing:
                    return
                self._wake.wait(FLUSH_PERIOD_S)
                self._wake.clear()

    def _start(self, files: contextlib.ExitStack, config_toml_text: str) -> tuple[BinaryIO, TextIO]:
        self._flights.make_room()
        flight = self._flights.begin((self._clock() + self._offset_ns) * 1e-9)
        (flight / "frames").mkdir(parents=True, exist_ok=True)
        device = flight.stat().st_dev
        if self._device not in (None, device):
            raise OSError(f"{flight} is on another disk than before: is it mounted?")
        self._device = device
        write_whole(flight / "config.toml", config_toml_text.encode())
        for name, picture in self._templates.items():
            (flight / "landmarks").mkdir(exist_ok=True)
            write_whole(flight / "landmarks" / f"{name}.png", picture)
        table = flight / "frames.csv"
        if table.exists():
            _cut_torn_row(table)
        telemetry = files.enter_context((flight / "telemetry.tlog").open("ab"))
        rows = files.enter_context(table.open("a", encoding="utf-8", newline=""))
        if rows.tell() == 0:
            rows.write("stamp_us,file\n")
            rows.flush()
        return telemetry, rows

    def _tidy(self) -> None:
        """Now and then make room, an old flight at a time: what is queued does not wait for more."""
        now_ns = self._clock()
        if now_ns >= self._tidy_ns and not self._flights.make_room():
            self._tidy_ns = now_ns + TIDY_PERIOD_NS

    def _drain(self, telemetry: BinaryIO, rows: TextIO) -> None:
        with contextlib.suppress(queue.Empty):
            for _ in range(QUEUE_TELEMETRY):
                stamp_ns, raw = self._telemetry.get_nowait()
                telemetry.write(_STAMP.pack(self._stamp_us(stamp_ns)) + raw)
                self.written += 1
        telemetry.flush()
        with contextlib.suppress(queue.Empty):
            for _ in range(QUEUE_FRAMES):
                stamp_ns, name, image = self._frames.get_nowait()
                rows.write(f"{self._stamp_us(stamp_ns)},{self._write_image(name, image)}\n")
                rows.flush()
                self.written += 1
                self._beat_ns = self._clock()
        if not self._flown().is_dir():
            raise FileNotFoundError(f"{self._flown()} is gone")
        if not (self._telemetry.empty() and self._frames.empty()):
            self._wake.set()

    def _flown(self) -> Path:
        assert self._flights.flown is not None
        return self._flights.flown

    def _stamp_us(self, stamp_ns: int) -> int:
        return max(0, (stamp_ns + self._offset_ns) // 1000)

    def _write_image(self, name: str, image: Image) -> str:
        """The file's name in frames/, once it lies there whole; a camera that counts anew replaces no picture."""
        is_encoded, jpeg = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])
        if not is_encoded:
            raise ValueError(f"{name} of shape {image.shape} could not be made a JPEG")
        path = self._flown() / "frames" / f"{Path(name).stem}.jpg"
        if path.exists():
            path = path.with_stem(f"{path.stem}-{self.written}")
        part = path.with_name(f".{path.name}.part")
        part.write_bytes(jpeg.tobytes())
        part.replace(path)
        return path.name

    def _discard(self) -> None:
        for items in (self._telemetry, self._frames):
            with contextlib.suppress(queue.Empty):
                while True:
                    items.get_nowait()
                    self.dropped += 1


def _cut_torn_row(table: Path) -> None:
    """A disk that was full may have cut the last row; the telemetry's reader passes over what is cut there."""
    with table.open("r+b") as file:
        start = max(0, file.seek(0, os.SEEK_END) - LONGEST_ROW)
        file.seek(start)
        file.truncate(start + file.read().rfind(b"\n") + 1)


class NullRecorder:
    """Recording switched off."""

    state = "off"
    is_lost = False

    @property
    def counters(self) -> dict[str, int | float | str | None]:
        """Nothing to count."""
        return {}

    def open(self, folder: Path | str, config_toml_text: str, templates: Mapping[str, bytes] | None = None) -> None:
        """Does nothing."""

    def telemetry(self, stamp_ns: int, raw: bytes) -> None:
        """Does nothing."""

    def frame(self, stamp_ns: int, name: str, image: Image | None) -> None:
        """Does nothing."""

    def close(self) -> None:
        """Does nothing."""
