"""A camera device as OpenCV shows it, looking at the scene, that can be unplugged and spoilt."""

import threading
import time

from service.simulator.scenario import Scenario
from service.simulator.spoilable_camera import Image, SpoilableCamera


class Device(SpoilableCamera):
    """What is at the end of the cable; `open` is what CaptureSource calls in place of cv2.VideoCapture."""

    def __init__(self, scenario: Scenario, start_ns: int, is_plugged: bool = True) -> None:
        super().__init__(scenario, start_ns)
        self.is_plugged = is_plugged
        self.period_s = 1.0 / scenario.fps
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
