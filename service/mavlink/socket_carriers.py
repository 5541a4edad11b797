"""UDP and TCP sockets as carriers of a link; the link opens one."""

import asyncio
import socket
from contextlib import suppress
from typing import Any, cast

from service.mavlink.carrier import MOST_PEERS, Received
from service.mavlink.framer import Framer

MOST_BUFFERED_BYTES = 65_536
MOST_DATAGRAM_BYTES = 65_536
MOST_READ_BYTES = 16_384  # of a TCP connection in one turn of the event loop
GRACE_S = 5.0  # a TCP peer that is stuck or silent for so long makes room for a new one
EXPIRY_S = 60.0  # a UDP peer from which nothing valid came for so long is answered no more
MOST_UDP_FRAMERS = 2 * MOST_PEERS  # half of them at least for senders that are not answered (yet)
# What makes the system close a connection whose other end is gone after some 30 s: probes while nothing is under way,
# and a limit on how long bytes may go unacknowledged (the probes wait for these). Where the platform has them.
KEEPALIVE = (
    ("SOL_SOCKET", "SO_KEEPALIVE", 1),
    ("IPPROTO_TCP", "TCP_KEEPIDLE", 15),  # s
    ("IPPROTO_TCP", "TCP_KEEPINTVL", 5),  # s
    ("IPPROTO_TCP", "TCP_KEEPCNT", 3),
    ("IPPROTO_TCP", "TCP_USER_TIMEOUT", 30_000),  # ms
)


class UdpCarrier(asyncio.DatagramProtocol):
    """A datagram socket; one that listens answers the last few peers that it heard."""

    def __init__(self, received: Received, listens: bool) -> None:
        self.port = 0
        self._received = received
        self._listens = listens
        self._peers: dict[Any, float] = {}  # when a valid frame last came of each
        self._framers: dict[Any, Framer] = {}  # the sender that was last heard last
        self._loop = asyncio.get_running_loop()
        self._transport: Any = None  # typeshed leaves get_write_buffer_size out of DatagramTransport
        self._closed: asyncio.Future[None] = asyncio.get_running_loop().create_future()

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """The socket is ready."""
        self._transport = transport
        self._transport.max_size = MOST_DATAGRAM_BYTES  # asyncio makes room for 256 KiB, from the system, at each read
        self.port = int(transport.get_extra_info("sockname")[1])

    def datagram_received(self, data: bytes, addr: Any) -> None:
        """Hand the bytes on and remember who sent them, unless they are refused."""
        is_new = addr not in self._peers
        if self._listens:
            self._peers[addr] = self._peers.pop(addr, self._loop.time())
        if self._received(data, self._framer_of(addr)):
            if self._listens:
                self._peers[addr] = self._loop.time()
        elif is_new:
            self._peers.pop(addr, None)
        if len(self._peers) > MOST_PEERS:
            del self._peers[next(iter(self._peers))]

    def _framer_of(self, addr: Any) -> Framer:
        framer = self._framers[addr] = self._framers.pop(addr) if addr in self._framers else Framer()
        if len(self._framers) > MOST_UDP_FRAMERS:
            del self._framers[next(one for one in self._framers if one not in self._peers)]
        return framer

    def error_received(self, exc: Exception) -> None:
        """Nobody listens there yet: normal for UDP, the next datagram tries again."""

    def connection_lost(self, exc: Exception | None) -> None:
        """The socket is gone."""
        if not self._closed.done():
            self._closed.set_result(None)

    async def wait_closed(self) -> None:
        """Until the socket is gone."""
        await self._closed

    def write(self, data: bytes) -> bool:
        """Send to the peers; False if there is none or the buffer is full."""
        transport = self._transport
        if transport is None or transport.is_closing() or transport.get_write_buffer_size() > MOST_BUFFERED_BYTES:
            return False
        oldest_s = self._loop.time() - EXPIRY_S
        self._peers = {peer: heard_s for peer, heard_s in self._peers.items() if heard_s >= oldest_s}
        for peer in self._peers if self._listens else (None,):
            transport.sendto(data, peer)
        return bool(self._peers) or not self._listens

    def is_moving(self) -> bool:
        """True: the event loop itself carries the bytes."""
        return True

    def close(self) -> None:
        """Close the socket."""
        if self._transport is not None:
            self._transport.close()


