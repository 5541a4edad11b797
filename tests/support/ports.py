"""Ports that nobody else takes between the asking and the binding, though tests run side by side."""

import itertools
import os
import socket

_FIRST, _A_PROCESS = 11_000, 1_000  # below those that the system gives to whoever asks for any
_WORKER = int(os.environ.get("PYTEST_XDIST_WORKER", "gw20").removeprefix("gw")) % 21  # 20: nothing runs beside it
_numbers = itertools.count(os.getpid() * 7)


def free_port(kind: socket.SocketKind = socket.SOCK_STREAM) -> int:
    """A TCP or UDP port on loopback of this process's own range that nobody has now."""
    for number in itertools.islice(_numbers, _A_PROCESS):
        port = _FIRST + _WORKER * _A_PROCESS + number % _A_PROCESS
        with socket.socket(socket.AF_INET, kind) as free:
            try:
                free.bind(("127.0.0.1", port))
            except OSError:
                continue
            return port
    raise OSError("no port of this process's range is free")
