"""What arrived, kept on disk: a line of JSON each, one file a day, each line on the disk before it is told as recorded.

A process that is killed loses what was not told of yet, and leaves half a line at most, which the reader passes over.
"""

import contextlib
import itertools
import os
import threading
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from datetime import datetime, timezone
from pathlib import Path
from typing import BinaryIO

import msgspec

from distloc.backports import Self
from service.common.files import sync_folder
from service.ground.inbox import Heard
from service.ground.record.pictures import Pictures

NAME = "ground-{:%Y-%m-%d}.jsonl"
PATTERN = "ground-????-??-??.jsonl"
MOST_WAITING = 20_000
MOST_LINE_BYTES = 1_500_000  # a picture in base64; a report has 2 kB
_RETRY_S = 5.0
_END_S = 32_503_680_000.0  # the year 3000: a later time is no ground's


class Line(msgspec.Struct, frozen=True, omit_defaults=True):
    """When a message arrived (seconds since 1970), its key, and its JSON, its JPEG or whether the drone was there."""

    t: float
    key: str
    body: msgspec.Raw = msgspec.Raw()
    alive: bool | None = None
    jpeg: bytes = b""


_NO_LINE = Line(-1.0, "")


def line_of(heard: Heard) -> bytes | None:
    """One line with its end; None for what is no JSON, nor a picture."""
    if heard.payload is None or heard.payload == b"":
        return msgspec.json.encode(Line(heard.arrived_s, heard.key, alive=heard.payload is not None)) + b"\n"
    if heard.key.endswith("/preview"):
        return msgspec.json.encode(Line(heard.arrived_s, heard.key, jpeg=heard.payload)) + b"\n"
    try:
        body = msgspec.Raw(msgspec.json.format(heard.payload, indent=-1))  # on one line
    except (msgspec.MsgspecError, RecursionError):
        return None
    return msgspec.json.encode(Line(heard.arrived_s, heard.key, body)) + b"\n"


@dataclass(slots=True)
class Foreign:
    """Lines of a file that are none of a record's: how many, and the number of the first."""

    count: int = 0
    first: int = 0

    def add(self, number: int) -> None:
        self.count, self.first = self.count + 1, self.first or number


def read(path: Path, foreign: Foreign | None = None) -> Iterator[Heard]:
    """The messages of a file in the order of their arrival; what is no line of ours is `foreign`. OSError."""
    decoder = msgspec.json.Decoder(Line)
    with path.open("rb") as file:
        for number in itertools.count(1):
            raw = file.readline(MOST_LINE_BYTES)
            if not raw:
                return
            try:
                line = decoder.decode(raw)
            except (msgspec.MsgspecError, RecursionError):
                line = _NO_LINE
            if not 0.0 <= line.t < _END_S:
                if foreign is not None:
                    foreign.add(number)
                continue
            payload = line.jpeg or bytes(line.body) or (b"" if line.alive else None)
            yield Heard(line.key, payload, line.t, "")


class NoRecorder:
    """Nothing is recorded."""

    recorded_s: float | None = None
    fault = ""
    lost = 0

    def extend(self, batch: Sequence[Heard]) -> None:
        """Does nothing."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_exception: object) -> None:
        """Does nothing."""


class Recorder:
    """Writes on a thread of its own. All that arrived until `recorded_s` is on the disk; `fault` is why no more is.

    But for `lost` messages: the oldest go when the disk took nothing for so long that 20,000 waited.
    """

    def __init__(self, folder: Path, most_bytes: int, sync: Callable[[int], None] = os.fsync) -> None:
        self.recorded_s: float | None = None
        self.fault = ""
        self.lost = 0
        self._folder, self._most_bytes, self._sync = folder, most_bytes, sync
        self._waiting: deque[Heard] = deque()
        self._pictures = Pictures(most_bytes)
        self._changed = threading.Condition()
        self._is_closing = False
        self._file: BinaryIO | None = None
        self._thread = threading.Thread(target=self._run, name="record", daemon=True)

    def append(self, heard: Heard) -> None:
        """Have it written."""
        self.extend([heard])

    def extend(self, batch: Sequence[Heard]) -> None:
        """Have them written together, in whatever order they arrived; all that come later arrived after them.

        Few pictures are.
        """
        with self._changed:
            waiting = len(self._waiting)
            self._waiting.extend(one for one in batch if self._pictures.is_due(one, waiting))
            self._bound()
            self._changed.notify_all()

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_exception: object) -> None:
        with self._changed:
            self._is_closing = True
            self._changed.notify_all()
        self._thread.join()

    def _run(self) -> None:
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._waiting or self._is_closing)
                batch = list(self._waiting)
                self._waiting.clear()
                is_last = self._is_closing
            try:
                self._write(batch)
                self.recorded_s = max((one.arrived_s for one in batch), default=self.recorded_s)
                batch = []
                self._prune()
                self.fault = ""
            except OSError as error:
                self.fault = error.strerror or str(error)
                with self._changed:
                    self._waiting.extendleft(reversed(batch))
                    self._bound()
                    self._changed.wait_for(lambda: self._is_closing, _RETRY_S)
            if is_last:
                break
        if self._file is not None:
            self._file.close()

    def _bound(self) -> None:
        while len(self._waiting) > MOST_WAITING:
            self._waiting.popleft()
            self.lost += 1

    def _write(self, batch: list[Heard]) -> None:
        for name, lines in _by_day(batch):
            path = self._folder / name
            if self._file is None or not _is_at(self._file, path):
                self._open(path)
            assert self._file is not None
            size = self._file.seek(0, os.SEEK_END)
            try:
                if size + len(lines) > self._most_bytes:
                    raise OSError(0, f"{path.name} has the {self._most_bytes / 1e9:g} GB that the record may take")
                if self._file.write(lines) != len(lines):
                    raise OSError(0, "only a part could be written")
                self._sync(self._file.fileno())
            except OSError:
                with contextlib.suppress(OSError):
                    self._file.truncate(size)
                raise

    def _open(self, path: Path) -> None:
        if self._file is not None:
            self._file.close()
            self._file = None
        file = path.open("a+b", buffering=0)
        end = file.seek(0, os.SEEK_END)
        if end:
            file.seek(end - 1)
            if file.read(1) != b"\n":
                file.write(b"\n")  # after half a line of one that was killed
        sync_folder(path.parent)
        self._file = file

    def _prune(self) -> None:
        files = sorted(self._folder.glob(PATTERN))
        total = sum(one.stat().st_size for one in files)
        while total > self._most_bytes and len(files) > 1:
            oldest = files.pop(0)
            total -= oldest.stat().st_size
            oldest.unlink()


def _is_at(file: BinaryIO, path: Path) -> bool:
    """Whether the open file still is the one of this name: somebody may have moved it, or the whole folder."""
    try:
        return os.path.samestat(os.fstat(file.fileno()), path.stat())
    except OSError:
        return False


def _by_day(batch: list[Heard]) -> Iterator[tuple[str, bytes]]:
    """The file's name and the lines that belong there, in their order."""
    name, lines = "", list[bytes]()
    for heard in batch:
        line = line_of(heard)
        if line is None:
            continue
        day = NAME.format(datetime.fromtimestamp(heard.arrived_s, timezone.utc))
        if day != name and lines:
            yield name, b"".join(lines)
            lines = []
        name = day
        lines.append(line)
    if lines:
        yield name, b"".join(lines)
