"""The real service in this process, on a loopback socket, and honest or hostile senders on sockets of their own."""

import asyncio
import socket
import time
from collections.abc import Callable, Coroutine
from contextlib import asynccontextmanager
from typing import Any

import msgspec
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from service.config.sections import Config, LinkConfig, MavlinkConfig, ZenohConfig
from service.flight.app import App
from tests.support.places import HANG_S


def run(body: Coroutine[Any, Any, None]) -> None:
    asyncio.run(asyncio.wait_for(body, 2 * HANG_S))


async def until(condition: Callable[[], object], what: str) -> None:
    """Wait for the condition; fails after HANG_S with what was waited for."""
    end_s = time.monotonic() + HANG_S
    while not condition():
        assert time.monotonic() < end_s, f"not within {HANG_S:.0f} s: {what}"
        await asyncio.sleep(0.005)


@asynccontextmanager
async def running(**mavlink_options: Any) -> Any:
    """An App with one udpin link, ready to be talked to."""
    links = (LinkConfig(url="udpin:127.0.0.1:0"),)
    options = MavlinkConfig(links=links, **mavlink_options)
    app = App(Config(mavlink=options, zenoh=ZenohConfig(enabled=False)))
    stop = asyncio.Event()
    serving = asyncio.create_task(app.run(stop))
    await until(lambda: app.links[0].state == "open" or serving.done(), "the link")
    try:
        yield app
    finally:
        stop.set()
        await serving


class Sender:
    """A MAVLink system on a UDP socket, signing as it is told; keeps what came back."""

    def __init__(self, app: App, system: int = 1, component: int = 1, key: bytes = b"", link_id: int = 0) -> None:
        self.mav = mavlink.MAVLink(None, system, component)
        self.received = b""
        self._to = ("127.0.0.1", app.links[0].port)
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        if key:
            self.mav.signing.secret_key, self.mav.signing.sign_outgoing = key, True
            self.mav.signing.timestamp, self.mav.signing.link_id = ticks_now(), link_id

    def __enter__(self) -> "Sender":
        return self

    def __exit__(self, *_: object) -> None:
        self._socket.close()

    def pack(self, message: Any, **options: Any) -> bytes:
        packed = bytes(message.pack(self.mav, **options))
        self.mav.seq = (self.mav.seq + 1) % 256
        return packed

    def send(self, data: bytes) -> None:
        self._socket.sendto(data, self._to)

    def heartbeat(self) -> bytes:
        """An autopilot's, sent; what was sent."""
        data = self.pack(mavlink.MAVLink_heartbeat_message(2, 3, 0, 0, 4, 3))
        self.send(data)
        return data

    def hear(self) -> bytes:
        """What came back since the last call."""
        heard = b""
        try:
            while True:
                heard += self._socket.recv(2048)
        except BlockingIOError:
            self.received += heard
            return heard


def ticks_now() -> int:
    """Now as MAVLink's signatures count it: 10 us since 2015."""
    return int((time.time() - 1_420_070_400) * 1e5)


def heard(app: App, kind: str = "HEARTBEAT") -> int:
    """How many messages of a kind the service took from its autopilot."""
    return int(app.autopilot.messages[kind])


def refused(app: App) -> dict[str, int]:
    """The first link's refusals, by reason, as the status has them."""
    status = msgspec.to_builtins(app.status(time.monotonic_ns()))
    return dict(status["counters"]["links"][app.links[0].name]["refused"])
