"""The folders of flights that the recorder makes, one for each run: named, counted, deleted when old.

A flight's number rises whatever the clock says, so it is its age: a computer may begin in 1970 each time. Only what the
recorder itself made is ever deleted: a folder (no link) with such a name that holds nothing else than a recording.
"""

import re
import shutil
import time
from collections.abc import Callable
from pathlib import Path

from service.recordings.recording import RecordingError

BOOT_ID = Path("/proc/sys/kernel/random/boot_id")

_NAME = re.compile(r"flight-(\d{6,9})-\d{8}T\d{6}Z-[0-9a-f]{8}")
_OWN = frozenset({"telemetry.tlog", "frames.csv", "frames", "config.toml", "config.toml.part", "landmarks"})
_PICTURE = re.compile(r"\.?[^/]+\.jpg(\.part)?")
_TEMPLATE = re.compile(r"[A-Za-z0-9_-]{1,32}\.png(\.part)?")
_MOST_LISTED = 10


class Flights:
    """The flights in one folder: `begin` makes the one that is flown, `make_room` deletes old ones."""

    def __init__(self, parent: Path, keep: int, least_free_bytes: float) -> None:
        self.parent = parent
        self.flown: Path | None = None
        self._keep, self._least_free_bytes = keep, least_free_bytes

    def begin(self, utc_s: float) -> Path:
        """The folder of this run, made the first time. Raises OSError where that fails."""
        if self.flown is None:
            self.flown = new_flight(self.parent, utc_s)
        return self.flown

    def make_room(self) -> bool:
        """Delete one old flight if there are too many or the disk lacks room; whether there may be more to delete.

        The one that is flown is never deleted, nor one that somebody put something into. Raises OSError, also where the
        disk stays too full: what else writes to it needs the rest.
        """
        there = next(one for one in (self.parent.absolute(), *self.parent.absolute().parents) if one.is_dir())
        flights = flights_in(self.parent) if self.parent.is_dir() else []
        is_full = shutil.disk_usage(there).free < self._least_free_bytes
        if is_full or len(flights) + (self.flown is None) > self._keep:
            for path in flights:
                if path != self.flown and is_own(path):
                    shutil.rmtree(path)  # follows no links
                    return True
        if is_full:
            raise OSError(
                f"{shutil.disk_usage(there).free * 1e-9:.2f} GB free in {there}, below recorder.least_free_gb of "
                f"{self._least_free_bytes * 1e-9:g}: delete what is old"
            )
        return False


def new_flight(parent: Path, utc_s: float) -> Path:
    """Make the next flight's folder: flight-NUMBER-UTC-BOOT. Raises OSError where that fails."""
    parent.mkdir(parents=True, exist_ok=True)
    number = max((number_of(one) for one in parent.iterdir()), default=0) + 1
    utc = time.strftime("%Y%m%dT%H%M%SZ", time.gmtime(utc_s))
    flight = parent / f"flight-{number:06d}-{utc}-{_boot()}"
    flight.mkdir()
    return flight


def number_of(path: Path) -> int:
    """A flight's number by its folder's name, 0 where it is none of ours."""
    match = _NAME.fullmatch(path.name)
    return int(match[1]) if match else 0


def flights_in(parent: Path) -> list[Path]:
    """The recorder's flights, the oldest first: folders, not links to them. Raises OSError where that fails."""
    found = [path for path in parent.iterdir() if number_of(path) and path.is_dir() and not path.is_symlink()]
    return sorted(found, key=lambda path: (number_of(path), path.name))


def is_own(flight: Path) -> bool:
    """Whether a flight's folder holds what the recorder writes and nothing else."""
    entries = list(flight.iterdir())
    frames, templates = flight / "frames", flight / "landmarks"
    return (
        {entry.name for entry in entries} <= _OWN
        and not any(entry.is_symlink() for entry in entries)
        and (not frames.exists() or all(_is_picture(one) for one in frames.iterdir()))
        and (not templates.exists() or all(_is_template(one) for one in templates.iterdir()))
    )


def newest_flight(folder: Path, say: Callable[[str], None]) -> Path:
    """A recording's folder as given; of a folder of flights the newest, and what others there are is said."""
    if not folder.is_dir() or (folder / "telemetry.tlog").exists():
        return folder
    try:
        flights = [path for path in flights_in(folder) if (path / "telemetry.tlog").exists()]
    except OSError as error:
        raise RecordingError(f"{folder}: cannot be read: {error.strerror}") from error
    if not flights:
        return folder
    others = [path.name for path in reversed(flights[:-1])]
    more = f" and {len(others) - _MOST_LISTED} more" if len(others) > _MOST_LISTED else ""
    listed = f"; before it: {', '.join(others[:_MOST_LISTED])}{more}" if others else ""
    say(f"{folder} holds {len(flights)} flights: the newest is taken, {flights[-1].name}{listed}")
    return flights[-1]


def _is_template(path: Path) -> bool:
    return _TEMPLATE.fullmatch(path.name) is not None and path.is_file() and not path.is_symlink()


def _is_picture(path: Path) -> bool:
    return _PICTURE.fullmatch(path.name) is not None and path.is_file() and not path.is_symlink()


def _boot() -> str:
    """Eight digits of this boot's id; zeros where the system tells none."""
    try:
        found = re.sub(r"[^0-9a-f]", "", BOOT_ID.read_text(encoding="ascii"))[:8]
    except (OSError, ValueError):
        found = ""
    return found.ljust(8, "0")
