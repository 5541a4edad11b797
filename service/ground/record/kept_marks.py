"""The marks of this ground over a restart: `marks.json` beside the record, if one is kept."""

import contextlib
import os
import threading
from collections.abc import Callable, Sequence
from pathlib import Path

import msgspec

from distloc.backports import Self
from service.common.files import write_whole
from service.ground.picture.marks import MOST_MARKS, Mark

_MOST_BYTES = 1_000 * MOST_MARKS
_LOOK_S = 5.0  # so often a disk that failed is tried again, and a file that is gone is missed


class KeptMarks:
    """Reads what it can and writes what it may, on a thread of its own in a `with`: no disk holds up the picture.

    `fault` is why the latest marks are not on the disk. What is written is always the latest, never a queue.
    """

    def __init__(self, folder: Path | None, write: Callable[[Path, bytes], None] | None = None) -> None:
        self._path = None if folder is None else folder / "marks.json"
        self._write = write or (lambda path, data: write_whole(path, data, is_durable=True))
        self.fault = ""
        self._latest: tuple[Mark, ...] = ()
        self._kept: tuple[Mark, ...] = ()
        self._file: os.stat_result | None = None  # as it was left
        self._changed = threading.Condition()
        self._is_closing = False
        self._thread = threading.Thread(target=self._run, name="marks", daemon=True)

    def read(self) -> list[Mark]:
        """Those that are kept; none where the file is missing or no such file."""
        if self._path is None:
            return []
        with contextlib.suppress(OSError, msgspec.MsgspecError, RecursionError):
            if self._path.stat().st_size <= _MOST_BYTES:
                found = msgspec.json.decode(self._path.read_bytes(), type=list[Mark])
                self._latest = self._kept = tuple(found)
                self._file = self._path.stat()
                return found
        return []

    def write(self, marks: Sequence[Mark]) -> None:
        """Have all of them written, durably."""
        with self._changed:
            self._latest = tuple(marks)
            self._changed.notify_all()

    def __enter__(self) -> Self:
        if self._path is not None:
            self._thread.start()
        return self

    def __exit__(self, *_exception: object) -> None:
        """The latest are tried once more."""
        if self._path is None:
            return
        with self._changed:
            self._is_closing = True
            self._changed.notify_all()
        self._thread.join()

    def _run(self) -> None:
        assert self._path is not None
        while True:
            with self._changed:
                if self.fault:
                    self._changed.wait_for(lambda: self._is_closing, _LOOK_S)
                else:
                    self._changed.wait_for(lambda: self._is_closing or self._latest is not self._kept, _LOOK_S)
                latest, is_last = self._latest, self._is_closing
            if latest and (latest is not self._kept or not self._is_there()):
                self._keep(self._path, latest)
            if is_last:
                return

    def _keep(self, path: Path, marks: tuple[Mark, ...]) -> None:
        try:
            self._write(path, msgspec.json.encode(marks))
            self._kept, self._file = marks, path.stat()
            self.fault = ""
        except OSError as error:
            self.fault = error.strerror or str(error)

    def _is_there(self) -> bool:
        """Whether the file is the one that was written: its folder may have gone, and come back without it."""
        assert self._path is not None
        try:
            return self._file is not None and os.path.samestat(self._file, self._path.stat())
        except OSError:
            return False
