"""A TAK server as a test needs it: real sockets, and the manners that the test gives it."""

import contextlib
import re
import select
import socket
import ssl
import threading
from collections.abc import Callable

from tests.support.places import HANG_S
from tests.support.shared_fires import Drawn, drawn

Talk = Callable[[socket.socket], None]


class Server:
    """Accepts on a port of its own and lets `talk` have each connection; keeps what it heard."""

    def __init__(self, talk: Talk | None = None, port: int = 0, context: ssl.SSLContext | None = None) -> None:
        self.heard = bytearray()
        self.connections = 0
        self._talk, self._context = talk or self._listen, context
        self._ends = threading.Event()
        self._socket = socket.create_server(("127.0.0.1", port))
        self.port = self._socket.getsockname()[1]
        self._thread = threading.Thread(target=self._accept, daemon=True)
        self._thread.start()

    def __enter__(self) -> "Server":
        return self

    def __exit__(self, *_exception: object) -> None:
        self._ends.set()
        self._thread.join(HANG_S)
        self._socket.close()

    def events(self) -> list[Drawn]:
        return [drawn(one) for one in re.findall(rb"<event.*?</event>", bytes(self.heard), re.DOTALL)]

    def _accept(self) -> None:
        while not self._ends.is_set():
            if not select.select([self._socket], [], [], 0.02)[0]:
                continue
            made, _ = self._socket.accept()
            self.connections += 1
            with contextlib.suppress(OSError), contextlib.closing(self._secured(made)) as connection:
                self._talk(connection)

    def _secured(self, made: socket.socket) -> socket.socket:
        return made if self._context is None else self._context.wrap_socket(made, server_side=True)

    def _listen(self, connection: socket.socket) -> None:
        connection.settimeout(0.02)
        while not self._ends.is_set():
            with contextlib.suppress(TimeoutError):
                data = connection.recv(65_536)
                if not data:
                    return
                self.heard += data

    def hold(self, _connection: socket.socket) -> None:
        self._ends.wait(HANG_S)
