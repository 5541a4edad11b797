"""Starts the soak's processes and watches the service as systemd does: by its pid and by what it notifies."""

import contextlib
import json
import os
import secrets
import select
import socket
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

from service.commands.install.unit_environment import unit_environment

WATCHDOG_S = 20.0  # WatchdogSec of systemd/distloc.service
END_S = 20.0  # then it is killed


class Child:
    """A process of this package in the unit's environment; it ends when its standard input does, if we die too."""

    def __init__(self, module: str, arguments: list[str], log: Path, fds: tuple[int, ...] = (), **env: str) -> None:
        with log.open("wb") as file:
            self._process = subprocess.Popen(
                [sys.executable, "-m", f"service.commands.soak.{module}", *arguments],
                stdin=subprocess.PIPE,
                stdout=file,
                stderr=file,
                pass_fds=fds,
                env=os.environ | unit_environment() | env,
                start_new_session=True,  # Ctrl-C is for the parent alone
            )
        self.pid = self._process.pid
        self.log = log

    @property
    def exit_code(self) -> int | None:
        """None while it runs."""
        return self._process.poll()

    def order(self, **settings: object) -> None:
        """Send it a line of JSON; nothing where it is gone."""
        assert self._process.stdin is not None
        with contextlib.suppress(BrokenPipeError):
            self._process.stdin.write(json.dumps(settings).encode() + b"\n")
            self._process.stdin.flush()

    def end(self) -> int:
        """Close its standard input and wait; its exit code, negative where it had to be killed."""
        assert self._process.stdin is not None
        with contextlib.suppress(BrokenPipeError):
            self._process.stdin.close()
        try:
            return self._process.wait(END_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            return self._process.wait()


class Notified:
    """The socket of $NOTIFY_SOCKET; `listen` must be called several times a second."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        name = f"distloc-soak-{secrets.token_hex(8)}"
        self.address = f"@{name}"
        self.is_ready = False
        self.misses = 0  # times that systemd would have restarted the service
        self._fed_s = clock()
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self._socket.bind(f"\0{name}")
        self._socket.setblocking(False)

    def listen(self, wait_s: float = 0.0) -> None:
        """Take what came, waiting so long for something to come."""
        select.select([self._socket], [], [], wait_s)
        now_s = self._clock()
        with contextlib.suppress(BlockingIOError):
            while True:
                lines = self._socket.recv(4096).split(b"\n")
                self.is_ready |= b"READY=1" in lines
                if b"WATCHDOG=1" in lines or b"READY=1" in lines:
                    self._fed_s = now_s
        if self.is_ready and now_s - self._fed_s > WATCHDOG_S:
            self.misses += 1
            self._fed_s = now_s

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()
