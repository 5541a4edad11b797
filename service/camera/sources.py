"""Where frames come from: a folder, a video file, a camera or a network stream; the pipeline reads them."""

import random
import threading
from collections import Counter
from collections.abc import Callable
from itertools import islice
from pathlib import Path
from types import TracebackType
from typing import Any, Protocol, Self

import cv2
import numpy as np
from numpy.typing import NDArray

from distloc.geometry.camera import Camera
from distloc.types import RejectReason
from service.common.files import read_image
from service.common.messages import Frame
from service.config.sections import SourceConfig

Clock = Callable[[], int]
_SUFFIXES = {".jpg", ".jpeg", ".png", ".bmp", ".tif", ".tiff"}
_MAX_FILES = 1_000_000
_FIRST_DELAY_S, _MAX_DELAY_S = 0.5, 5.0  # a camera that is back gives frames within 10 s


class SourceError(Exception):
    """The source of frames cannot be used: one line that names the key, what it has and what is wrong."""


def fits(camera: Camera, image: NDArray[Any]) -> bool:
    """Whether an image (H, W, ...) has the calibrated size over a whole number: the calibration then holds for it."""
    height, width = int(image.shape[0]), int(image.shape[1])
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


class _Closing:
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
        """Whether the size is the camera's over a whole number; SourceError at the first frame, counted later."""
        height, width = image.shape[0], image.shape[1]
        camera, is_first, self._is_first = self._camera, self._is_first, False
        if camera is None or fits(camera, image):
            return True
        if is_first:
            raise SourceError(
                f"camera.width, camera.height are {camera.width} x {camera.height}: "
                f"the source gives {width} x {height}, "
                "which must be that size or a whole fraction of it"
            )
        self.rejected[RejectReason.BAD_FRAME] += 1
        return False


class NoSource:
    """No camera: ends at once."""

    def __init__(self) -> None:
        self.rejected: Counter[RejectReason] = Counter()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def read(self) -> Frame | None:
        """None."""
        return None

    def close(self) -> None:
        """Nothing to close."""


class FolderSource(_Closing):
    """The images of a folder by name, stamped `fps` a second from the clock's time at the first read."""

    def __init__(self, folder: Path, fps: float, clock: Clock, camera: Camera | None = None) -> None:
        super().__init__(camera)
        if not folder.is_dir():
            raise SourceError(f"camera.source.path is {folder}: no such folder")
        found = (path for path in folder.iterdir() if path.suffix.lower() in _SUFFIXES)
        self._paths = iter(sorted(islice(found, _MAX_FILES)))
        self._period_ns = round(1e9 / fps)
        self._clock = clock
        self._next_ns: int | None = None

    def read(self) -> Frame | None:
        """The next image that can be decoded; the others are counted as bad frames."""
        if self._next_ns is None:
            self._next_ns = self._clock()
        for path in self._paths:
            stamp_ns, self._next_ns = self._next_ns, self._next_ns + self._period_ns
            image = read_image(path)
            if image is None:
                self.rejected[RejectReason.BAD_FRAME] += 1
            elif self._accepts(image):
                return Frame(stamp_ns, path.name, image)
        return None

    def close(self) -> None:
        """End the folder."""
        self._paths = iter(())


class VideoSource(_Closing):
    """A video file's frames, at most `fps` a second of the film's own time, from the clock's time at the first read."""

    def __init__(self, path: Path, fps: float, clock: Clock, camera: Camera | None = None) -> None:
        super().__init__(camera)
        if not path.is_file():
            raise SourceError(f"camera.source.path is {path}: no such file")
        self._capture = cv2.VideoCapture(str(path))
        if not self._capture.isOpened():
            raise SourceError(f"camera.source.path is {path}: not a video that OpenCV can read")
        film_fps = float(self._capture.get(cv2.CAP_PROP_FPS))
        self._film_fps = film_fps if np.isfinite(film_fps) and 0.1 < film_fps < 1000.0 else fps
        self._period_s = 1.0 / fps
        self._clock = clock
        self._start_ns: int | None = None
        self._number = 0
        self._next_s = 0.0

    def read(self) -> Frame | None:
        """The next frame that is due."""
        if self._start_ns is None:
            self._start_ns = self._clock()
        while self._capture.grab():
            number, time_s = self._number, self._number / self._film_fps
            self._number += 1
            if time_s < self._next_s - 1e-6:
                continue
            self._next_s += self._period_s
            ok, image = self._capture.retrieve()
            if not ok:
                self.rejected[RejectReason.BAD_FRAME] += 1
            elif self._accepts(image):
                return Frame(self._start_ns + round(time_s * 1e9), f"{number:06d}", np.asarray(image, dtype=np.uint8))
        return None

    def close(self) -> None:
        """Release the file."""
        self._capture.release()


