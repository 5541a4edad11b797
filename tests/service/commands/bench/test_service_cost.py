"""The measurement of the service's own cost: a real service, an autopilot, a camera's stream and a listener."""

import socket
import threading
import urllib.request
from collections import Counter

import pytest

from service.commands.bench.service.link_load import MIX_HZ, Peer, Stream
from service.commands.bench.service.service_cost import service_cost
from service.commands.install.unit_environment import unit_environment
from service.mavlink.framer import Framer, decode
from tests.support.places import HANG_S

PLACE = (47.4, 8.6, 500.0)


def test_the_mix_is_five_hundred_a_second() -> None:
    assert sum(MIX_HZ.values()) == 500


@pytest.mark.parametrize("per_datagram", [1, 5])
def test_the_peer_sends_each_kind_at_its_rate(per_datagram: int) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as heard:
        heard.bind(("127.0.0.1", 0))
        heard.settimeout(HANG_S)
        framer, kinds, datagrams, lost = Framer(), Counter[str](), 0, 0
        last: int | None = None
        with Peer(heard.getsockname()[1], MIX_HZ, PLACE, per_datagram):
            while sum(kinds.values()) < 500:
                datagrams += 1
                for frame in framer.feed(heard.recv(65535)):
                    message = decode(frame)
                    assert message is not None
                    kinds[message.get_type()] += 1
                    lost += last is not None and (frame.sequence - last) % 256 != 1
                    last = frame.sequence
    assert kinds == {kind.upper(): hz for kind, hz in MIX_HZ.items()} and datagrams == 500 // per_datagram
    assert lost == framer.bad_bytes == 0


def test_the_stream_gives_its_pictures_in_turn() -> None:
    with Stream([b"first", b"second"], 100.0) as stream, urllib.request.urlopen(stream.url, timeout=HANG_S) as answer:
        heard = b""
        while heard.count(b"first") < 2:
            heard += answer.read1()
    parts = [part.partition(b"\r\n\r\n")[2].strip() for part in heard.split(b"--frame")[1:4]]
    assert parts == [b"first", b"second", b"first"]


@pytest.mark.thorough
def test_the_service_is_measured_at_rest_and_at_work() -> None:
    cost = service_cost(1.0)
    assert min(cost.help_s, cost.ready_s, cost.messages_cpu, cost.idle_cpu) > 0.0
    assert cost.targets >= 4 and cost.messages_hz > 0.0
    assert max(cost.messages_cpu, cost.idle_cpu) < 1.0
    assert 50.0 < cost.ready_rss_mb < cost.work_rss_mb <= cost.peak_rss_mb < 1000.0
    assert {thread.name for thread in threading.enumerate()} & {"peer"} == set()


def test_it_is_measured_as_the_unit_starts_it() -> None:
    assert unit_environment()["MALLOC_MMAP_THRESHOLD_"] == "131072"
