"""Links over real loopback sockets."""

import asyncio
import socket
from collections.abc import Coroutine
from contextlib import suppress
from typing import Any

import pytest

from service.config.endpoint import Endpoint, parse_endpoint
from service.mavlink.carrier import MOST_PEERS, LinkError
from service.mavlink.link import Link
from service.mavlink.socket_carriers import EXPIRY_S, GRACE_S
from tests.support.places import HANG_S


def run(body: Coroutine[Any, Any, None]) -> None:
    asyncio.run(asyncio.wait_for(body, HANG_S))


class Listener:
    """Collects a link's bytes and waits for them without sleeping."""

    def __init__(self, url: str) -> None:
        self.queue: asyncio.Queue[bytes] = asyncio.Queue()
        self.link = Link(parse_endpoint(url), lambda _, data: self.queue.put_nowait(data))

    async def __aenter__(self) -> "Listener":
        await self.link.open()
        self.task = asyncio.create_task(self.link.run())
        return self

    async def __aexit__(self, *_: object) -> None:
        self.task.cancel()
        with suppress(asyncio.CancelledError):
            await self.task
        self.link.close()  # a task cancelled before its first step never gets to close
        await asyncio.sleep(0)


@pytest.mark.parametrize(
    ("url", "endpoint"),
    [
        ("udpin:0.0.0.0:14550", Endpoint("udpin", "0.0.0.0", 14550)),
        ("tcp:fcu.local:5760", Endpoint("tcp", "fcu.local", 5760)),
        ("serial:/dev/ttyAMA0:921600", Endpoint("serial", "/dev/ttyAMA0", 921600)),
    ],
)
def test_urls(url: str, endpoint: Endpoint) -> None:
    assert parse_endpoint(url) == endpoint and endpoint.url == url


@pytest.mark.parametrize(
    "url",
    [
        "",
        "udp:1.2.3.4:5",
        "udpin:14550",
        "tcp:host:0",
        "tcp:host:65536",
        "serial:/dev/x",
        "tcp::1",
        "tcp:h:" + "9" * 5000,
    ],
)
def test_wrong_urls_say_so_in_one_line(url: str) -> None:
    with pytest.raises(ValueError, match=r"must|is no") as caught:
        parse_endpoint(url)
    assert "\n" not in str(caught.value) and len(str(caught.value)) < 400


@pytest.mark.parametrize(("server", "client"), [("udpin", "udpout"), ("tcpin", "tcp")])
def test_both_ways_over_loopback(server: str, client: str) -> None:
    async def body() -> None:
        async with Listener(f"{server}:127.0.0.1:0") as here:  # noqa: SIM117 (the port is known inside)
            async with Listener(f"{client}:127.0.0.1:{here.link.port}") as there:
                while there.link.state != "open":
                    await asyncio.sleep(0)
                there.link.send(b"up")
                assert await here.queue.get() == b"up"
                here.link.send(b"down")
                assert await there.queue.get() == b"down"
                assert here.link.counters()["received_bytes"] == 2

    run(body())


def test_a_port_in_use_is_one_clear_line() -> None:
    async def body() -> None:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
            taken.bind(("127.0.0.1", 0))
            with pytest.raises(LinkError, match=r"^udpin:127\.0\.0\.1:\d+: port in use"):
                await Listener(f"udpin:127.0.0.1:{taken.getsockname()[1]}").link.open()

    run(body())


def test_sends_without_a_peer_are_dropped_and_counted() -> None:
    async def body() -> None:
        async with Listener("udpin:127.0.0.1:0") as here:
            here.link.send(b"x")
            assert here.link.counters()["dropped_sends"] == 1

    run(body())


def test_a_client_comes_back_after_its_server_went_away() -> None:
    async def body() -> None:
        async with Listener("tcpin:127.0.0.1:0") as server:  # noqa: SIM117
            async with Listener(f"tcp:127.0.0.1:{server.link.port}") as there:
                while there.link.state != "open":
                    await asyncio.sleep(0)
                there.link.send(b"a")
                assert await server.queue.get() == b"a"
                server.link._carrier.peers[0].abort()  # type: ignore[union-attr]
                while there.link.counters()["connects"] != 2:
                    await asyncio.sleep(0)
                there.link.send(b"b")
                assert await server.queue.get() == b"b"

    run(body())


def test_a_link_ends_at_whatever_moment_of_a_refused_connection_it_is_told_to() -> None:
    async def body() -> None:
        with socket.socket() as closed:  # bound and never listening: it refuses, and nobody else gets the port
            closed.bind(("127.0.0.1", 0))
            url = f"tcp:127.0.0.1:{closed.getsockname()[1]}"
            for steps in range(30):
                link = Link(parse_endpoint(url), lambda _, data: None)
                task = asyncio.create_task(link.run())
                for _ in range(steps):
                    await asyncio.sleep(0)
                task.cancel()
                done, _ = await asyncio.wait({task}, timeout=5.0)
                assert done and task.cancelled(), f"still running after {steps} steps of the loop"

    run(body())


@pytest.mark.parametrize("is_valid", [True, False])
def test_a_new_tcp_peer_takes_the_place_of_one_that_never_sent_a_valid_frame(is_valid: bool) -> None:
    async def body() -> None:
        loop, later_s = asyncio.get_running_loop(), 0.0
        true_time = loop.time
        loop.time = lambda: true_time() + later_s  # type: ignore[method-assign]
        came: asyncio.Queue[bytes] = asyncio.Queue()

        def take(_: Link, data: bytes) -> bool:
            came.put_nowait(data)
            return is_valid

        link = Link(parse_endpoint("tcpin:127.0.0.1:0"), take)
        await link.open()
        writers = []
        for _ in range(MOST_PEERS):
            _, writer = await asyncio.open_connection("127.0.0.1", link.port)
            writer.write(b"x")
            await came.get()
            writers.append(writer)
        for after_s, has_place in ((0.0, False), (GRACE_S + 1.0, not is_valid)):
            later_s = after_s
            reader, writer = await asyncio.open_connection("127.0.0.1", link.port)
            writers.append(writer)
            if has_place:
                writer.write(b"new")
                assert await came.get() == b"new"
            else:
                with suppress(ConnectionError):
                    assert await reader.read() == b""
        assert len(link._carrier.peers) == MOST_PEERS  # type: ignore[union-attr]
        link.close()
        for writer in writers:
            writer.close()
            with suppress(ConnectionError):
                await writer.wait_closed()

    run(body())


def test_one_junk_byte_is_no_subscription_and_a_silent_udp_peer_is_forgotten() -> None:
    async def body() -> None:
        loop, later_s = asyncio.get_running_loop(), 0.0
        true_time = loop.time
        loop.time = lambda: true_time() + later_s  # type: ignore[method-assign]
        came: asyncio.Queue[bytes] = asyncio.Queue()

        def take(_: Link, data: bytes) -> bool:
            came.put_nowait(data)
            return data == b"valid"

        link = Link(parse_endpoint("udpin:127.0.0.1:0"), take)
        await link.open()
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as peer:
            for data, dropped in ((b"x", 1), (b"valid", 1)):
                peer.sendto(data, ("127.0.0.1", link.port))
                assert await came.get() == data
                link.send(b"down")
                assert link.counters()["dropped_sends"] == dropped
            later_s = EXPIRY_S + 1.0
            link.send(b"down")
            assert link.counters()["dropped_sends"] == 2
        link.close()
        await asyncio.sleep(0)

    run(body())
