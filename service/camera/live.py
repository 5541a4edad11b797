"""Frames of a camera or a network stream, which may be lost and come back; `open_source` makes them."""

import logging
import random
import threading
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np

from distloc.geometry.camera import Camera
from service.camera.retries import Retries
from service.camera.source import Clock, Closing, SourceError
from service.camera.thinning import Thinning
from service.common.messages import Frame
from service.common.redact import redacted

log = logging.getLogger(__name__)

_MJPG = cv2.VideoWriter.fourcc(*"MJPG")
_ASKED = (cv2.CAP_PROP_FOURCC, cv2.CAP_PROP_FRAME_WIDTH, cv2.CAP_PROP_FRAME_HEIGHT, cv2.CAP_PROP_FPS)
_LEAST_SHARE = 0.9  # of the rate asked for


class CaptureSource(Closing):
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
        self._thinning = Thinning(fps)
        self._closed = threading.Event()
        self._open = open_capture or opened_capture
        self._wait = wait or self._closed.wait
        self._retries = Retries(rng)
        self._number = 0
        self.reconnects = 0
        if not is_awaited and device_or_url.startswith("/") and not Path(device_or_url).exists():
            raise SourceError(f"camera.source.path is {redacted(device_or_url)}: no such device")
        self._capture = self._open(device_or_url)
        if not is_awaited and not self._capture.isOpened():
            raise SourceError(
                f"camera.source.path is {redacted(device_or_url)}: cannot be opened as a camera or stream"
            )

    def read(self) -> Frame | None:
        """The next frame, waiting for the camera to come back if need be; None once closed."""
        while not self._closed.is_set():
            if not self._capture.grab():
                self._reconnect()
                continue
            stamp_ns = self._clock() - self._latency_ns
            self._retries.reset()
            if not self._thinning.takes(stamp_ns):
                continue
            ok, image = self._capture.retrieve()
            self._number += 1
            if not ok or image is None:
                self._refuse("it cannot be decoded")
            elif self._accepts(image):
                return Frame(stamp_ns, f"{self._number:06d}", np.asarray(image, dtype=np.uint8))
        self._capture.release()
        return None

    def close(self) -> None:
        """End; the device is released by the reading thread, as OpenCV's captures are not safe across threads."""
        self._closed.set()

    def _reconnect(self) -> None:
        self._capture.release()
        if self._wait(self._retries.next_s()):
            return
        self.reconnects += 1
        self._capture = self._open(self._name)


def opened_capture(device_or_url: str) -> cv2.VideoCapture:
    """A device by number or path, or a stream."""
    if device_or_url.isdecimal():
        capture = cv2.VideoCapture(int(device_or_url), cv2.CAP_ANY)
    elif "://" in device_or_url:
        limits = [cv2.CAP_PROP_OPEN_TIMEOUT_MSEC, 5000, cv2.CAP_PROP_READ_TIMEOUT_MSEC, 5000]
        return cv2.VideoCapture(device_or_url, cv2.CAP_FFMPEG, limits)
    else:
        capture = cv2.VideoCapture(device_or_url, cv2.CAP_V4L2)
    capture.set(cv2.CAP_PROP_BUFFERSIZE, 1)  # old frames in a queue would make the stamp wrong
    return capture


def asked_capture(device: str, width: int, height: int, fps: float) -> cv2.VideoCapture:
    """A V4L2 device asked for a size, a rate and MJPG, else it gives 640 x 480; the log says what it gives instead."""
    capture = opened_capture(device)
    wanted = (_MJPG, width, height, fps)
    for key, value in zip(_ASKED, wanted, strict=True):  # the format first: it decides which sizes there are
        capture.set(key, value)
    if not capture.isOpened():
        return capture
    fourcc, *got = (float(capture.get(key)) for key in _ASKED)
    if got[:2] != [width, height] or got[2] < _LEAST_SHARE * fps or int(fourcc) != _MJPG:
        log.warning(
            "%s: asked for MJPG of %d x %d, %g a second; it gives %s of %.0f x %.0f, %g a second",
            *(device, width, height, fps, _name_of(fourcc), *got),
        )
    return capture


def _name_of(fourcc: float) -> str:
    letters = int(fourcc).to_bytes(8, "little", signed=True)[:4].decode("ascii", errors="replace") if fourcc else ""
    return letters if letters.isprintable() and letters else "another format"
