"""Carries MAVLink bytes over UDP, TCP or a serial port for ever, with reconnection; used by the service.

One URL syntax: udpin:HOST:PORT, udpout:HOST:PORT, tcp:HOST:PORT, tcpin:HOST:PORT, serial:/dev/ttyX:921600.
"""

import asyncio
import errno
import logging
import random
import time
from collections.abc import Callable
from typing import Any, Protocol, cast

from service.endpoint import Endpoint

log = logging.getLogger(__name__)

LEAST_WAIT_S = 0.5
MOST_WAIT_S = 5.0
BEAT_S = 1.0
MOST_PEERS = 4
MOST_BUFFERED_BYTES = 65_536
READ_BYTES = 4_096
MOST_DATAGRAM_BYTES = 65_536

OnBytes = Callable[["Link", bytes], bool | None]
Received = Callable[[bytes], bool]


class LinkError(Exception):
    """A link cannot be opened and waiting will not help; one line for the operator."""


class Carrier(Protocol):
    """One open connection of some kind."""

    port: int

    async def wait_closed(self) -> None:
        """Return or raise OSError once it is lost."""

    def write(self, data: bytes) -> bool:
        """Send without waiting; False if the bytes were dropped."""

    def is_moving(self) -> bool:
        """Whether what carries the bytes, a thread it may be, still runs; asked every second."""

    def close(self) -> None:
        """Give the device back."""


class Link:
    """One endpoint; `on_bytes(link, data)` is called on the event loop for whatever arrives.

    Where it returns False, a UDP sender that was not heard before is not answered.
    """

    def __init__(self, endpoint: Endpoint, on_bytes: OnBytes) -> None:
        self.endpoint = endpoint
        self.name = endpoint.url
        self.state = "closed"
        self._on_bytes = on_bytes
        self.beat_ns = time.monotonic_ns()  # when `run` last went round
        self._carrier: Carrier | None = None
        self._counts = {"received_bytes": 0, "sent_bytes": 0, "dropped_sends": 0, "connects": 0}

    @property
    def port(self) -> int:
        """The port really bound, where the URL said 0."""
        return self._carrier.port if self._carrier else self.endpoint.port

    async def open(self) -> None:
        """Bind what listens, so that a port in use is known at the start; LinkError where waiting would not help."""
        if self.endpoint.kind == "serial":
            from service.serial_carrier import require_pyserial

            require_pyserial(self.name)
        if self.endpoint.kind not in ("udpin", "tcpin"):
            return
        try:
            await self._connect()
        except OSError as error:
            in_use = error.errno == errno.EADDRINUSE
            reason = "port in use by another program" if in_use else f"cannot be opened: {error}"
            raise LinkError(f"{self.name}: {reason}") from error

    async def run(self) -> None:
        """Keep the link up until cancelled; lost devices are tried again after 0.5 to 5 s."""
        wait_s = LEAST_WAIT_S
        try:
            while True:
                self._beat()
                try:
                    carrier = self._carrier or await self._connect()
                    wait_s = LEAST_WAIT_S
                    await self._until_closed(carrier)
                    self._lost("closed by the other side")
                except OSError as error:
                    self._lost(str(error))
                await asyncio.sleep(wait_s * random.uniform(0.7, 1.0))
                wait_s = min(2 * wait_s, MOST_WAIT_S)
        finally:
            self.close()

    def send(self, data: bytes) -> None:
        """Send without waiting; dropped and counted where there is no connection or its buffer is full."""
        if self._carrier is not None and self._carrier.write(data):
            self._counts["sent_bytes"] += len(data)
        else:
            self._counts["dropped_sends"] += 1

    def close(self) -> None:
        """Close the connection, if any."""
        if self._carrier is not None:
            self._carrier.close()
        self._carrier, self.state = None, "closed"

    def counters(self) -> dict[str, object]:
        """Figures for the status."""
        return {"state": self.state, **self._counts}

    async def _until_closed(self, carrier: Carrier) -> None:
        closed = asyncio.ensure_future(carrier.wait_closed())
        try:
            while not closed.done():
                if carrier.is_moving():
                    self._beat()
                await asyncio.wait([closed], timeout=BEAT_S)
            closed.result()
        finally:
            closed.cancel()

    def _beat(self) -> None:
        self.beat_ns = time.monotonic_ns()

    async def _connect(self) -> Carrier:
        carrier = await open_carrier(self.endpoint, self._received)
        self._carrier, self.state = carrier, "open"
        self._counts["connects"] += 1
        log.info("%s: open", self.name)
        return carrier

    def _received(self, data: bytes) -> bool:
        self._counts["received_bytes"] += len(data)
        return self._on_bytes(self, data) is not False

    def _lost(self, reason: str) -> None:
        if self.state != "retrying":
            log.warning("%s: lost: %s", self.name, reason)
        self.close()
        self.state = "retrying"


async def open_carrier(endpoint: Endpoint, received: Received) -> Carrier:
    """Connect or listen; raises OSError."""
    loop = asyncio.get_running_loop()
    address = (endpoint.host, endpoint.port)
    if endpoint.kind == "udpin":
        _, udp = await loop.create_datagram_endpoint(lambda: UdpCarrier(received, True), local_addr=address)
        return udp
    if endpoint.kind == "udpout":
        _, udp = await loop.create_datagram_endpoint(lambda: UdpCarrier(received, False), remote_addr=address)
        return udp
    if endpoint.kind == "tcp":
        client = TcpCarrier(received, 1)
        async with asyncio.timeout(MOST_WAIT_S):  # wait_for would lose a cancellation that meets a refusal
            await loop.create_connection(client.protocol, *address)
        return client
    if endpoint.kind == "tcpin":
        listener = TcpCarrier(received, MOST_PEERS)
        listener.listen(await loop.create_server(listener.protocol, *address))
        return listener
    from service.serial_carrier import SerialCarrier

    return await SerialCarrier.open(endpoint.host, endpoint.port, received)


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
