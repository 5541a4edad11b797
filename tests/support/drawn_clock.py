"""Reads the clock that `rtsp_server.py` draws into its pictures."""

import zlib

import numpy as np
from numpy.typing import NDArray

_BITS = 40


def clock_ms_of(image: NDArray[np.uint8]) -> int | None:
    """CLOCK_MONOTONIC in milliseconds, of an image (H, W, 3); None where the blocks are damaged."""
    height, width = image.shape[:2]
    block = width // _BITS
    row = image[height // 32 : 3 * height // 32].mean(axis=(0, 2))
    levels = [row[bit * block + block // 4 : (bit + 1) * block - block // 4].mean() for bit in range(_BITS)]
    value = sum(int(level > 128.0) << bit for bit, level in enumerate(levels))
    time_ms, check = value & 0xFFFFFFFF, value >> 32
    return time_ms if zlib.crc32(time_ms.to_bytes(4, "little")) & 0xFF == check else None
