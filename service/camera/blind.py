"""Notices a camera whose frames have no picture in them; the app asks for each frame, a replay too. Free of I/O."""

import cv2
import numpy as np
from numpy.typing import NDArray

from service.common.messages import Frame

BLIND_NS = 1_000_000_000
_BLOCKS = (16, 9)  # columns and rows: noise averages out in each
_ROWS = 8  # of each block are looked at
_BEYOND = 1  # so many blocks at either end may be a hot spot of the sensor; a small fire at night is in two
# Grey levels. Over 150 in real daylight frames, 16 with a tenth of their contrast left; black, grey or white with noise
# of 10 levels has 4 at 320 x 180 pixels and 2 in full HD.
_LEAST_CONTRAST = 6.0


class BlindWatch:
    """Holds the time since which no frame had a picture, nothing else."""

    def __init__(self) -> None:
        self._since_ns: int | None = None
        self._heard_ns = 0

    def sees_nothing(self, frame: Frame) -> bool:
        """Whether a frame has no picture in it: that it shows no smoke then says nothing."""
        self._heard_ns = frame.stamp_ns
        if has_picture(frame):
            self._since_ns = None
        elif self._since_ns is None:
            self._since_ns = frame.stamp_ns
        return self._since_ns is not None

    def is_blind(self) -> bool:
        """Whether no frame over a second had a picture."""
        return self._since_ns is not None and self._heard_ns - self._since_ns > BLIND_NS


def has_picture(frame: Frame) -> bool:
    """Whether there is contrast beside the noise; so it is taken for granted where only a recorded mask exists."""
    return frame.image is None or contrast(frame.image) >= _LEAST_CONTRAST


def contrast(image: NDArray[np.uint8]) -> float:
    """The spread of the blocks' means over an image (H, W, 3) in grey levels, of the channel where it is largest."""
    rows = image[:: max(1, image.shape[0] // (_BLOCKS[1] * _ROWS))]
    means = cv2.resize(rows, _BLOCKS, interpolation=cv2.INTER_AREA)
    by_mean = np.sort(means.reshape(_BLOCKS[0] * _BLOCKS[1], -1).astype(np.float64), axis=0)
    return float(np.max(by_mean[-1 - _BEYOND] - by_mean[_BEYOND]))
