"""Which reader takes which source, by its first bytes and its suffix; `distloc import` asks it.

A new reader is one line of `READERS`. What it needs is imported once it is chosen.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

from service.common.files import FileRefusedError, check_file
from service.recordings.importers.flight import Film, Given, ImportedFlight, ImportRefusedError

HEAD_BYTES = 65_536
MOST_BYTES = 64_000_000_000  # hours of 4K


@dataclass(frozen=True, slots=True)
class Reader:
    """`fits` judges a path by its suffix (lower case) and its first bytes, none of a folder's; `read` reads it."""

    name: str
    fits: Callable[[Path, str, bytes], bool]
    read: Callable[[Path, Given], ImportedFlight]


def _film(path: Path, given: Given) -> ImportedFlight:
    from service.recordings.importers.film import read_film

    return read_film(path)


def _dataflash(path: Path, given: Given) -> ImportedFlight:
    from service.recordings.importers.logs.dataflash import read_dataflash

    return read_dataflash(path, given)


def _is_dataflash(path: Path, suffix: str, head: bytes) -> bool:
    return head.startswith(b"\xa3\x95\x80") or (suffix == ".log" and head.lstrip().startswith(b"FMT,"))


def _ulog(path: Path, given: Given) -> ImportedFlight:
    from service.recordings.importers.logs.ulog import read_ulog

    return read_ulog(path, given)


def _tlog(path: Path, given: Given) -> ImportedFlight:
    from service.recordings.importers.logs.tlog_poses import read_tlog_poses

    return read_tlog_poses(path, given)


def _gopro(path: Path, given: Given) -> ImportedFlight:
    from service.recordings.importers.gopro.reading import read_gopro

    return read_gopro(path, given)


def _is_gopro(path: Path, suffix: str, head: bytes) -> bool:
    from service.recordings.importers.gopro.mp4_track import has_telemetry

    return head[4:8] == b"ftyp" and has_telemetry(path)


def _misb(path: Path, given: Given) -> ImportedFlight:
    from service.recordings.importers.misb.reading import read_misb

    return read_misb(path, given)


def _is_misb(path: Path, suffix: str, head: bytes) -> bool:
    from service.recordings.importers.misb.mpegts import has_klv

    return has_klv(head)


def _frame_folder(path: Path, given: Given) -> ImportedFlight:
    from service.recordings.importers.frame_folder import read_frame_folder

    return read_frame_folder(path, given)


def _csv_poses(path: Path, given: Given) -> ImportedFlight:
    from service.recordings.importers.logs.csv_poses import read_csv_poses

    return read_csv_poses(path, given)


def _srt(path: Path, given: Given) -> ImportedFlight:
    from service.recordings.importers.dji.srt import read_srt

    return read_srt(path, given)


def _stills(path: Path, given: Given) -> ImportedFlight:
    from service.recordings.importers.stills.stills import read_stills

    return read_stills(path, given)


def _are_stills(path: Path, suffix: str, head: bytes) -> bool:
    from service.recordings.importers.stills.stills import has_stills, is_picture

    return is_picture(suffix) if head else has_stills(path)


def _is_table_of_poses(path: Path, suffix: str, head: bytes) -> bool:
    from service.recordings.importers.logs.csv_poses import is_table_of_poses

    return is_table_of_poses(path, suffix, head)


FILM_SUFFIXES = frozenset({".mp4", ".mov", ".m4v", ".avi", ".mkv", ".ts", ".mts", ".m2ts", ".mpg", ".webm", ".lrv"})

_STILLS = "a folder of pictures, or pictures"

# The first that fits reads it: what is sure by its first bytes before what goes by a suffix.
READERS: tuple[Reader, ...] = (
    Reader("an ArduPilot DataFlash log", _is_dataflash, _dataflash),
    Reader("a PX4 ULog", lambda path, suffix, head: head.startswith(b"ULog\x01\x12\x35"), _ulog),
    Reader("a telemetry log (.tlog)", lambda path, suffix, head: suffix in (".tlog", ".rlog"), _tlog),
    Reader("a GoPro's film (GPMF)", _is_gopro, _gopro),
    Reader("a film in MPEG-TS with MISB ST 0601", _is_misb, _misb),
    Reader("a table of poses (CSV)", _is_table_of_poses, _csv_poses),
    Reader("a drone's subtitles (.SRT)", lambda path, suffix, head: suffix == ".srt", _srt),
    Reader(_STILLS, _are_stills, _stills),
    Reader("a folder of frames", lambda path, suffix, head: not head and path.is_dir(), _frame_folder),
    Reader("film", lambda path, suffix, head: is_film(suffix, head), _film),
)


def is_film(suffix: str, head: bytes) -> bool:
    """Whether it is a film's container; what else it carries other readers say first."""
    return suffix in FILM_SUFFIXES or head[4:8] == b"ftyp" or head[:4] == b"\x1aE\xdf\xa3"


def reader_of(path: Path) -> Reader:
    """The reader of one source; ImportRefusedError where there is none."""
    head = head_of(path)
    found = next((one for one in READERS if one.fits(path, path.suffix.lower(), head)), None)
    if found is None:
        kinds = ", ".join(dict.fromkeys(one.name for one in READERS))
        raise ImportRefusedError(f"{path}: is nothing that can be imported: {kinds}; docs/import.md has them all")
    return found


def head_of(path: Path) -> bytes:
    """A file's first bytes, none of a folder; ImportRefusedError where it cannot be read or is empty."""
    if path.is_dir():
        return b""
    try:
        check_file(path, most_bytes=MOST_BYTES)
        with path.open("rb") as file:
            head = file.read(HEAD_BYTES)
    except FileRefusedError as error:
        raise ImportRefusedError(str(error)) from error
    except OSError as error:
        raise ImportRefusedError(f"{path}: cannot be read: {error.strerror}") from error
    if not head:
        raise ImportRefusedError(f"{path}: is empty")
    return head


def read_sources(paths: list[Path], given: Given) -> list[ImportedFlight]:
    """Each source's part of the flight, in the order given; films that a reader took with it are not read again."""
    chosen = [(path, reader_of(path)) for path in paths]
    films = (*given.films, *(path for path, reader in chosen if reader.name == "film"))
    stills = tuple(path for path, reader in chosen if reader.name == _STILLS and not path.is_dir())
    chosen = [(path, reader) for path, reader in chosen if path not in stills[1:]]  # one flight, read with the first
    given = replace(given, films=films, stills=stills)
    parts = [(path, reader.read(path, given)) for path, reader in chosen if reader.name != "film"]
    taken = {part.frames.path.resolve() for _, part in parts if isinstance(part.frames, Film)}
    left = [(path, reader) for path, reader in chosen if reader.name == "film" and path.resolve() not in taken]
    parts += [(path, reader.read(path, given)) for path, reader in left]
    order = {path: number for number, path in enumerate(paths)}
    return [part for _, part in sorted(parts, key=lambda one: order[one[0]])]
