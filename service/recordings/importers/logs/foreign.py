"""Runs parsers that others wrote on files that others wrote: no noise on the terminal, one line where one gives up."""

import contextlib
import os
import struct
from collections.abc import Iterator
from pathlib import Path

from service.recordings.importers.flight import ImportRefusedError

MOST_LOG_BYTES = 4_000_000_000  # of a log whose parser keeps an index, or all of it, in memory
_FAULTS = (
    *(ArithmeticError, AssertionError, AttributeError, EOFError, LookupError, MemoryError, OSError, RecursionError),
    *(TypeError, ValueError, struct.error),
)


@contextlib.contextmanager
def parsing(path: Path, kind: str) -> Iterator[None]:
    """What the parser prints is dropped; whatever it fails with becomes ImportRefusedError."""
    if (size := path.stat().st_size) > MOST_LOG_BYTES:
        raise ImportRefusedError(f"{path}: has {size * 1e-9:.1f} GB, {MOST_LOG_BYTES * 1e-9:.0f} GB are taken: cut it")
    try:
        with (
            open(os.devnull, "w", encoding="utf-8") as nowhere,
            contextlib.redirect_stdout(nowhere),
            contextlib.redirect_stderr(nowhere),
        ):
            yield
    except _FAULTS as error:
        reason = " ".join(str(error).split())[:120] or type(error).__name__
        raise ImportRefusedError(f"{path}: cannot be read as {kind}: {reason}") from error
