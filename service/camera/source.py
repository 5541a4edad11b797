"""What every source of frames is, and the part that they share."""

import logging
from collections import Counter
from collections.abc import Callable
from types import TracebackType
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from distloc.backports import Self
from distloc.geometry.camera import Camera
from distloc.types import RejectReason
from service.common.messages import Frame
from service.config.sections import ConfigError

log = logging.getLogger(__name__)

Clock = Callable[[], int]


class SourceError(Exception):
    """The source of frames cannot be used: one line that names the key, what it has and what is wrong."""


class SizeError(SourceError, ConfigError):
    """The source gives another size than the config's camera has: as a wrong key is, it is the config's fault."""


def fits(camera: Camera, image: NDArray[Any]) -> bool:
    """Whether an image (H, W, ...) has the calibrated size over a whole number: the calibration then holds for it."""
    return fits_size(camera, (int(image.shape[1]), int(image.shape[0])))


def fits_size(camera: Camera, size_px: tuple[int, int]) -> bool:
    """The same by width and height."""
    width, height = size_px
    if not (height and width):
        return False
    return camera.width % width == 0 and camera.height % height == 0 and camera.width * height == camera.height * width


class FrameSource(Protocol):
    """Gives frames until its end; `rejected` counts what it had to drop."""

    rejected: Counter[RejectReason]

    def read(self) -> Frame | None:
        """The next frame, None at the end."""
        ...

    def close(self) -> None:
        """Let the device or file go; a blocked `read` ends."""
        ...

    def __enter__(self) -> Self: ...

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None: ...


class Closing:
    """The part that the sources share: the count, the size check and the `with` statement."""

    def __init__(self, camera: Camera | None) -> None:
        self.rejected: Counter[RejectReason] = Counter()
        self._camera = camera
        self._is_first = True

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Let go of what the source holds."""

    def _accepts(self, image: NDArray[Any]) -> bool:
        """Whether it is a BGR picture whose size is the camera's over a whole number.

        SizeError where the first frame has another size; counted later, as is what is no such picture.
        """
        if image.ndim != 3 or image.shape[2] != 3 or image.dtype != np.uint8:
            self._is_first = False
            self._refuse(f"an image of {image.shape} {image.dtype} is none in BGR of 8 bits")
            return False
        return self._accepts_size((int(image.shape[1]), int(image.shape[0])))

    def _accepts_size(self, size_px: tuple[int, int]) -> bool:
        """Whether a width and height are the camera's over a whole number; else as above."""
        camera, is_first, self._is_first = self._camera, self._is_first, False
        if camera is None or fits_size(camera, size_px):
            return True
        self._refuse_size(camera, size_px, is_first)
        return False

    def _refuse_size(self, camera: Camera, size_px: tuple[int, int], is_first: bool) -> None:
        said = (
            f"camera.width, camera.height are {camera.width} x {camera.height}: the source gives "
            f"{size_px[0]} x {size_px[1]}, which must be that size or a whole fraction of it"
        )
        if is_first:
            raise SizeError(said)
        self._refuse(said)

    def _refuse(self, why: str) -> None:
        """Count a frame that cannot be used; the first one is told."""
        if not self.rejected[RejectReason.BAD_FRAME]:
            log.warning("a frame is not used, and from now on such frames are only counted: %s", why)
        self.rejected[RejectReason.BAD_FRAME] += 1
