"""Each peer of a listening link has a framer of its own; TCP connections to nobody end."""

import asyncio
import socket
from collections.abc import Coroutine
from contextlib import ExitStack
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from service.config.endpoint import parse_endpoint
from service.mavlink.link import Link
from service.mavlink.socket_carriers import KEEPALIVE, MOST_UDP_FRAMERS

TYPES = {"udpin": socket.SOCK_DGRAM, "tcpin": socket.SOCK_STREAM}


def run(body: Coroutine[Any, Any, None]) -> None:
    asyncio.run(asyncio.wait_for(body, 20))


def beat(system: int) -> bytes:
    message = mavlink.MAVLink_heartbeat_message(2, 3, 0, 0, 4, 3)
    return bytes(message.pack(mavlink.MAVLink(None, system, 1)))


class Ear:
    """A listening link, the systems of whose frames are known, read by read."""

    def __init__(self, kind: str) -> None:
        self.systems: asyncio.Queue[list[int]] = asyncio.Queue()
        self.link = Link(parse_endpoint(f"{kind}:127.0.0.1:0"), self._take)

    def _take(self, link: Link, data: bytes) -> bool:
        frames = link.whole_frames(data)
        self.systems.put_nowait([frame.system for frame in frames])
        return bool(frames)

    async def hears(self, peer: socket.socket, data: bytes) -> list[int]:
        peer.sendall(data)
        return await self.systems.get()

    def peer(self, sockets: ExitStack) -> socket.socket:
        one = sockets.enter_context(socket.socket(socket.AF_INET, TYPES[self.link.endpoint.kind]))
        one.connect(("127.0.0.1", self.link.port))
        return one


@pytest.mark.parametrize("kind", ["udpin", "tcpin"])
def test_one_peers_junk_and_half_frames_cut_no_other_peers_frames(kind: str) -> None:
    async def body() -> None:
        ear = Ear(kind)
        await ear.link.open()
        with ExitStack() as sockets:
            first, second = ear.peer(sockets), ear.peer(sockets)
            assert await ear.hears(first, beat(1)[:9]) == []
            assert (
                await ear.hears(second, b"\xfd\xff\x00\x00\x00\x02\x01\x0b\x01\x00") == []
            )  # the header of a long one
            assert await ear.hears(first, beat(1)[9:] + beat(1)) == [1, 1]
            assert await ear.hears(second, bytes(300) + beat(2)) == [2]
            assert await ear.hears(first, beat(1)) == [1]
        ear.link.close()
        await asyncio.sleep(0)

    run(body())


def test_many_udp_senders_of_junk_leave_a_valid_one_its_half_frame() -> None:
    async def body() -> None:
        ear = Ear("udpin")
        await ear.link.open()
        with ExitStack() as sockets:
            valid = ear.peer(sockets)
            assert await ear.hears(valid, beat(1) + beat(1)[:9]) == [1]
            for _ in range(3 * MOST_UDP_FRAMERS):
                assert await ear.hears(ear.peer(sockets), b"\xfd\x09\x00") == []
            assert await ear.hears(valid, beat(1)[9:]) == [1]
            assert len(ear.link._carrier._framers) == MOST_UDP_FRAMERS  # type: ignore[union-attr]
        ear.link.close()
        await asyncio.sleep(0)

    run(body())


def test_a_tcp_connection_made_anew_starts_without_the_old_ones_half_frame() -> None:
    async def body() -> None:
        ear = Ear("tcpin")
        await ear.link.open()
        with ExitStack() as sockets:
            assert await ear.hears(ear.peer(sockets), b"\xfd\xff\x00\x00\x00\x02\x01\x0b\x01\x00") == []
        with ExitStack() as sockets:
            assert await ear.hears(ear.peer(sockets), beat(1)) == [1]
        ear.link.close()
        await asyncio.sleep(0)

    run(body())


def test_both_ends_of_a_tcp_link_are_watched_by_the_system() -> None:
    async def body() -> None:
        ear = Ear("tcpin")
        await ear.link.open()
        there = Link(parse_endpoint(f"tcp:127.0.0.1:{ear.link.port}"), lambda _, data: None)
        task = asyncio.create_task(there.run())
        while there.state != "open":
            await asyncio.sleep(0)
        there.send(beat(1))
        assert await ear.systems.get() == [1]
        for link in (ear.link, there):
            (peer,) = link._carrier.peers  # type: ignore[union-attr]
            connection = peer._transport.get_extra_info("socket")
            for level, option, value in KEEPALIVE:
                if hasattr(socket, option):
                    assert connection.getsockopt(getattr(socket, level), getattr(socket, option)) == value, option
        task.cancel()
        await asyncio.wait({task})
        ear.link.close()
        await asyncio.sleep(0)

    run(body())
