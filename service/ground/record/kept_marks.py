"""The marks of this ground over a restart: `marks.json` beside the record, if one is kept."""

import contextlib
from collections.abc import Sequence
from pathlib import Path

import msgspec

from service.common.files import write_whole
from service.ground.picture.marks import MOST_MARKS, Mark

_MOST_BYTES = 1_000 * MOST_MARKS


class KeptMarks:
    """Reads what it can and writes what it may: no disk ends the picture. `fault` is why the last was not written."""

    def __init__(self, folder: Path | None) -> None:
        self._path = None if folder is None else folder / "marks.json"
        self.fault = ""

    def read(self) -> list[Mark]:
        """Those that are kept; none where the file is missing or no such file."""
        if self._path is None:
            return []
        with contextlib.suppress(OSError, msgspec.MsgspecError, RecursionError):
            if self._path.stat().st_size <= _MOST_BYTES:
                return msgspec.json.decode(self._path.read_bytes(), type=list[Mark])
        return []

    def write(self, marks: Sequence[Mark]) -> None:
        """All of them, durably."""
        if self._path is None:
            return
        try:
            self._path.parent.mkdir(parents=True, exist_ok=True)
            write_whole(self._path, msgspec.json.encode(list(marks)), is_durable=True)
            self.fault = ""
        except OSError as error:
            self.fault = error.strerror or str(error)
