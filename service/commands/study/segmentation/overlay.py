"""Contact sheets: images side by side with the truth's outline and what a segmenter found."""

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from distloc.types import MaskArray

TRUTH_BGR, FOUND_BGR = (0, 255, 0), (255, 0, 255)
_WIDTH, _HEIGHT, _TEXT_HEIGHT = 384, 288, 40
_COLUMNS = 5
_MAX_LETTERS = 50
_WHITE = (255, 255, 255)


def tile(
    image: NDArray[np.uint8], truth: MaskArray | None, found: MaskArray | None, name: str, verdict: str
) -> NDArray[np.uint8]:
    """One image (H, W, 3) fitted into a tile (328, 384, 3) with outlines, and two lines of text below.

    The masks may have any size: they cover the image.
    """
    scale = min(_WIDTH / image.shape[1], _HEIGHT / image.shape[0])
    size = max(1, round(image.shape[1] * scale)), max(1, round(image.shape[0] * scale))
    interpolation = cv2.INTER_AREA if scale < 1.0 else cv2.INTER_LINEAR
    small = np.asarray(cv2.resize(image, size, interpolation=interpolation), dtype=np.uint8)
    for mask, colour in ((truth, TRUTH_BGR), (found, FOUND_BGR)):
        if mask is not None:
            _outline(small, mask, colour)
    picture = np.zeros((_HEIGHT + _TEXT_HEIGHT, _WIDTH, 3), np.uint8)
    picture[: size[1], : size[0]] = small
    for line, text in enumerate((_shortened(name), verdict)):
        at = (4, _HEIGHT + 15 + 18 * line)
        cv2.putText(picture, text, at, cv2.FONT_HERSHEY_SIMPLEX, 0.42, _WHITE, 1, cv2.LINE_AA)
    return picture


def sheet(tiles: Sequence[NDArray[np.uint8]]) -> NDArray[np.uint8]:
    """Tiles of one size in rows of five, black where the last row has none."""
    columns = min(_COLUMNS, len(tiles))
    blank = np.zeros_like(tiles[0])
    filled = [*tiles, *[blank] * (-len(tiles) % columns)]
    return np.vstack([np.hstack(filled[start : start + columns]) for start in range(0, len(filled), columns)])


def _outline(picture: NDArray[np.uint8], mask: MaskArray, colour: tuple[int, int, int]) -> None:
    """Draw a mask's contours into the picture; a finer mask's are found at its own size, so that small smoke stays."""
    height, width = picture.shape[:2]
    pixels = np.where(mask > 0, 255, 0).astype(np.uint8)
    if mask.shape[1] < width:
        pixels = np.asarray(cv2.resize(pixels, (width, height), interpolation=cv2.INTER_NEAREST), dtype=np.uint8)
    contours, _ = cv2.findContours(pixels, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    scale = np.array([width / pixels.shape[1], height / pixels.shape[0]])
    lines = [np.round((contour + 0.5) * scale - 0.5).astype(np.int32) for contour in contours]
    cv2.polylines(picture, lines, True, colour, 1)


def _shortened(name: str) -> str:
    half = _MAX_LETTERS // 2 - 2
    return name if len(name) <= _MAX_LETTERS else f"{name[:half]}...{name[-half:]}"
