"""Stands between an RTSP client and its server on loopback, and loses a share of the RTP packets that go over UDP.

The client connects here; SETUP's client ports are replaced with the relay's own. Over TCP nothing is lost.
"""

import random
import re
import select
import socket
import threading

_PORTS = re.compile(rb"client_port=(\d+)-(\d+)")


class LossyRelay:
    """Of one client at a time, one thread; `loss` may be changed while it runs."""

    def __init__(self, server_port: int, loss: float, seed: int = 0) -> None:
        self.loss, self.passed, self.lost = loss, 0, 0
        self._server_port = server_port
        self._rng = random.Random(seed)
        self._listening = socket.create_server(("127.0.0.1", 0))
        self.port = int(self._listening.getsockname()[1])
        self._stop, self._stopper = socket.socketpair()
        self._ways: dict[socket.socket, tuple[socket.socket, tuple[str, int] | None]] = {}
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def __enter__(self) -> "LossyRelay":
        return self

    def __exit__(self, *_: object) -> None:
        self._stopper.send(b"x")
        self._thread.join()
        for one in (*self._ways, self._listening, self._stop, self._stopper):
            one.close()

    def _run(self) -> None:
        while True:
            ready, _, _ = select.select([self._listening, self._stop, *self._ways], [], [])
            if self._stop in ready:
                return
            for one in ready:
                if one is self._listening:
                    self._accept()
                elif one in self._ways:
                    self._pass_on(one)

    def _accept(self) -> None:
        client, _ = self._listening.accept()
        for one in self._ways:
            one.close()
        self._ways = {}
        try:
            server = socket.create_connection(("127.0.0.1", self._server_port))
        except OSError:
            client.close()
            return
        self._ways = {client: (server, None), server: (client, None)}
        self._client = client

    def _pass_on(self, one: socket.socket) -> None:
        other, to = self._ways[one]
        try:
            data = one.recv(65536)
            if to is not None:
                is_lost = self._rng.random() < self.loss
                self.lost, self.passed = self.lost + is_lost, self.passed + (not is_lost)
                if not is_lost:
                    other.sendto(data, to)
            elif data:
                other.sendall(_PORTS.sub(self._relayed, data) if one is self._client else data)
            else:
                raise ConnectionError
        except OSError:
            if to is None:
                for way in self._ways:
                    way.close()
                self._ways = {}

    def _relayed(self, found: re.Match[bytes]) -> bytes:
        """Ports of ours in the client's place: RTP on an even one, RTCP beside it, which loses nothing."""
        while True:
            rtp, rtcp = (socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(2))
            rtp.bind(("127.0.0.1", 0))
            port = int(rtp.getsockname()[1])
            try:
                if port % 2:
                    raise OSError
                rtcp.bind(("127.0.0.1", port + 1))
                break
            except OSError:
                rtp.close()
                rtcp.close()
        self._ways[rtp] = (rtp, ("127.0.0.1", int(found[1])))
        self._ways[rtcp] = (rtcp, ("127.0.0.1", int(found[2])))
        return b"client_port=%d-%d" % (port, port + 1)