class CaptureSource(_Closing):
    """A V4L2 device or an RTSP stream, opened again with growing, jittered delays when it is lost.

    Frames are stamped with the clock at their arrival less `latency_ns`. Only `close` ends it. One that cannot be
    opened at first raises SourceError, unless `is_awaited`. `open_capture` and `wait` (which returns True when closed)
    can be replaced in tests.
    """

    def __init__(
        self,
        device_or_url: str,
        latency_ns: int,
        clock: Clock,
        camera: Camera | None = None,
        open_capture: Callable[[str], cv2.VideoCapture] | None = None,
        wait: Callable[[float], bool] | None = None,
        rng: random.Random | None = None,
        fps: float | None = None,
        is_awaited: bool = False,
    ) -> None:
        super().__init__(camera)
        self._name = device_or_url
        self._latency_ns = latency_ns
        self._clock = clock
        self._period_ns = 0 if fps is None else round(1e9 / fps)
        self._closed = threading.Event()
        self._open = open_capture or _opened
        self._wait = wait or self._closed.wait
        self._rng = rng or random.Random()
        self._delay_s = _FIRST_DELAY_S
        self._number = 0
        self._due_ns: int | None = None
        self.reconnects = 0
        if not is_awaited and device_or_url.startswith("/") and not Path(device_or_url).exists():
            raise SourceError(f"camera.source.path is {device_or_url}: no such device")
        self._capture = self._open(device_or_url)
        if not is_awaited and not self._capture.isOpened():
            raise SourceError(f"camera.source.path is {device_or_url}: cannot be opened as a camera or stream")

    def read(self) -> Frame | None:
        """The next frame, waiting for the camera to come back if need be; None once closed."""
        while not self._closed.is_set():
            if not self._capture.grab():
                self._reconnect()
                continue
            stamp_ns = self._clock() - self._latency_ns
            self._delay_s = _FIRST_DELAY_S
            # a tenth of a period early is still this turn: the camera's own rate jitters
            if self._due_ns is not None and stamp_ns < self._due_ns - self._period_ns // 10:
                continue
            late = self._due_ns is None or stamp_ns > self._due_ns + self._period_ns
            self._due_ns = (stamp_ns if late or self._due_ns is None else self._due_ns) + self._period_ns
            ok, image = self._capture.retrieve()
            self._number += 1
            if not ok or image is None:
                self.rejected[RejectReason.BAD_FRAME] += 1
            elif self._accepts(image):
                return Frame(stamp_ns, f"{self._number:06d}", np.asarray(image, dtype=np.uint8))
        self._capture.release()
        return None

    def close(self) -> None:
        """End; the device is released by the reading thread, as OpenCV's captures are not safe across threads."""
        self._closed.set()

    def _reconnect(self) -> None:
        self._capture.release()
        if self._wait(self._delay_s * self._rng.uniform(0.5, 1.0)):
            return
        self._delay_s = min(2.0 * self._delay_s, _MAX_DELAY_S)
        self.reconnects += 1
        self._capture = self._open(self._name)


def open_source(config: SourceConfig, camera: Camera, clock_ns: Clock, is_awaited: bool = False) -> FrameSource:
    """The source that a configuration asks for; SourceError in one line where it is missing.

    With `is_awaited` a camera or stream may be missing at first: it is tried again like one that was lost.
    """
    if config.kind == "none":
        return NoSource()
    if config.kind == "folder":
        return FolderSource(Path(config.path), config.fps, clock_ns, camera)
    if config.kind == "video":
        return VideoSource(Path(config.path), config.fps, clock_ns, camera)
    latency_ns = round(config.latency_ms * 1e6)
    return CaptureSource(config.path, latency_ns, clock_ns, camera, fps=config.fps, is_awaited=is_awaited)


def _opened(device_or_url: str) -> cv2.VideoCapture:
    if device_or_url.isdecimal():
        capture = cv2.VideoCapture(int(device_or_url), cv2.CAP_ANY)
    elif "://" in device_or_url:
        limits = [cv2.CAP_PROP_OPEN_TIMEOUT_MSEC, 5000, cv2.CAP_PROP_READ_TIMEOUT_MSEC, 5000]
        return cv2.VideoCapture(device_or_url, cv2.CAP_FFMPEG, limits)
    else:
        capture = cv2.VideoCapture(device_or_url, cv2.CAP_V4L2)
    capture.set(cv2.CAP_PROP_BUFFERSIZE, 1)  # old frames in a queue would make the stamp wrong
    return capture
