"""What a command's pictures are before they are decoded, and how that is done. Free of I/O."""

from dataclasses import dataclass
from enum import Enum
from typing import Protocol

import cv2
import numpy as np
from numpy.typing import NDArray

from service.common.image_header import fault_of
from service.common.image_size import size_from_header

_REDUCED = ((8, cv2.IMREAD_REDUCED_COLOR_8), (4, cv2.IMREAD_REDUCED_COLOR_4), (2, cv2.IMREAD_REDUCED_COLOR_2))


class FormatError(Exception):
    """What comes is not what was told: begins with a verb whose subject is the command."""


class PictureError(Exception):
    """One picture that cannot be used; those after it may."""


class Encoded(Protocol):
    """A whole picture as it came."""

    @property
    def size_px(self) -> tuple[int, int]:
        """Width and height, without decoding it; PictureError where it does not say them."""
        ...

    def decoded(self, least_width: int) -> NDArray[np.uint8]:
        """As BGR (H, W, 3), PictureError where that cannot be done.

        A decoder that can make it smaller by a whole number on the way does so while `least_width` columns are left; 0:
        it does not.
        """
        ...


class Layout(Enum):
    """How a raw frame's bytes lie."""

    BGR = "bgr"
    NV12 = "nv12"
    I420 = "i420"

    def bytes_of(self, size_px: tuple[int, int]) -> int:
        """How many one frame has."""
        pixels = size_px[0] * size_px[1]
        return 3 * pixels if self is Layout.BGR else pixels * 3 // 2


@dataclass(frozen=True, slots=True)
class Planes:
    """A raw frame's bytes."""

    data: NDArray[np.uint8]
    size_px: tuple[int, int]
    layout: Layout

    def decoded(self, least_width: int) -> NDArray[np.uint8]:
        """As BGR; in full."""
        width, height = self.size_px
        if self.layout is Layout.BGR:
            return self.data.reshape(height, width, 3)
        conversion = cv2.COLOR_YUV2BGR_NV12 if self.layout is Layout.NV12 else cv2.COLOR_YUV2BGR_I420
        return np.asarray(cv2.cvtColor(self.data.reshape(height * 3 // 2, width), conversion), np.uint8)


@dataclass(frozen=True, slots=True)
class Jpeg:
    """One JPEG of a row of them."""

    data: bytes

    @property
    def size_px(self) -> tuple[int, int]:
        """By its header."""
        found = size_from_header(self.data)
        if found is None:
            raise PictureError("a JPEG does not say its size")
        return found

    def decoded(self, least_width: int) -> NDArray[np.uint8]:
        """At a half, a quarter or an eighth where that divides it and has at least `least_width` columns."""
        if fault := fault_of(self.data):
            raise PictureError(f"a JPEG {fault}")
        width, height = self.size_px
        flags = (flag for by, flag in _REDUCED if width >= by * least_width and not (width % by or height % by))
        how = next(flags, cv2.IMREAD_COLOR) if least_width else cv2.IMREAD_COLOR
        try:
            image = cv2.imdecode(np.frombuffer(self.data, np.uint8), how | cv2.IMREAD_IGNORE_ORIENTATION)
        except cv2.error as error:
            raise PictureError("a JPEG cannot be decoded") from error
        if image is None:
            raise PictureError("a JPEG cannot be decoded")
        return np.asarray(image, np.uint8)
