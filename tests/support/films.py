"""Films whose frames carry their own number, at a rate that varies."""

from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

SIZE = (160, 120)
_BLOCK = 20


def numbered(number: int) -> NDArray[np.uint8]:
    """An image (120, 160, 3) with the number's 8 bits as black and white blocks."""
    image = np.full((SIZE[1], SIZE[0], 3), 90, np.uint8)
    for bit in range(8):
        image[:, bit * _BLOCK : (bit + 1) * _BLOCK] = 255 if number >> bit & 1 else 0
    return image


def number_of(image: NDArray[np.uint8]) -> int:
    """The number that such an image carries."""
    return sum(1 << bit for bit in range(8) if image[60, bit * _BLOCK + _BLOCK // 2].mean() > 128)


def write_film(path: Path, count: int = 60) -> list[float]:
    """Write an .mp4 of which the first third runs at 20 a second, the second at 10, the last at 20/3; their times."""
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"mp4v"), 10.0, SIZE)
    for number in range(count):
        writer.write(numbered(number))
    writer.release()
    third, content = count // 3, bytearray(path.read_bytes())
    start = content.rfind(b"stts")
    entries, frames, ticks = (int.from_bytes(content[start + 8 + 4 * k : start + 12 + 4 * k], "big") for k in range(3))
    assert (entries, frames) == (1, count) and content.rfind(b"moov") > content.rfind(b"mdat")
    table = [3, third, ticks // 2, third, ticks, third, ticks * 3 // 2]  # as long as before: the edit list holds
    content[start + 8 : start + 20] = b"".join(value.to_bytes(4, "big") for value in table)
    for box in (b"moov", b"trak", b"mdia", b"minf", b"stbl", b"stts"):
        at = content.rfind(box) - 4
        content[at : at + 4] = (int.from_bytes(content[at : at + 4], "big") + 16).to_bytes(4, "big")
    path.write_bytes(content)
    steps_s = [0.05] * third + [0.1] * third + [0.15] * third
    return [round(sum(steps_s[:number]), 6) for number in range(count)]
