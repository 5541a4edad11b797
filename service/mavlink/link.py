"""Carries MAVLink bytes over UDP, TCP or a serial port for ever, with reconnection; used by the service.

One URL syntax: udpin:HOST:PORT, udpout:HOST:PORT, tcp:HOST:PORT, tcpin:HOST:PORT, serial:/dev/ttyX:921600.
"""

import asyncio
import errno
import logging
import random
import time
from collections.abc import Callable

from service.common import aio
from service.common.messages import MavFrame
from service.config.endpoint import Endpoint
from service.mavlink.carrier import MOST_PEERS, MOST_WAIT_S, Carrier, LinkError, Received
from service.mavlink.framer import Framer
from service.mavlink.serial_carrier import SerialCarrier, require_pyserial
from service.mavlink.socket_carriers import TcpCarrier, UdpCarrier

log = logging.getLogger(__name__)

LEAST_WAIT_S = 0.5
BEAT_S = 1.0

OnBytes = Callable[["Link", bytes], bool | None]


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
        self._framer = Framer()  # of who sent what `on_bytes` is called with
        self._counts = {"received_bytes": 0, "sent_bytes": 0, "dropped_sends": 0, "connects": 0}

    @property
    def port(self) -> int:
        """The port really bound, where the URL said 0."""
        return self._carrier.port if self._carrier else self.endpoint.port

    async def open(self) -> None:
        """Bind what listens, so that a port in use is known at the start; LinkError where waiting would not help."""
        if self.endpoint.kind == "serial":
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

    def whole_frames(self, data: bytes) -> list[MavFrame]:
        """Within `on_bytes`: the frames that its bytes complete. Each peer has a framer: its junk cuts no other's."""
        return self._framer.feed(data)

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

    def _received(self, data: bytes, framer: Framer) -> bool:
        self._framer = framer
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
        async with aio.timeout(MOST_WAIT_S):  # wait_for would lose a cancellation that meets a refusal
            await loop.create_connection(client.protocol, *address)
        return client
    if endpoint.kind == "tcpin":
        listener = TcpCarrier(received, MOST_PEERS)
        listener.listen(await loop.create_server(listener.protocol, *address))
        return listener
    framer = Framer()
    return await SerialCarrier.open(endpoint.host, endpoint.port, lambda data: received(data, framer))
