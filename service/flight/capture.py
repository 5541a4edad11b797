"""Reads the camera on a thread of its own and hands each frame to the event loop; the app starts and ends it."""

import asyncio
import contextlib
import logging
import threading
import time
from collections.abc import Callable

from service.camera.sources import FrameSource, SourceError
from service.common.messages import Frame

log = logging.getLogger(__name__)

_RETRY_S = 1.0
_READ_S = 0.5  # of a frame that comes
_SHUTDOWN_S = 5.0
_STARTING_S = 30.0  # a camera that does not fit the config by then ends the service; one that comes later does not


class Capture:
    """`on_frame`, and `on_error` once the source cannot be used, are called on the event loop that makes it.

    `error` is then why: the config does not fit what the source gives. That is told at the start alone. In flight, and
    where a flight is resumed after a crash, it ends nothing: such frames are bad ones, and the status says "camera".
    """

    def __init__(
        self,
        source: FrameSource,
        on_frame: Callable[[Frame], None],
        on_error: Callable[[], None],
        is_resuming: bool = False,
        clock_s: Callable[[], float] = time.monotonic,
    ) -> None:
        self.error: SourceError | None = None
        self._source, self._on_frame, self._on_error = source, on_frame, on_error
        self._clock_s, self._began_s, self._is_resuming = clock_s, clock_s(), is_resuming
        self._loop = asyncio.get_running_loop()
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._read, name="camera", daemon=True)

    def start(self) -> None:
        """Begin to read."""
        self._thread.start()

    def stop(self) -> None:
        """Take no further frame."""
        self._ended.set()

    async def close(self) -> None:
        """End the thread and let the camera go."""
        await asyncio.to_thread(self._thread.join, _READ_S)
        self._source.close()  # ends a read that waits for a lost camera: a thread inside OpenCV at exit aborts it
        await asyncio.to_thread(self._thread.join, _SHUTDOWN_S)

    def _read(self) -> None:
        has_failed = False
        while not self._ended.is_set():
            try:
                frame = self._source.read()
            except SourceError as error:
                if self._is_resuming or self._clock_s() - self._began_s > _STARTING_S:
                    if not has_failed:
                        log.error("the camera's frames are not used: %s", error)
                    has_failed = True
                    self._ended.wait(_RETRY_S)
                    continue
                self.error = error
                with contextlib.suppress(RuntimeError):
                    self._loop.call_soon_threadsafe(self._on_error)
                return
            except Exception:  # the service goes on without its camera; the status says "camera"
                if not has_failed:
                    log.exception("the camera failed")
                has_failed = True
                self._ended.wait(_RETRY_S)
                continue
            has_failed = False
            if frame is None:
                log.info("the camera's frames have ended")
                return
            with contextlib.suppress(RuntimeError):  # the loop closed between the two lines
                self._loop.call_soon_threadsafe(self._on_frame, frame)
