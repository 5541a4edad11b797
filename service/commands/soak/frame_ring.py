"""Frames from the renderer's process to the service's: a few slots in memory without a name, and a socket that tells.

The service copies a frame once, as from a camera's driver, and has none of the slots mapped: its memory is its own.
"""

import os
import select
import socket
import struct
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Image = NDArray[np.uint8]
SLOTS = 3
STAMPS = 1024  # the last ones, for who measures
_HEADER_BYTES = 16 + 8 * STAMPS
_COUNTS = struct.Struct("=QQ")  # frames handed over, frames that were drawn too late for that
_TOLD = struct.Struct("=QII")  # index, height, width; no height for a frame that cannot be decoded
_SILENCE_S = 0.5  # longer than a frame's period: the camera is lost


@dataclass(frozen=True, slots=True)
class Handed:
    """What has been handed over: how many frames, how many were too late for it, and the last stamps (N,), rising."""

    frames: int
    late: int
    stamps_ns: NDArray[np.int64]


def make_memory(slot_bytes: int) -> int:
    """A file descriptor that two processes share; it is gone with the last of them."""
    memory = os.memfd_create("distloc-soak")
    os.ftruncate(memory, _HEADER_BYTES + SLOTS * slot_bytes)
    return memory


def read_handed(memory: int) -> Handed:
    """Asked from outside, at any time."""
    header = os.pread(memory, _HEADER_BYTES, 0)
    frames, late = _COUNTS.unpack_from(header)
    stamps_ns = np.frombuffer(header, dtype=np.int64, offset=_COUNTS.size)
    return Handed(frames, late, np.sort(stamps_ns[:frames] if frames < STAMPS else stamps_ns))


class FrameWriter:
    """The renderer's end."""

    def __init__(self, memory: int, link: socket.socket, slot_bytes: int) -> None:
        self._memory, self._link, self._slot_bytes = memory, link, slot_bytes
        self._link.setblocking(False)
        self._frames = self._late = 0

    def put(self, image: Image | None) -> None:
        """Lay a frame into its slot; nobody is told yet. None for one that cannot be decoded."""
        self._shape = (0, 0) if image is None else image.shape[:2]
        if image is not None:
            slot = self._frames % SLOTS
            os.pwrite(self._memory, np.ascontiguousarray(image).data, _HEADER_BYTES + slot * self._slot_bytes)

    def hand_over(self, stamp_ns: int) -> bool:
        """Tell of the frame that was put, at `stamp_ns`; False where the service is gone."""
        offset = _COUNTS.size + 8 * (self._frames % STAMPS)
        os.pwrite(self._memory, stamp_ns.to_bytes(8, "little"), offset)
        told = _TOLD.pack(self._frames, *self._shape)
        self._frames += 1
        self._count()
        try:
            self._link.send(told)
        except BlockingIOError:
            pass  # nobody reads: the frame is lost, as a camera's is
        except OSError:
            return False
        return True

    def drop(self) -> None:
        """The frame that was put came too late."""
        self._late += 1
        self._count()

    def _count(self) -> None:
        os.pwrite(self._memory, _COUNTS.pack(self._frames, self._late), 0)


class FrameReader:
    """The service's end: the part of cv2.VideoCapture that CaptureSource uses."""

    def __init__(self, memory: int, link: socket.socket, slot_bytes: int) -> None:
        self._memory, self._link, self._slot_bytes = memory, link, slot_bytes
        self._told = (0, 0, 0)

    def isOpened(self) -> bool:
        return True

    def grab(self) -> bool:
        """Wait for the newest frame; False where none comes."""
        if not select.select([self._link], [], [], _SILENCE_S)[0]:
            return False
        data = self._link.recv(_TOLD.size)
        while data and select.select([self._link], [], [], 0.0)[0]:
            data = self._link.recv(_TOLD.size)
        if not data:
            select.select([], [], [], _SILENCE_S)  # the renderer is gone: no busy loop
            return False
        self._told = _TOLD.unpack(data)
        return True

    def retrieve(self) -> tuple[bool, Image | None]:
        """A copy of it; False where it cannot be decoded or was written over meanwhile."""
        index, height, width = self._told
        if height == 0:
            return False, None
        image: Image = np.empty((height, width, 3), np.uint8)
        os.preadv(self._memory, [image.data], _HEADER_BYTES + index % SLOTS * self._slot_bytes)
        frames, _ = _COUNTS.unpack(os.pread(self._memory, _COUNTS.size, 0))
        return frames - index < SLOTS, image  # the next to be written lies SLOTS further on

    def release(self) -> None:
        pass
