"""A recording of a flight on disk: telemetry, frames and masks; the replay and its scoring read it."""

import codecs
import csv
import os
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, TextIO

import cv2
import msgspec
import numpy as np
from numpy.typing import NDArray

from service.common.files import MOST_PIXELS, FileRefusedError, NoImageError, Picture, check_file, read_picture
from service.common.masks import misnamed

_MAX_ROWS = 1_000_000  # 55 hours at 5 Hz; more is not one flight
_MOST_TABLE_BYTES = 256_000_000
_MOST_TRUTH_BYTES = 4_000_000
_LONGEST_ROW = 4096
_LAST_STAMP_US = 2**63 // 1000  # later ones do not fit 64-bit nanoseconds
_FOLDERS = ("frames", "masks")  # a name in the table may have them before it
_NAME_COLUMNS = ("file", "frame")
_PAST_END = 1_000_000_000  # no frame's number is as high
_IMAGE_SUFFIXES = ("", ".jpg", ".jpeg", ".png", ".bmp", ".tif", ".tiff")


class RecordingError(Exception):
    """The recording cannot be used: one line that names the file and what is wrong with it."""


class TruthPlace(msgspec.Struct, frozen=True):
    """Degrees, and metres above mean sea level, under the names that the file has."""

    lat: Annotated[float, msgspec.Meta(ge=-90.0, le=90.0)]
    lon: Annotated[float, msgspec.Meta(ge=-180.0, le=180.0)]
    alt_msl_m: Annotated[float, msgspec.Meta(ge=-1000.0, le=50_000.0)]


class TruthTarget(msgspec.Struct, frozen=True):
    """Where a recording's fire really was: the plume's centre, its base on the ground and its size in metres."""

    centre: TruthPlace
    base: TruthPlace | None = None
    size_m: float | None = None


class Truth(msgspec.Struct, frozen=True):
    """The content of truth.json."""

    targets: tuple[TruthTarget, ...]


class Recording:
    """A folder with telemetry.tlog and what was recorded beside it, or a bare .tlog file; a stranger may have made it.

    Raises RecordingError where the telemetry, the table of frames or the truth cannot be read, or leads out of the
    folder. `dropped` counts the bad rows of frames.csv by reason.
    """

    def __init__(self, folder_or_tlog: Path) -> None:
        path = Path(folder_or_tlog)
        self._folder: Path | None = path if path.is_dir() else None
        self.tlog_path = path / "telemetry.tlog" if self._folder else path
        self.dropped: Counter[str] = Counter()
        _check_readable(self.tlog_path, self._folder)
        self._rows = self._read_rows()
        self.truth = self._read_truth()
        self._video: cv2.VideoCapture | None = None
        self._video_next = 0

    @property
    def is_bare(self) -> bool:
        """Whether it is a log alone, without a folder."""
        return self._folder is None

    @property
    def has_table(self) -> bool:
        """Whether there is a frames.csv."""
        return self._file("frames.csv") is not None

    @property
    def config_path(self) -> Path | None:
        """The configuration that was flown with, if it was kept."""
        return self._file("config.toml")

    @property
    def masks_folder(self) -> Path | None:
        """The folder of recorded masks, if there is one."""
        return self._subfolder("masks")

    def frames(self) -> list[tuple[int, str]]:
        """Stamps in microseconds on the log's clock and names, in order of time."""
        return sorted(self._rows, key=lambda row: row[0])

    def rows(self) -> list[tuple[int, str]]:
        """The same in the order of the table, which tells more where the clock was set."""
        return list(self._rows)

    def load_image(self, name: str, most_pixels: int = MOST_PIXELS) -> NDArray[np.uint8] | None:
        """The frame (H, W, 3) BGR of a name, or None where only its mask was kept or it is no picture to be used.

        Raises FileRefusedError for what is no file of the folder, or larger than `most_pixels`.
        """
        try:
            picture = self.load_picture(name, most_pixels)
        except NoImageError:
            return None
        return None if picture is None else picture.image

    def load_picture(self, name: str, most_pixels: int = MOST_PIXELS) -> Picture | None:
        """The frame of a name, or None where only its mask was kept.

        Raises FileRefusedError for what is no file of the folder, larger than `most_pixels`, or no picture to be used.
        """
        if (video := self._file("video.mp4")) is not None:
            image = self._video_frame(video, name)
            return None if image is None else Picture(image)
        if (folder := self._subfolder("frames")) is None or not _is_plain(name):
            return None
        for suffix in _IMAGE_SUFFIXES:
            path = folder / (name + suffix)
            if path.exists() and not path.is_dir():
                return read_picture(path, self._folder, most_pixels)
        return None

    def check_masks(self) -> None:
        """Raise RecordingError where there are masks of which none is a frame's: no frame would have any."""
        folder = self.masks_folder
        if folder is not None and (fault := misnamed(folder, [name for _, name in self._rows])):
            raise RecordingError(fault)

    def close(self) -> None:
        """Release the video."""
        if self._video is not None:
            self._video.release()
            self._video = None

    def _file(self, name: str, most_bytes: int | None = None) -> Path | None:
        path = self._folder / name if self._folder else None
        if path is None or not os.path.lexists(path):
            return None
        try:
            check_file(path, self._folder, most_bytes)
        except FileRefusedError as error:
            raise RecordingError(str(error)) from error
        return path

    def _subfolder(self, name: str) -> Path | None:
        path = self._folder / name if self._folder else None
        if path is None or self._folder is None or not path.is_dir():
            return None
        if not path.resolve().is_relative_to(self._folder.resolve()):
            raise RecordingError(f"{path}: leads out of {self._folder}: copy the folder there")
        return path

    def _video_frame(self, path: Path, name: str) -> NDArray[np.uint8] | None:
        if not (name.isascii() and name.isdigit() and len(name) < 10):
            return None
        wanted = int(name)
        if self._video is None or wanted < self._video_next:
            self.close()
            self._video, self._video_next = cv2.VideoCapture(str(path)), 0
        while self._video_next <= wanted:  # one by one: to seek by number gives other frames where the rate varies
            if not self._video.grab():
                self._video_next = _PAST_END
                return None
            self._video_next += 1
        ok, image = self._video.retrieve()
        return np.asarray(image, dtype=np.uint8) if ok else None

    def _read_rows(self) -> list[tuple[int, str]]:
        path = self._file("frames.csv", _MOST_TABLE_BYTES)
        if path is None:
            return []
        try:
            with path.open(encoding="utf-8-sig", errors="replace") as file:
                return list(self._checked_rows(path, _lines(file)))
        except OSError as error:
            raise RecordingError(f"{path}: cannot be read: {error}") from error

    def _checked_rows(self, path: Path, lines: Iterator[str | None]) -> Iterator[tuple[int, str]]:
        header = next(lines, None) or ""
        columns = [cell.strip() for cell in _cells(header)]
        names = [columns.index(name) for name in _NAME_COLUMNS if name in columns]
        if "stamp_us" not in columns or not names:
            raise RecordingError(
                f"{path}: the header must be stamp_us,file (or stamp_us,frame) and is {header.strip()[:80]!r}"
            )
        places = (columns.index("stamp_us"), names[0])
        seen: set[int] = set()
        for number, line in enumerate(lines):
            if number >= _MAX_ROWS:
                raise RecordingError(f"{path}: more than {_MAX_ROWS} frames")
            row = None if line is None else _cells(line)
            reason = "long_row" if row is None else _fault(row, places, seen)
            if row is None or reason is not None:
                self.dropped[str(reason)] += 1
                continue
            stamp_us = int(row[places[0]].strip())  # str.strip takes separators off that int() stumbles over
            seen.add(stamp_us)
            yield stamp_us, _name(row[places[1]])

    def _read_truth(self) -> Truth | None:
        path = self._file("truth.json", _MOST_TRUTH_BYTES)
        if path is None:
            return None
        try:
            return msgspec.json.decode(path.read_bytes().removeprefix(codecs.BOM_UTF8), type=Truth)
        except (OSError, msgspec.DecodeError, RecursionError) as error:
            raise RecordingError(f"{path}: cannot be read: {error}") from error


