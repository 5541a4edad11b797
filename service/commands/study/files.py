"""What the `study` commands share: tables as files, and plots if there is matplotlib."""

import csv
import io
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from service.commands.errors import MissingExtraError, OutputError
from service.common.files import write_whole


def write_json(path: Path, rows: Any) -> None:
    """Indented, with null for what is not a number."""
    write_whole(path, msgspec.json.format(msgspec.json.encode(rows), indent=1) + b"\n")


def write_csv(path: Path, rows: Sequence[Mapping[str, Any]]) -> None:
    """One line a row under the first row's keys; empty where there is no value."""
    text = io.StringIO()
    writer = csv.DictWriter(text, fieldnames=list(rows[0]), lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    write_whole(path, text.getvalue().encode())


def prepared(out: Path) -> None:
    """Make the folder before the work; OutputError, one line, where that fails."""
    try:
        out.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=out):
            pass
    except OSError as error:
        raise OutputError(f"--out {out}: must be a folder that can be written: {error.strerror}") from error


def load_plots() -> Any:
    """The module that draws; MissingExtraError, one line, where matplotlib is not installed."""
    try:
        from distloc.study import plots
    except ModuleNotFoundError as error:
        if error.name is None or not error.name.startswith("matplotlib"):
            raise
        raise MissingExtraError(
            "the study draws with matplotlib, which is not installed: pip install '.[study]'"
        ) from error
    return plots


def rounded(value: float | np.float64 | None, digits: int) -> float | None:
    """For a file: None for what is not a number."""
    return None if value is None or not np.isfinite(value) else round(float(value), digits)


def cell(value: float | None, width: int, digits: int) -> str:
    """For a table on the screen: right-aligned, a dash for what is not a number."""
    return f"{'-':>{width}}" if value is None or not np.isfinite(value) else f"{value:>{width}.{digits}f}"