class TcpCarrier:
    """A TCP connection, or a listening socket with its few clients."""

    def __init__(self, received: Received, most: int) -> None:
        self.port = 0
        self.received = received
        self.most = most
        self.peers: list[TcpPeer] = []
        self.closed: asyncio.Future[None] = asyncio.get_running_loop().create_future()
        self.server: asyncio.Server | None = None

    def listen(self, server: asyncio.Server) -> None:
        """Keep the listening socket."""
        self.server = server
        self.port = int(server.sockets[0].getsockname()[1])

    def protocol(self) -> asyncio.BaseProtocol:
        """The protocol object of one connection."""
        return TcpPeer(self)

    async def wait_closed(self) -> None:
        """Until the connection is lost; a listening socket stays."""
        await self.closed

    def write(self, data: bytes) -> bool:
        """Send to all; False if none took it."""
        return any([peer.write(data) for peer in list(self.peers)])

    def make_room(self) -> bool:
        """Whether there is a place for one more: a peer that is stuck, or told nothing valid, gives way."""
        if len(self.peers) < self.most:
            return True
        useless = next((peer for peer in self.peers if peer.is_useless()), None)
        if useless is not None:
            useless.abort()
            self.peers.remove(useless)
        return useless is not None

    def is_moving(self) -> bool:
        """True: the event loop itself carries the bytes."""
        return True

    def close(self) -> None:
        """Close every socket."""
        if self.server is not None:
            self.server.close()
        for peer in list(self.peers):
            peer.abort()


class TcpPeer(asyncio.BufferedProtocol):
    """One connection of a `TcpCarrier`."""

    def __init__(self, owner: TcpCarrier) -> None:
        self._owner = owner
        self._loop = asyncio.get_running_loop()
        self._transport: asyncio.Transport | None = None
        self._framer = Framer()
        self._buffer = memoryview(bytearray(MOST_READ_BYTES))
        self._since_s = self._loop.time()
        self._stuck_s: float | None = None
        self._is_valid = False

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Join the owner's connections, unless they are too many."""
        self._transport = cast(asyncio.Transport, transport)
        if not self._owner.make_room():
            self._transport.abort()
            return
        _keep_alive(transport.get_extra_info("socket"))
        self._owner.peers.append(self)

    def get_buffer(self, sizehint: int) -> memoryview:
        """Where the next bytes go."""
        return self._buffer

    def buffer_updated(self, nbytes: int) -> None:
        """Hand the bytes on."""
        self._is_valid |= self._owner.received(bytes(self._buffer[:nbytes]), self._framer)

    def connection_lost(self, exc: Exception | None) -> None:
        """Leave; a client's carrier is then lost as a whole."""
        if self in self._owner.peers:
            self._owner.peers.remove(self)
        if self._owner.server is None and not self._owner.closed.done():
            self._owner.closed.set_result(None)

    def write(self, data: bytes) -> bool:
        """Send; False where the peer takes nothing. A listener's goes once it took nothing for too long."""
        transport = self._transport
        if transport is None or transport.is_closing():
            return False
        if transport.get_write_buffer_size() <= MOST_BUFFERED_BYTES:
            self._stuck_s = None
            transport.write(data)
            return True
        self._stuck_s = self._loop.time() if self._stuck_s is None else self._stuck_s
        if self._owner.server is not None and self._is_stuck():
            self.abort()
        return False

    def is_useless(self) -> bool:
        """Whether it has been stuck, or has been there without a valid frame, for some seconds."""
        return self._is_stuck() or (not self._is_valid and self._loop.time() - self._since_s > GRACE_S)

    def abort(self) -> None:
        """Close at once."""
        if self._transport is not None:
            self._transport.abort()

    def _is_stuck(self) -> bool:
        return self._stuck_s is not None and self._loop.time() - self._stuck_s > GRACE_S


def _keep_alive(connection: Any) -> None:
    for level, option, value in KEEPALIVE:
        if hasattr(socket, option):
            with suppress(OSError):
                connection.setsockopt(getattr(socket, level), getattr(socket, option), value)