def _check_readable(path: Path, folder: Path | None) -> None:
    if not os.path.lexists(path):
        raise RecordingError(f"{path}: no such file")
    try:
        check_file(path, folder)
        with path.open("rb") as file:
            if not file.read(1):
                raise RecordingError(f"{path}: is empty")
    except FileRefusedError as error:
        raise RecordingError(str(error)) from error
    except OSError as error:
        raise RecordingError(f"{path}: cannot be read: {error.strerror}") from error


def _lines(file: TextIO) -> Iterator[str | None]:
    """A file's lines, None for one that is too long: it may have no end."""
    while line := file.readline(_LONGEST_ROW):
        if len(line) < _LONGEST_ROW or line.endswith("\n"):
            yield line
            continue
        while line and not line.endswith("\n"):
            line = file.readline(_LONGEST_ROW)
        yield None


def _cells(line: str) -> list[str]:
    """One row by itself: a quote that is not closed costs no other."""
    try:
        return next(csv.reader([line.rstrip("\r\n")]), [])
    except csv.Error:
        return []


def _fault(row: list[str], places: tuple[int, int], seen: set[int]) -> str | None:
    if len(row) <= max(places):
        return "short_row"
    stamp = row[places[0]].strip()
    if not (stamp.isascii() and stamp.isdigit() and len(stamp) < 20 and 0 < int(stamp) < _LAST_STAMP_US):
        return "bad_stamp"
    if not _is_plain(_name(row[places[1]])):
        return "bad_name"
    return "repeated_stamp" if int(stamp) in seen else None


def _name(cell: str) -> str:
    """The file's name without the folder of ours that it lies in, as frames/7.jpg has it."""
    parts = cell.strip().replace("\\", "/").removeprefix("./").split("/")
    return parts[1] if len(parts) == 2 and parts[0] in _FOLDERS else cell.strip()


def _is_plain(name: str) -> bool:
    """Whether it names a file of its own folder, and no other place."""
    return 0 < len(name) <= 200 and name == Path(name).name and "\\" not in name and name.isprintable()
