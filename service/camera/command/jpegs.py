"""Cuts a row of JPEGs, with or without a multipart's lines between them, at their markers (ITU-T T.81, B.1). No I/O."""

import re
from collections.abc import Iterator

from service.camera.command.pictures import Encoded, FormatError, Jpeg

_SOI, _START = b"\xff\xd8", b"\xff\xd8\xff"
_EOI, _SOS, _SOI_CODE, _FILL = 0xD9, 0xDA, 0xD8, 0xFF
_ALONE = {0x01, *range(0xD0, 0xD8)}  # markers without a length: TEM, RSTn
_IN_SCAN = re.compile(rb"\xff[^\x00\xd0-\xd7\xff]")  # what ends entropy-coded data; a search of C's speed
_LENGTH = 4  # marker and length


class JpegCutter:
    """Walks the segments, so that an EXIF thumbnail's end is none; `most_bytes` is the longest that is waited for."""

    def __init__(self, most_bytes: int) -> None:
        self._most_bytes = most_bytes
        self._data = bytearray()
        self._at = 0  # the next marker, or where to go on searching for the scan's end
        self._is_begun = self._in_scan = False
        self._skipped = 0

    @property
    def held(self) -> int:
        """Bytes of a picture that is not whole yet."""
        return len(self._data) if self._is_begun else 0

    def feed(self, data: memoryview) -> Iterator[Encoded]:
        """The pictures that are whole with these bytes; one that something interrupts is cut short."""
        self._data += data
        while self._begin() and (end := self._end()) is not None:
            picture = Jpeg(bytes(self._data[:end]))
            self._drop(end)
            self._skipped = 0
            yield picture
        if len(self._data) > self._most_bytes or self._skipped > self._most_bytes:
            what = "one JPEG" if self._is_begun else "bytes that are no JPEG"
            raise FormatError(f"writes {what} of over {self._most_bytes} bytes: is its output MJPEG?")

    def _begin(self) -> bool:
        """Come to a picture's start, which is then the first byte held."""
        if self._is_begun:
            return True
        found = self._data.find(_START)
        skipped = found if found >= 0 else max(len(self._data) - len(_START) + 1, 0)
        self._skipped += skipped
        self._drop(skipped)
        self._is_begun, self._at, self._in_scan = found >= 0, len(_SOI), False
        return self._is_begun

    def _end(self) -> int | None:
        """Where the picture ends, or where something else begins in the midst of it; None: bytes are lacking."""
        while True:
            if self._in_scan:
                found = _IN_SCAN.search(self._data, self._at)
                if found is None:
                    self._at = max(len(self._data) - 1, self._at)
                    return None
                self._at, self._in_scan = found.start(), False
            head = self._data[self._at : self._at + _LENGTH]
            if len(head) < 2:
                return None
            if head[0] != _FILL or head[1] == _SOI_CODE:
                return self._at
            if head[1] == _EOI:
                return self._at + 2
            if head[1] == _FILL:
                self._at += 1
            elif head[1] in _ALONE:
                self._at += 2
            elif len(head) < _LENGTH:
                return None
            else:
                self._at += 2 + int.from_bytes(head[2:], "big")
                self._in_scan = head[1] == _SOS

    def _drop(self, count: int) -> None:
        del self._data[:count]
        self._is_begun, self._at = False, 0
