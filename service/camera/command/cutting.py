"""Cuts what a command writes into pictures: raw frames of a told size, Y4M, a row of JPEGs. Free of I/O."""

from collections.abc import Iterator
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from service.camera.command.jpegs import JpegCutter
from service.camera.command.pictures import Encoded, FormatError, Layout, Planes

_LONGEST_HEADER = 1024  # bytes, of Y4M
_LEAST_BYTES = 1 << 17  # of a JPEG that is mostly header
_420 = ("420", "420jpeg", "420mpeg2", "420paldv")


class Cutter(Protocol):
    """Takes bytes as they come and gives whole pictures."""

    @property
    def held(self) -> int:
        """Bytes of a picture that is not whole yet."""
        ...

    def feed(self, data: memoryview) -> Iterator[Encoded]:
        """The pictures that are whole with these bytes; FormatError where they can be none."""
        ...


class RawCutter:
    """Frames one after the other with nothing between them: their size must be known."""

    def __init__(self, size_px: tuple[int, int], layout: Layout) -> None:
        self._size_px, self._layout = size_px, layout
        self._count = layout.bytes_of(size_px)
        self._frame: NDArray[np.uint8] = np.empty(self._count, np.uint8)
        self.held = 0

    @property
    def left(self) -> int:
        """Bytes until the frame is whole."""
        return self._count - self.held

    def feed(self, data: memoryview) -> Iterator[Encoded]:
        """The frames that are whole with these bytes."""
        while len(data):
            part = data[: self.left]
            self._frame[self.held : self.held + len(part)] = part
            self.held += len(part)
            data = data[len(part) :]
            if self.held == self._count:
                frame, self.held = self._frame, 0
                self._frame = np.empty(self._count, np.uint8)  # the other is handed on
                yield Planes(frame, self._size_px, self._layout)


class Y4mCutter:
    """YUV4MPEG2: a line that says the size, then each frame behind a line of its own.

    A size of more than `most_pixels` is refused before memory is taken for it.
    """

    def __init__(self, most_pixels: int) -> None:
        self._most_pixels = most_pixels
        self._line = bytearray()
        self._frames: RawCutter | None = None
        self._in_frame = False

    @property
    def held(self) -> int:
        """Bytes of a frame that is not whole yet."""
        return len(self._line) + (self._frames.held if self._frames else 0)

    def feed(self, data: memoryview) -> Iterator[Encoded]:
        """The frames that are whole with these bytes."""
        while len(data):
            if self._frames is not None and self._in_frame:
                part = data[: self._frames.left]
                data = data[len(part) :]
                for frame in self._frames.feed(part):
                    self._in_frame = False
                    yield frame
                continue
            data = self._header(data)

    def _header(self, data: memoryview) -> memoryview:
        """Take up a header's line; what follows it."""
        start, end, _ = bytes(data[:_LONGEST_HEADER]).partition(b"\n")
        self._line += start
        wanted = b"FRAME" if self._frames else b"YUV4MPEG2 "
        if not self._line.startswith(wanted[: len(self._line)]) or len(self._line) > _LONGEST_HEADER:
            raise FormatError(
                f"does not write Y4M: {bytes(self._line[:20])!r} stands where {wanted.decode().strip()} should"
            )
        if end:
            if self._frames is None:
                self._frames = RawCutter(self._size(bytes(self._line).decode("ascii", "replace")), Layout.I420)
            else:
                self._in_frame = True
            self._line.clear()
        return data[len(start) + len(end) :]

    def _size(self, header: str) -> tuple[int, int]:
        said = {word[0]: word[1:] for word in header.split()[1:] if word}
        if said.get("C", "420") not in _420:
            raise FormatError(f"writes Y4M of the format C{said['C']}: it must be 4:2:0 of 8 bits (I420, yuv420p)")
        if not (said.get("W", "").isdecimal() and said.get("H", "").isdecimal()):
            raise FormatError(f"writes a Y4M header without width and height: {header[:60]!r}")
        size_px = int(said["W"][:9]), int(said["H"][:9])
        if size_px[0] * size_px[1] > self._most_pixels:
            raise FormatError(
                f"writes Y4M of {size_px[0]} x {size_px[1]}: more pixels than camera.width, camera.height have"
            )
        if size_px[0] % 2 or size_px[1] % 2 or not (size_px[0] and size_px[1]):
            raise FormatError(f"writes Y4M of {size_px[0]} x {size_px[1]}: both must be even, and some")
        return size_px


def cutter_of(format: str, size_px: tuple[int, int], most_pixels: int) -> Cutter:
    """The one for a format; `size_px` is of raw frames, `most_pixels` of a picture that says its own size."""
    if format == "y4m":
        return Y4mCutter(most_pixels)
    if format == "mjpeg":
        return JpegCutter(_LEAST_BYTES + 3 * most_pixels)  # the worst of them is no larger than what it shows
    return RawCutter(size_px, Layout(format))
