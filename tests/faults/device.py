"""A camera device as OpenCV shows it, looking at the scene: JPEGs really encoded and decoded, and faults on order."""

import threading
import time

import cv2
import numpy as np
from numpy.typing import NDArray

from distloc.simulation.renderer import Renderer
from service.scenario import Scenario, camera_pose, plumes

Image = NDArray[np.uint8]


class Device:
    """What is at the end of the cable; `open` is what CaptureSource calls in place of cv2.VideoCapture."""

    def __init__(self, scenario: Scenario, start_ns: int, is_plugged: bool = True) -> None:
        self.is_plugged = is_plugged
        self.is_frozen = False
        self.is_corrupt = False
        self.period_s = 1.0 / scenario.fps
        self.size: tuple[int, int] | None = None  # another width and height than the camera's
        self.given = 0
        self._scenario, self._start_ns = scenario, start_ns
        self._renderer = Renderer(scenario.camera.camera(), plumes(scenario), np.random.default_rng(5))
        self._rng = np.random.default_rng(6)
        self._last = b""
        self._ended = threading.Event()

    def open(self, _name: str) -> "Capture":
        """A new handle."""
        return Capture(self)

    def close(self) -> None:
        """A read that waits ends."""
        self._ended.set()

    def wait_for_exposure(self, since_s: float) -> bool:
        """Until a frame is due after the last; False once the device is gone."""
        due_s = since_s + self.period_s
        while self.is_plugged and not self._ended.is_set():
            left_s = min(due_s, since_s + self.period_s) - time.monotonic()
            if left_s <= 0.0:
                return True
            self._ended.wait(min(left_s, 0.05))
        return False

    def picture(self, exposed_ns: int) -> Image | None:
        """The frame exposed then, through JPEG; None where it cannot be decoded."""
        if not (self.is_frozen and self._last):
            t_s = (exposed_ns - self._start_ns) * 1e-9
            image, _ = self._renderer.render(camera_pose(self._scenario, t_s, t_s))
            if self.size is not None:
                image = np.asarray(cv2.resize(image, self.size), dtype=np.uint8)
            self._last = cv2.imencode(".jpg", image)[1].tobytes()
        self.given += 1
        data = self._spoilt(self._last) if self.is_corrupt else self._last
        decoded = cv2.imdecode(np.frombuffer(data, dtype=np.uint8), cv2.IMREAD_COLOR)
        return None if decoded is None else np.asarray(decoded, dtype=np.uint8)

    def _spoilt(self, jpeg: bytes) -> bytes:
        """In turn: without its beginning, cut in the middle, with wrong bytes in the scan."""
        kind = self.given % 3
        if kind == 0:
            return jpeg[100:]
        if kind == 1:
            return jpeg[: len(jpeg) // 2]
        data = np.frombuffer(jpeg, dtype=np.uint8).copy()
        data[self._rng.integers(len(data) // 3, len(data), 40)] = self._rng.integers(0, 255, 40)
        return data.tobytes()


class Capture:
    """The part of cv2.VideoCapture that the source uses."""

    def __init__(self, device: Device) -> None:
        self._device = device
        self._is_open = device.is_plugged
        self._grabbed_s = time.monotonic()
        self._exposed_ns = 0

    def isOpened(self) -> bool:
        return self._is_open

    def grab(self) -> bool:
        """Wait for the next exposure."""
        if not self._is_open or not self._device.wait_for_exposure(self._grabbed_s):
            self._is_open = False
            return False
        self._grabbed_s = time.monotonic()
        self._exposed_ns = time.monotonic_ns()
        return True

    def retrieve(self) -> tuple[bool, Image | None]:
        """The frame of the last exposure."""
        image = self._device.picture(self._exposed_ns)
        return image is not None, image

    def release(self) -> None:
        self._is_open = False
