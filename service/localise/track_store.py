"""The file that tracks are kept in over a restart: encoded, checked, written whole. The track keeper owns it.

The file is a SHA-256 of all that follows, then MessagePack. A thread of its own writes it, so that a slow or full disk
holds up nobody; the newest content wins.
"""

import contextlib
import hashlib
import logging
import math
import os
import queue
import stat
import threading
import time
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from distloc.snapshot import LocalizerSnapshot
from service.common.files import write_whole
from service.localise.continuity import Moment, Refusal

log = logging.getLogger(__name__)

VERSION = 3
MAX_BYTES = 64 * 1024 * 1024  # 64 targets are 4.4 MB
_DIGEST_BYTES = hashlib.sha256().digest_size
_DTYPES = ("<f8", "<f4", "<i8", "|b1")
_CLOSE_S = 2.0
LATE_S = 10.0  # a write that takes longer has failed


class Kept(msgspec.Struct, frozen=True):
    """The file's content: `origin` is that of the local axes (latitude, longitude in degrees, metres over the sea).

    `camera_enu_m` is where the camera was at `moment`, `settings` a fingerprint of what must not have changed.
    """

    version: int
    vehicle: str
    settings: str
    moment: Moment
    origin: tuple[float, float, float]
    camera_enu_m: tuple[float, float, float]
    localizer: LocalizerSnapshot


class _Versioned(msgspec.Struct):
    version: int


def encode(kept: Kept) -> bytes:
    """The file's bytes."""
    payload = msgspec.msgpack.encode(kept, enc_hook=_from_array)
    return hashlib.sha256(payload).digest() + payload


def decode(data: bytes) -> Kept | Refusal:
    """What the bytes hold, or why that is nothing: damaged in any way, or of another version."""
    payload = data[_DIGEST_BYTES:]
    if not payload or hashlib.sha256(payload).digest() != data[:_DIGEST_BYTES]:
        return Refusal.DAMAGED
    try:
        if msgspec.msgpack.decode(payload, type=_Versioned).version != VERSION:
            return Refusal.OTHER_VERSION
        kept = msgspec.msgpack.decode(payload, type=Kept, dec_hook=_to_array)
    except (msgspec.MsgspecError, ValueError, RecursionError):  # numpy's errors are ValueErrors as well
        return Refusal.DAMAGED
    moment, (lat_deg, lon_deg, _) = kept.moment, kept.origin
    numbers = (moment.monotonic_s, moment.autopilot_s, moment.utc_s or 0.0, *kept.origin, *kept.camera_enu_m)
    is_sound = all(math.isfinite(one) for one in numbers) and abs(lat_deg) <= 90.0 and abs(lon_deg) <= 180.0
    return kept if is_sound else Refusal.DAMAGED


class TrackStore:
    """One vehicle's file in a folder. `read` is for the start; `write` hands over to the thread."""

    def __init__(self, folder: Path, vehicle: str) -> None:
        self.path = folder / f"{vehicle}.tracks"
        self.written = self._failed = 0
        self._is_failing = False
        self._began_s: float | None = None
        self._queue: queue.SimpleQueue[Kept | None] = queue.SimpleQueue()
        self._idle = threading.Event()
        self._idle.set()
        self._thread = threading.Thread(target=self._run, name="tracks", daemon=True)
        self._thread.start()

    def read(self) -> Kept | Refusal | None:
        """What the last run left; None if nothing. A damaged file is renamed, with a warning."""
        try:
            data = _read(self.path)
        except FileNotFoundError:
            return None
        except OSError as error:
            log.warning("%s cannot be read, so no target of an earlier run is known: %s", self.path, error)
            return Refusal.UNREADABLE
        kept = Refusal.DAMAGED if data is None else decode(data)
        if kept is Refusal.DAMAGED:
            self._set_aside()
        elif kept is Refusal.OTHER_VERSION:
            log.warning("%s was written by another version: its targets are not taken up", self.path)
        return kept

    @property
    def failed(self) -> int:
        """How many writes failed, one that hangs among them."""
        return self._failed + self._is_late()

    @property
    def is_idle(self) -> bool:
        """Whether the last `write` is through, well or not."""
        return self._idle.is_set()

    def write(self, kept: Kept) -> None:
        """Have it written; an error is counted, and logged once until a write succeeds again."""
        self._idle.clear()
        self._queue.put(kept)

    def close(self) -> None:
        """Wait a little for the last write."""
        self._queue.put(None)
        self._thread.join(_CLOSE_S)

    def _set_aside(self) -> None:
        aside = self.path.with_name(self.path.name + ".damaged")
        try:
            os.replace(self.path, aside)
        except OSError as error:
            log.warning("%s is damaged and cannot be renamed; starting with no targets: %s", self.path, error)
        else:
            log.warning("%s is damaged: renamed to %s; starting with no targets", self.path, aside.name)

    def _run(self) -> None:
        while (kept := self._queue.get()) is not None:
            self._began_s = time.monotonic()
            fault = self._fault_of_write(kept)
            if not fault and self._is_late():
                fault = f"a write took over {LATE_S:.0f} s"
            self._began_s = None
            self._count(fault)
            self._idle.set()

    def _is_late(self) -> bool:
        began_s = self._began_s
        return began_s is not None and time.monotonic() - began_s > LATE_S

    def _fault_of_write(self, kept: Kept) -> str:
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            write_whole(self.path, encode(kept), is_durable=True)
        except Exception as error:  # whatever it is, the flight goes on without a file
            with contextlib.suppress(OSError):
                self.path.with_name(self.path.name + ".part").unlink()
            return str(error) or type(error).__name__
        return ""

    def _count(self, fault: str) -> None:
        if fault:
            self._failed += 1
            if not self._is_failing:
                log.warning("tracks cannot be kept in %s: %s", self.path, fault)
            self._is_failing = True
            return
        self.written += 1
        if self._is_failing:
            log.info("tracks are kept in %s again", self.path)
        self._is_failing = False


def _read(path: Path) -> bytes | None:
    """A regular file's bytes; None for what cannot be ours: a folder, a device, too much."""
    found = path.stat()
    if not stat.S_ISREG(found.st_mode) or found.st_size > MAX_BYTES:
        return None
    return path.read_bytes()


def _from_array(value: Any) -> Any:
    if not isinstance(value, np.ndarray):
        raise TypeError(f"only arrays, got {type(value)}")
    little = np.ascontiguousarray(value).astype(value.dtype.newbyteorder("<"), copy=False)
    return little.dtype.str, value.shape, little.tobytes()


def _to_array(kind: Any, value: Any) -> Any:
    dtype, shape, data = value
    if dtype not in _DTYPES:
        raise ValueError(f"an array must be of {_DTYPES}, got {dtype}")
    native = np.dtype(dtype).newbyteorder("=")
    return np.frombuffer(data, dtype=dtype).astype(native).reshape(shape)
