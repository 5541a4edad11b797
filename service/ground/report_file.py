"""The file of `distloc ground --out`: whole lines or none, whatever the disk does."""

import contextlib
import os
from pathlib import Path

from distloc.backports import Self


class ReportFile:
    """Appends lines; `fault` is why the last one could not be written, None if it was. OSError on construction."""

    def __init__(self, path: Path) -> None:
        self.fault: str | None = None
        self._is_open = True
        self._file = path.open("ab", buffering=0)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_exception: object) -> None:
        self._is_open = False
        with contextlib.suppress(OSError):
            self._file.close()

    def append(self, line: bytes) -> bool:
        """Write a line; whether `fault` is another than before. What was written of half a line is taken away."""
        before = self.fault
        if not self._is_open:  # one of zenoh's threads may still bring a report while the station ends
            return False
        handle = self._file.fileno()
        size = os.fstat(handle).st_size
        try:
            written = self._file.write(line + b"\n")
            if written != len(line) + 1:
                raise OSError(0, "only a part of a line could be written")
            self.fault = None
        except OSError as error:
            self.fault = error.strerror or str(error)
            with contextlib.suppress(OSError):
                os.ftruncate(handle, size)
        return self.fault != before
