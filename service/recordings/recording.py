"""A recording of a flight on disk: telemetry, frames and masks; the replay and its scoring read it."""

import csv
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated

import cv2
import msgspec
import numpy as np
from numpy.typing import NDArray

from service.common.files import read_image

_MAX_ROWS = 1_000_000  # 55 hours at 5 Hz; more is not one flight
_MAX_IMAGE_BYTES = 100_000_000
_LAST_STAMP_US = 2**63 // 1000  # later ones do not fit 64-bit nanoseconds
_PAST_END = 1_000_000_000  # no frame's number is as high
_IMAGE_SUFFIXES = ("", ".jpg", ".jpeg", ".png")


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
    """A folder with telemetry.tlog and what was recorded beside it, or a bare .tlog file.

    Raises RecordingError where the telemetry, the table of frames or the truth cannot be read. `dropped` counts the bad
    rows of frames.csv by reason.
    """

    def __init__(self, folder_or_tlog: Path) -> None:
        path = Path(folder_or_tlog)
        self._folder: Path | None = path if path.is_dir() else None
        self.tlog_path = path / "telemetry.tlog" if self._folder else path
        self.dropped: Counter[str] = Counter()
        _check_readable(self.tlog_path)
        self._rows = self._read_rows()
        self.truth = self._read_truth()
        self._video: cv2.VideoCapture | None = None
        self._video_next = 0

    @property
    def config_path(self) -> Path | None:
        """The configuration that was flown with, if it was kept."""
        return self._inside("config.toml")

    @property
    def masks_folder(self) -> Path | None:
        """The folder of recorded masks, if there is one."""
        return self._inside("masks")

    def frames(self) -> list[tuple[int, str]]:
        """Stamps in microseconds on the log's clock and names, in order of time."""
        return list(self._rows)

    def load_image(self, name: str) -> NDArray[np.uint8] | None:
        """The frame (H, W, 3) BGR of a name, or None where only its mask was kept or it cannot be decoded."""
        if (video := self._inside("video.mp4")) is not None:
            return self._video_frame(video, name)
        if (folder := self._inside("frames")) is None or not _is_plain(name):
            return None
        for suffix in _IMAGE_SUFFIXES:
            path = folder / (name + suffix)
            if path.is_file() and path.stat().st_size <= _MAX_IMAGE_BYTES:
                return read_image(path)
        return None

    def close(self) -> None:
        """Release the video."""
        if self._video is not None:
            self._video.release()
            self._video = None

    def _inside(self, name: str) -> Path | None:
        path = self._folder / name if self._folder else None
        return path if path is not None and path.exists() else None

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
        path = self._inside("frames.csv")
        if path is None:
            return []
        try:
            with path.open(newline="", encoding="utf-8", errors="replace") as file:
                return sorted(self._checked_rows(path, file), key=lambda row: row[0])
        except (OSError, csv.Error) as error:
            raise RecordingError(f"{path}: cannot be read: {error}") from error

    def _checked_rows(self, path: Path, lines: Iterator[str]) -> Iterator[tuple[int, str]]:
        reader = csv.reader(lines)
        header = next(reader, [])
        if [cell.strip() for cell in header[:2]] != ["stamp_us", "file"]:
            raise RecordingError(f"{path}: the header must be stamp_us,file and is {','.join(header)[:80]!r}")
        seen: set[int] = set()
        for number, row in enumerate(reader):
            if number >= _MAX_ROWS:
                raise RecordingError(f"{path}: more than {_MAX_ROWS} frames")
            reason = _fault(row, seen)
            if reason is None:
                stamp_us = int(row[0].strip())  # str.strip takes separators off that int() stumbles over
                seen.add(stamp_us)
                yield stamp_us, row[1].strip()
            else:
                self.dropped[reason] += 1

    def _read_truth(self) -> Truth | None:
        path = self._inside("truth.json")
        if path is None:
            return None
        try:
            return msgspec.json.decode(path.read_bytes(), type=Truth)
        except (OSError, msgspec.DecodeError, RecursionError) as error:
            raise RecordingError(f"{path}: cannot be read: {error}") from error


def _check_readable(path: Path) -> None:
    try:
        with path.open("rb") as file:
            if not file.read(1):
                raise RecordingError(f"{path}: is empty")
    except FileNotFoundError as error:
        raise RecordingError(f"{path}: no such file") from error
    except OSError as error:
        raise RecordingError(f"{path}: cannot be read: {error.strerror}") from error


def _fault(row: list[str], seen: set[int]) -> str | None:
    if len(row) < 2:
        return "short_row"
    stamp = row[0].strip()
    if not (stamp.isascii() and stamp.isdigit() and len(stamp) < 20 and 0 < int(stamp) < _LAST_STAMP_US):
        return "bad_stamp"
    if not _is_plain(row[1].strip()):
        return "bad_name"
    return "repeated_stamp" if int(stamp) in seen else None


def _is_plain(name: str) -> bool:
    """Whether it names a file of its own folder, and no other place."""
    return 0 < len(name) <= 200 and name == Path(name).name and "\\" not in name and name.isprintable()
