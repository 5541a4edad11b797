"""Writes an imported flight as a recording's folder, which appears once it is complete; `distloc import` calls it."""

import contextlib
import os
import re
import shutil
from collections.abc import Iterator
from itertools import compress
from pathlib import Path

from service.recordings.importers.flight import Film, ImportedFlight, ImportRefusedError, Stills
from service.recordings.importers.output.telemetry import clock_of, records

_MOST_STILLS = 1_000_000
_LONGEST_NAME = 150


@contextlib.contextmanager
def whole_folder(out: Path) -> Iterator[Path]:
    """A folder beside `out` that becomes it once it was written without an error; nothing half-written stays."""
    if os.path.lexists(out):
        raise ImportRefusedError(f"--out {out}: exists already: give another name, or remove it")
    part = out.with_name(f".{out.name}.{os.getpid()}.part")
    try:
        part.mkdir(parents=True)
    except OSError as error:
        raise ImportRefusedError(f"--out {out}: no folder can be made there: {error.strerror}") from error
    try:
        yield part
        os.replace(part, out)
    except OSError as error:
        raise ImportRefusedError(f"--out {out}: cannot be written: {error.strerror or error}") from error
    finally:
        shutil.rmtree(part, ignore_errors=True)


def write_recording(folder: Path, flight: ImportedFlight, clock_sigma_s: float | None) -> None:
    """Telemetry and frames of a complete flight, whose poses have been resampled."""
    clock = clock_of(flight)
    with (folder / "telemetry.tlog").open("wb") as file:
        for stamp_us, frame in records(flight, clock, clock_sigma_s):
            file.write(stamp_us.to_bytes(8, "big") + frame)
    if flight.frames is not None:
        stamps_us = clock.stamps_us(flight.frames.time_s)
        names = _put_frames(folder, flight.frames)
        rows = list(zip(stamps_us, names, strict=True))
        if isinstance(flight.frames, Film) and flight.frames.is_used is not None:
            rows = list(compress(rows, flight.frames.is_used))
        _write_table(folder / "frames.csv", rows, flight)


def _put_frames(folder: Path, frames: Film | Stills) -> list[str]:
    """Link or copy the pictures in; their names in the table."""
    if isinstance(frames, Film):
        put(frames.path, folder / "video.mp4")
        return [str(number) for number in range(len(frames.time_s))]
    if len(frames.paths) > _MOST_STILLS:
        raise ImportRefusedError(f"{frames.paths[0].parent}: more than {_MOST_STILLS} pictures")
    (folder / "frames").mkdir()
    names = []
    for number, path in enumerate(frames.paths):
        plain = re.sub(r"[^A-Za-z0-9._-]", "_", path.stem)[-_LONGEST_NAME:]
        names.append(f"{number:06d}-{plain}{path.suffix.lower()}")
        put(path, folder / "frames" / names[-1])
    return names


def put(source: Path, target: Path) -> None:
    """A hard link where the disk has one, else a copy: a replay follows no link that leads out of its folder."""
    source = source.resolve()
    with contextlib.suppress(OSError):
        os.link(source, target)
        return
    shutil.copyfile(source, target)


def _write_table(path: Path, rows: list[tuple[int, str]], flight: ImportedFlight) -> None:
    last_us, repeated = -1, 0
    with path.open("w", encoding="utf-8", newline="") as file:
        file.write("stamp_us,file\n")
        for stamp_us, name in sorted(rows):
            if stamp_us == last_us:
                repeated += 1
                continue
            file.write(f"{stamp_us},{name}\n")
            last_us = stamp_us
    if repeated:
        flight.remarks.dropped["frame: taken at the same time as another"] = repeated
