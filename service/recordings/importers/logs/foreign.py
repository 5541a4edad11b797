"""Runs parsers that others wrote on files that others wrote: no noise on the terminal, one line where one gives up."""

import contextlib
import os
from collections.abc import Iterator
from pathlib import Path

from service.recordings.importers.flight import ImportRefusedError

MOST_LOG_BYTES = 4_000_000_000  # of a log whose parser keeps an index, or all of it, in memory


@contextlib.contextmanager
def parsing(path: Path, kind: str) -> Iterator[None]:
    """What the parser prints is dropped; whatever it fails with becomes ImportRefusedError."""
    if (size := path.stat().st_size) > MOST_LOG_BYTES:
        raise ImportRefusedError(f"{path}: has {size * 1e-9:.1f} GB, {MOST_LOG_BYTES * 1e-9:.0f} GB are taken: cut it")
    try:
        with _silenced():
            yield
    except ImportRefusedError:
        raise
    except Exception as error:  # parsers of others raise Exception itself
        reason = " ".join(str(error).split())[:120] or type(error).__name__
        raise ImportRefusedError(f"{path}: cannot be read as {kind}: {reason}") from error


@contextlib.contextmanager
def _silenced() -> Iterator[None]:
    """Also what is printed below Python: an indexer in C has a line for each bad byte."""
    with open(os.devnull, "w", encoding="utf-8") as nowhere, contextlib.ExitStack() as kept:
        kept.enter_context(contextlib.redirect_stdout(nowhere))
        kept.enter_context(contextlib.redirect_stderr(nowhere))
        for number in (1, 2):
            copy = os.dup(number)
            kept.callback(os.close, copy)
            kept.callback(os.dup2, copy, number)
            os.dup2(nowhere.fileno(), number)
        yield
