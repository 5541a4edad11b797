"""What every source of frames is, and the part that they share."""

from collections import Counter
from collections.abc import Callable
from types import TracebackType
from typing import Any, Protocol, Self

from numpy.typing import NDArray

from distloc.geometry.camera import Camera
from distloc.types import RejectReason
from service.common.messages import Frame
from service.config.sections import ConfigError

Clock = Callable[[], int]


class SourceError(Exception):
    """The source of frames cannot be used: one line that names the key, what it has and what is wrong."""


class SizeError(SourceError, ConfigError):
    """The source gives another size than the config's camera has: as a wrong key is, it is the config's fault."""


def fits(camera: Camera, image: NDArray[Any]) -> bool:
    """Whether an image (H, W, ...) has the calibrated size over a whole number: the calibration then holds for it."""
    height, width = int(image.shape[0]), int(image.shape[1])
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
        """Whether the size is the camera's over a whole number; SizeError at the first frame, counted later."""
        height, width = image.shape[0], image.shape[1]
        camera, is_first, self._is_first = self._camera, self._is_first, False
        if camera is None or fits(camera, image):
            return True
        if is_first:
            raise SizeError(
                f"camera.width, camera.height are {camera.width} x {camera.height}: "
                f"the source gives {width} x {height}, "
                "which must be that size or a whole fraction of it"
            )
        self.rejected[RejectReason.BAD_FRAME] += 1
        return False
