"""Reads a folder of frames: when they were taken by its frames.csv, else by their names, else by none.

For pictures that hold no times of their own; those with EXIF go to the readers of stills.
"""

import math
import re
from calendar import timegm
from pathlib import Path

import numpy as np

from distloc.types import FloatArray
from service.common.files import IMAGE_SUFFIXES, FileRefusedError, read_picture
from service.recordings.importers.flight import Given, ImportedFlight, ImportRefusedError, Lens, Remarks, Stills
from service.recordings.importers.rows import count
from service.recordings.sightings.reading import SightingsError, read_table

MOST_PICTURES = 1_000_000
_UNIX = re.compile(r"(?<!\d)(1\d{9})(?:[._-]?(\d{3,9}))?(?!\d)")  # seconds since 2001, and their fraction
_CALENDAR = re.compile(
    r"(?<!\d)(20\d\d)-?(\d\d)-?(\d\d)[T _-]?(\d\d)[-_:]?(\d\d)[-_:]?(\d\d)(?:[._-]?(\d{1,9}))?(?!\d)"
)
_MOST_STAMP_S = 4.1e9


def read_frame_folder(path: Path, given: Given) -> ImportedFlight:
    """The pictures and their times. ImportRefusedError where none can be used."""
    remarks = Remarks()
    if (path / "frames.csv").is_file():
        paths, times_s = _by_table(path, remarks)
        how = "frames.csv"
    else:
        paths = sorted(_pictures(path))
        times_s, how = _by_names(paths, given, remarks)
    if not paths:
        raise ImportRefusedError(f"{path}: holds no picture that can be used")
    lens = _size(paths)
    remarks.found.append(f"{len(paths)} pictures, {lens.width} x {lens.height}, their times by {how}")
    is_timed = bool(np.isfinite(times_s).all())
    epoch_s = math.floor(float(times_s.min())) if is_timed else None
    return ImportedFlight(
        path.name,
        epoch_s,
        lens=lens,
        frames=Stills(paths, times_s - epoch_s if epoch_s is not None else times_s),
        frames_tied=is_timed,
        remarks=remarks,
    )


def _pictures(folder: Path) -> list[Path]:
    found: list[Path] = []
    for one in folder.iterdir():
        if one.suffix.lower() in IMAGE_SUFFIXES and not one.name.startswith(".") and one.is_file():
            found.append(one)
            if len(found) > MOST_PICTURES:
                raise ImportRefusedError(f"{folder}: more than {MOST_PICTURES} pictures")
    return found


def _by_table(folder: Path, remarks: Remarks) -> tuple[list[Path], FloatArray]:
    try:
        table = read_table(folder / "frames.csv", "frames")
    except SightingsError as error:
        raise ImportRefusedError(str(error)) from error
    if "stamp_us" not in table.columns or not {"file", "frame"} & set(table.columns):
        raise ImportRefusedError(
            f"{table.path}: the header must be stamp_us,file and is {','.join(table.columns)[:80]}"
        )
    rows: dict[float, Path] = {}
    for record in table.records:
        stamp, name = record.cells.get("stamp_us", ""), record.cells.get("file") or record.cells.get("frame", "")
        if not (stamp.isascii() and stamp.isdigit() and int(stamp) * 1e-6 < _MOST_STAMP_S):
            count(remarks, "frames.csv: no stamp in microseconds")
            continue
        found = _named(folder, name)
        if found is None:
            count(remarks, "frames.csv: no such picture in the folder")
            continue
        if int(stamp) * 1e-6 in rows:
            count(remarks, "frames.csv: stamp repeated")
            continue
        rows[int(stamp) * 1e-6] = found
    return [rows[stamp_s] for stamp_s in sorted(rows)], np.array(sorted(rows))


def _named(folder: Path, name: str) -> Path | None:
    """A picture of that name in the folder or its frames/; no path that leads elsewhere."""
    plain = Path(name.replace("\\", "/")).name
    if not plain:
        return None
    for path in (folder / plain, folder / "frames" / plain):
        if path.is_file() and path.suffix.lower() in IMAGE_SUFFIXES:
            return path
    return None


def _by_names(paths: list[Path], given: Given, remarks: Remarks) -> tuple[FloatArray, str]:
    """Seconds since 1970; NaN for all where the names of any do not tell, or two tell the same."""
    for pattern, name, has_zone in ((_UNIX, "the seconds in their names", True), (_CALENDAR, "their names", False)):
        found = [pattern.search(path.stem) for path in paths]
        if not all(found):
            continue
        times = [_unix_s(match) if has_zone else _calendar_s(match) for match in found if match]
        if len(set(times)) == len(times) and not any(map(math.isnan, times)):
            offset_s = 0.0 if has_zone else (given.utc_offset_s or 0.0)
            if not has_zone and given.utc_offset_s is None:
                remarks.assumed.append("the times in the pictures' names are UTC: --utc-offset mends that")
            return np.array(times) - offset_s, name
    remarks.lacks.append("times in the pictures' names: 20260714_093000.250, or seconds since 1970")
    return np.full(len(paths), np.nan), "nothing"


def _unix_s(match: re.Match[str]) -> float:
    return float(f"{match[1]}.{match[2] or 0}")


def _calendar_s(match: re.Match[str]) -> float:
    year, month, day, hour, minute, second = (int(match[i]) for i in range(1, 7))
    if not (1 <= month <= 12 and 1 <= day <= 31 and hour < 24 and minute < 60 and second < 61):
        return math.nan
    return timegm((year, month, day, hour, minute, second)) + float(f"0.{match[7] or 0}")


def _size(paths: list[Path]) -> Lens:
    """Of the first picture that can be read."""
    for path in paths[:100]:
        try:
            height, width = read_picture(path).image.shape[:2]
        except FileRefusedError:
            continue
        return Lens(width, height)
    raise ImportRefusedError(f"{paths[0].parent}: none of its first pictures can be read: PNG, JPEG, BMP or TIFF is")
