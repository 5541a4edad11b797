"""TensorRT's engines on disk: one folder for each model, board and version, whole or not used, few and bounded."""

import fcntl
import hashlib
import os
import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import IO

import msgspec

from service.common.files import write_whole

MOST_KEPT = 3  # folders
MOST_BYTES = 2_000_000_000  # in all of them; the one in use stays
_SEAL = "built.json"


class Seal(msgspec.Struct, frozen=True):
    """What a folder's engines were built for, and each file's size and SHA-256."""

    parts: dict[str, str]
    files: dict[str, tuple[int, str]]


class EngineCache:
    """One process uses it at a time. `parts` says what an engine is built for: any other is not used.

    Nothing here raises: what is wrong is in `notes`, a line each, and without a folder engines are built anew.
    """

    def __init__(self, root: Path, parts: Mapping[str, str]) -> None:
        self.notes: list[str] = []
        self.folder: Path | None = None
        self._root, self._parts = root, dict(parts)
        self._lock: IO[bytes] | None = None
        try:
            self._open(root / hashlib.sha256(msgspec.json.encode(sorted(parts.items()))).hexdigest()[:16])
        except OSError as error:
            self._lose(error)

    def seal(self) -> None:
        """The engines are built and have run: from now on the folder may be used, and older ones make room."""
        if self.folder is None:
            return
        try:
            files = {path.name: _stamp(path) for path in sorted(self.folder.iterdir()) if path.name != _SEAL}
            seal = _seal(self.folder)
            if files and (seal is None or seal.files != files):  # one that was there may have been built anew
                write_whole(self.folder / _SEAL, msgspec.json.encode(Seal(self._parts, files)), is_durable=True)
            self._make_room(self.folder)
        except OSError as error:
            self._lose(error)

    def close(self) -> None:
        """Let another process have it."""
        if self._lock is not None:
            self._lock.close()

    def _open(self, own: Path) -> None:
        self._root.mkdir(parents=True, exist_ok=True, mode=0o700)
        self._lock = (self._root / "lock").open("wb")
        try:
            fcntl.flock(self._lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            self.notes.append(f"another process uses the engines in {self._root}: this one's are not kept")
            return
        fault = _fault(own) if own.exists() else self._foreign()
        if own.exists() and fault:
            shutil.rmtree(own)
        if fault:
            self.notes.append(f"{fault}: it is not used, one is built for this computer")
        own.mkdir(exist_ok=True, mode=0o700)
        if not os.access(own, os.W_OK | os.X_OK):
            raise PermissionError(13, os.strerror(13), str(own))
        os.utime(own)
        self.folder = own
        self._make_room(own)

    def _lose(self, error: OSError) -> None:
        self.folder = None
        place = error.filename or self._root
        self.notes.append(f"no engine can be kept in {place}: {error.strerror or error}: it is built at each start")

    def _foreign(self) -> str:
        """What the newest engine of another kind differs in; empty where there is none."""
        for folder in self._folders():
            seal = _seal(folder)
            if seal is None:
                continue
            differing = [key for key in self._parts if seal.parts.get(key) != self._parts[key]]
            of = "; ".join(f"{key} {seal.parts.get(key, 'none')}, here {self._parts[key]}" for key in differing)
            return f"the engine in {folder} is of another {of}"
        return ""

    def _folders(self) -> list[Path]:
        """The newest first."""
        found = [one for one in self._root.iterdir() if one.is_dir() and not one.is_symlink()]
        return sorted(found, key=lambda one: one.stat().st_mtime_ns, reverse=True)

    def _make_room(self, own: Path) -> None:
        others = [one for one in self._folders() if one != own]
        held = _size(own)
        for place, folder in enumerate(others, start=1):
            size = _size(folder)
            if place >= MOST_KEPT or held + size > MOST_BYTES or _seal(folder) is None:
                shutil.rmtree(folder)
            else:
                held += size


def _fault(folder: Path) -> str:
    """Why its engines are not what was built; empty where they are."""
    seal = _seal(folder)
    if seal is None:
        return f"the engine in {folder} was never finished"
    for name, (size, sha256) in seal.files.items():
        path = folder / name
        if not path.is_file():
            return f"the engine {path} is missing"
        if path.stat().st_size != size:
            return f"the engine {path} is cut short or overwritten ({path.stat().st_size} bytes of {size})"
        if _stamp(path)[1] != sha256:
            return f"the engine {path} is not the one that was built here"
    return ""


def _seal(folder: Path) -> Seal | None:
    try:
        return msgspec.json.decode((folder / _SEAL).read_bytes(), type=Seal)
    except (OSError, msgspec.DecodeError, msgspec.ValidationError):
        return None


def _stamp(path: Path) -> tuple[int, str]:
    digest, size = hashlib.sha256(), 0
    with path.open("rb") as file:
        while block := file.read(1 << 20):
            digest.update(block)
            size += len(block)
    return size, digest.hexdigest()


def _size(folder: Path) -> int:
    return sum(one.stat().st_size for one in folder.iterdir() if one.is_file())
