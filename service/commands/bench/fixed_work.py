"""Fixed work that never changes, each like a part of distloc in character: what a time is compared with in any run.

A ratio to them says how a part's cost moved, whatever the machine and however busy it is. Whoever changes them makes
all kept ratios worthless.
"""

import struct
from functools import partial

import cv2
import numpy as np
from numpy.typing import NDArray

_BLOCK = 8192
_FRAMES = 100


class ArrayWork:
    """Like a filter step: float32 rows of `n`, block by block, then cumulative sums, a gather and Gaussians."""

    def __init__(self, n: int) -> None:
        rng = np.random.default_rng(0)
        self._points = rng.standard_normal((3, n), dtype=np.float32)
        self._turn = np.linalg.qr(rng.standard_normal((3, 3)))[0].astype(np.float32)
        self._weights = np.empty(n, np.float32)
        self._cumulative = np.empty(n)
        self._order = np.sort(rng.integers(0, n, n))
        self._copy, self._noise = np.empty_like(self._points), np.empty_like(self._points)
        self._rng = np.random.Generator(np.random.SFC64(0))

    def __call__(self) -> None:
        """Once; it leaves what it started from."""
        n = self._weights.size
        for start in range(0, n, _BLOCK):
            part = slice(start, min(start + _BLOCK, n))
            turned = self._turn @ self._points[:, part]
            np.square(turned, out=turned)
            np.exp(-turned.sum(axis=0), out=self._weights[part])
        np.cumsum(self._weights, dtype=np.float64, out=self._cumulative)
        for row, copy in zip(self._points, self._copy, strict=True):
            np.take(row, self._order, out=copy, mode="clip")
        self._rng.standard_normal(dtype=np.float32, out=self._noise)
        self._copy += self._noise


class ImageWork:
    """Like the detections of a mask: components of a fixed full HD one with four discs, and one disc's pixels."""

    def __init__(self) -> None:
        self._mask: NDArray[np.uint8] = np.zeros((1080, 1920), np.uint8)
        for u in (300, 700, 1100, 1500):
            cv2.circle(self._mask, (u, 500), 60, 255, -1)

    def __call__(self) -> None:
        """Once."""
        cv2.boundingRect(self._mask)
        crop = self._mask[400:600, 200:1600]
        cv2.connectedComponentsWithStats(np.ascontiguousarray(crop), connectivity=8)
        for left in (0, 400, 800, 1200):
            rows, columns = np.nonzero(crop[:, left : left + 200])
            np.stack([rows - rows.mean(), columns - columns.mean()])
            np.quantile(rows, 0.85)


class BytesWork:
    """Like framing and decoding: a hundred records found in a buffer, cut out, unpacked and kept, in plain Python."""

    def __init__(self) -> None:
        self._unpack = struct.Struct("<IffffffhhBB").unpack
        record = struct.Struct("<IffffffhhBB").pack(7, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 1, 2, 3, 4)
        self._record = record
        self._buffer = b"".join(b"\xfd" + bytes([len(record)]) + record for _ in range(_FRAMES))

    def __call__(self) -> None:
        """Once."""
        names = ("time", "roll", "pitch", "yaw", "p", "q", "r", "a", "b", "c", "d")
        buffer, at, kept = self._buffer, 0, []
        while (start := buffer.find(b"\xfd", at)) >= 0:
            end = start + 2 + buffer[start + 1]
            if end > len(buffer):
                break
            values = self._unpack(bytearray(buffer[start + 2 : end]))
            total = 0
            for byte in buffer[start + 2 : end]:
                total = (total * 33 + byte) & 0xFFFF
            kept.append((total, dict(zip(names, values, strict=True)), partial(int, total)))
            at = end
