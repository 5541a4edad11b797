"""Notices a camera that gives the same picture again and again; the app asks for each frame. Free of I/O."""

import numpy as np
from numpy.typing import NDArray

from service.common.messages import Frame

FROZEN_NS = 1_000_000_000
_ROWS = 16  # every so many rows are compared first: a sensor's noise alone changes all of them


class FreezeWatch:
    """Holds the last picture that was new, nothing else."""

    def __init__(self) -> None:
        self._image: NDArray[np.uint8] | None = None
        self._changed_ns = 0
        self._heard_ns = 0

    def is_repeated(self, frame: Frame) -> bool:
        """Whether a frame's picture is the one before it: it was not taken when its stamp says."""
        image, last = frame.image, self._image
        self._heard_ns = frame.stamp_ns
        if image is not None and last is not None and _is_same(image, last):
            return True
        self._image, self._changed_ns = image, frame.stamp_ns
        return False

    def is_frozen(self) -> bool:
        """Whether the picture has not changed over a second of frames."""
        return self._heard_ns - self._changed_ns > FROZEN_NS


def _is_same(image: NDArray[np.uint8], last: NDArray[np.uint8]) -> bool:
    return np.array_equal(image[::_ROWS], last[::_ROWS]) and np.array_equal(image, last)
