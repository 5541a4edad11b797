"""A serial port behind two threads, a carrier for a link; imports pyserial only when one is configured."""

import asyncio
import queue
import threading
from collections.abc import Callable
from typing import Any

from service.mavlink.carrier import READ_BYTES, LinkError

TIMEOUT_S = 0.2
MOST_QUEUED = 256


def require_pyserial(name: str) -> None:
    """Raise LinkError where pyserial is missing."""
    try:
        import serial  # noqa: F401
    except ImportError as error:
        mend = "pip install '.[serial]' in distloc's folder, with its own virtual environment's pip"
        raise LinkError(f"{name}: needs pyserial: {mend}") from error


class SerialCarrier:
    """An open port: one thread reads, one writes; both end within 0.2 s of `close`."""

    def __init__(self, device: Any, received: Callable[[bytes], bool]) -> None:
        self.port = int(device.baudrate)
        self._device = device
        self._received = received
        self._loop = asyncio.get_running_loop()
        self._closed: asyncio.Future[None] = self._loop.create_future()
        self._outgoing: queue.Queue[bytes] = queue.Queue(MOST_QUEUED)
        self._stop = threading.Event()
        self._turns = [0, 0]  # of the reading and the writing thread
        self._turns_asked = [-1, -1]
        self._threads = [
            threading.Thread(target=self._guard, args=(number, part), daemon=True)
            for number, part in enumerate((self._read, self._write))
        ]
        for thread in self._threads:
            thread.start()

    @classmethod
    async def open(cls, path: str, baud: int, received: Callable[[bytes], bool]) -> "SerialCarrier":
        """Open the port; raises OSError (pyserial's errors are)."""
        import serial

        try:
            device = await asyncio.to_thread(serial.Serial, path, baud, timeout=TIMEOUT_S, write_timeout=TIMEOUT_S)
        except ValueError as error:
            raise OSError(f"{path}: {error}") from error
        return cls(device, received)

    async def wait_closed(self) -> None:
        """Until the device is gone."""
        await self._closed

    def write(self, data: bytes) -> bool:
        """Queue the bytes; False if the queue is full."""
        try:
            self._outgoing.put_nowait(data)
        except queue.Full:
            return False
        return True

    def is_moving(self) -> bool:
        """Whether both threads went round since the last call: a driver that hangs holds one up for ever."""
        turns, asked = list(self._turns), self._turns_asked
        if turns[0] == asked[0] or turns[1] == asked[1]:
            return False
        self._turns_asked = turns
        return True

    def close(self) -> None:
        """Tell the threads to end; the last of them closes the port."""
        self._stop.set()

    def _read(self) -> None:
        data = self._device.read(min(max(1, self._device.in_waiting), READ_BYTES))
        if data:
            self._loop.call_soon_threadsafe(self._received, bytes(data))

    def _write(self) -> None:
        try:
            self._device.write(self._outgoing.get(timeout=TIMEOUT_S))
        except queue.Empty:
            return

    def _guard(self, number: int, part: Callable[[], None]) -> None:
        """Repeat one thread's part until told to stop or the device or the event loop is gone."""
        reason = "stopped"
        try:
            while not self._stop.is_set():
                part()
                self._turns[number] += 1
        except (OSError, RuntimeError, TypeError) as error:  # TypeError: pyserial on a port closed meanwhile
            reason = str(error)
        self._stop.set()
        if part == self._read:
            self._device.close()
        if not self._loop.is_closed():
            self._loop.call_soon_threadsafe(self._finish, reason)

    def _finish(self, reason: str) -> None:
        if not self._closed.done():
            self._closed.set_exception(OSError(reason))
            self._closed.exception()  # seen: a carrier that nobody waits for any more may end quietly
