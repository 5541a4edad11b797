"""UDP and TCP sockets as carriers of a link; the link opens one."""

import asyncio
from typing import Any, cast

from service.mavlink.carrier import MOST_PEERS, Received

MOST_BUFFERED_BYTES = 65_536
MOST_DATAGRAM_BYTES = 65_536


class UdpCarrier(asyncio.DatagramProtocol):
    """A datagram socket; one that listens answers the last few peers that it heard."""

    def __init__(self, received: Received, listens: bool) -> None:
        self.port = 0
        self._received = received
        self._listens = listens
        self._peers: dict[Any, None] = {}
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
            self._peers.pop(addr, None)
            self._peers[addr] = None
        if not self._received(data) and is_new:
            self._peers.pop(addr, None)
        elif len(self._peers) > MOST_PEERS:
            del self._peers[next(iter(self._peers))]

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
        self.transports: list[asyncio.Transport] = []
        self.closed: asyncio.Future[None] = asyncio.get_running_loop().create_future()
        self.server: asyncio.Server | None = None

    def listen(self, server: asyncio.Server) -> None:
        """Keep the listening socket."""
        self.server = server
        self.port = int(server.sockets[0].getsockname()[1])

    def protocol(self) -> asyncio.Protocol:
        """The protocol object of one connection."""
        return TcpPeer(self)

    async def wait_closed(self) -> None:
        """Until the connection is lost; a listening socket stays."""
        await self.closed

    def write(self, data: bytes) -> bool:
        """Send to all; False if none took it."""
        ready = [transport for transport in self.transports if _has_room(transport)]
        for transport in ready:
            transport.write(data)
        return bool(ready)

    def is_moving(self) -> bool:
        """True: the event loop itself carries the bytes."""
        return True

    def close(self) -> None:
        """Close every socket."""
        if self.server is not None:
            self.server.close()
        for transport in list(self.transports):
            transport.abort()


class TcpPeer(asyncio.Protocol):
    """One connection of a `TcpCarrier`."""

    def __init__(self, owner: TcpCarrier) -> None:
        self._owner = owner
        self._transport: asyncio.Transport | None = None

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Join the owner's connections, unless they are too many."""
        self._transport = cast(asyncio.Transport, transport)
        if len(self._owner.transports) >= self._owner.most:
            self._transport.abort()
            return
        self._owner.transports.append(self._transport)

    def data_received(self, data: bytes) -> None:
        """Hand the bytes on."""
        self._owner.received(data)

    def connection_lost(self, exc: Exception | None) -> None:
        """Leave; a client's carrier is then lost as a whole."""
        if self._transport in self._owner.transports:
            self._owner.transports.remove(self._transport)
        if self._owner.server is None and not self._owner.closed.done():
            self._owner.closed.set_result(None)


def _has_room(transport: asyncio.Transport) -> bool:
    return not transport.is_closing() and transport.get_write_buffer_size() <= MOST_BUFFERED_BYTES
