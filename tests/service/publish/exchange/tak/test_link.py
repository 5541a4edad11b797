"""Real sockets: servers that are away, close, talk nonsense, hang or read nothing; and datagrams."""

import contextlib
import socket
import ssl
import struct
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from service.config.tak_section import TakConfig
from service.publish.exchange.drone import SharedDrone
from service.publish.exchange.tak import channel, link
from service.publish.exchange.tak.channel import TakFault
from service.publish.exchange.tak.publisher import TakPublisher
from tests.support.certificates import Authority
from tests.support.ground_samples import NOW_S
from tests.support.places import HANG_S
from tests.support.ports import free_port
from tests.support.shared_fires import drawn, shared
from tests.support.tak_server import Server


@pytest.fixture(autouse=True)
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    """Waits that a test has time for; the order of things is the same."""
    monkeypatch.setattr(link, "RETRY_FIRST_S", 0.02)
    monkeypatch.setattr(link, "RETRY_MAX_S", 0.05)
    monkeypatch.setattr(link, "_TICK_S", 0.01)
    monkeypatch.setattr(channel, "CONNECT_S", 0.3)
    monkeypatch.setattr(channel, "SEND_S", 0.3)


@contextlib.contextmanager
def publisher(url: str, clock: Callable[[], float] = lambda: NOW_S, **keys: str) -> Iterator[TakPublisher]:
    with TakPublisher(TakConfig(urls=(url,), **keys), clock, 8, 1) as made:  # type: ignore[arg-type]
        yield made


def until(is_so: Callable[[], bool], what: object = "") -> None:
    deadline = time.monotonic() + HANG_S
    while not is_so():
        assert time.monotonic() < deadline, what
        time.sleep(0.005)


def faults(ours: TakPublisher) -> dict[str, int]:
    (counters,) = ours.counters.values()
    found = counters["faults"]
    assert isinstance(found, dict)
    return found


def expect(ours: TakPublisher, fault: TakFault) -> None:
    """That fault, more than once, and no other; it says so, and who tells waits for nothing."""
    until(lambda: faults(ours).get(str(fault), 0) >= 2, ours.counters)
    assert set(faults(ours)) == {str(fault)}
    (counters,) = ours.counters.values()
    until(lambda: ours.is_lost)
    start_s = time.monotonic()
    for _ in range(100):
        ours.tell_fire(shared())
    assert time.monotonic() - start_s < HANG_S / 10
    assert "\n" not in str(counters["state"])


def test_events_reach_a_server_and_regions_are_taken_back_at_the_end() -> None:
    with Server() as server:
        with publisher(f"tcp://127.0.0.1:{server.port}") as ours:
            ours.tell_fire(shared())
            ours.tell_drone(SharedDrone("drone1", (47.4, 8.55)))
            until(lambda: len(server.events()) >= 3)
            assert ours.linked == {f"tcp://127.0.0.1:{server.port}": True} and not ours.is_lost
            assert {one.kind for one in server.events()} == {"a-u-X-i-f-w", "u-d-f", "a-f-A-M-H-Q"}
        until(lambda: len(server.events()) == 4)
        assert server.events()[-1].removes == f"{shared().uid}.region"


def test_a_server_closed_and_reopened_after_ten_minutes_gets_each_fire_once_as_it_is_then() -> None:
    now = [NOW_S]
    port = free_port()
    with publisher(f"tcp://127.0.0.1:{port}", lambda: now[0]) as ours:
        with Server(port=port) as before:
            for target in (1, 2, 3):
                ours.tell_fire(shared(target))
            until(lambda: len(before.events()) == 6)
        until(lambda: ours.is_lost)
        for second in range(0, 600, 2):
            now[0] = NOW_S + second
            ours.tell_fire(shared(1, state="dismissed" if second > 100 else "confirmed", seen_s=now[0]))
            ours.tell_fire(shared(2, seen_s=now[0], lat_deg=47.5 + second * 1e-5))
        now[0] = NOW_S + 601.0
        ours.tell_fire(shared(4, seen_s=now[0]))
        with Server(port=port) as after:
            until(lambda: len(after.events()) >= 8, ours.counters)
            assert not ours.is_lost
            heard = after.events()
            removed = {one.removes for one in heard} - {None}
            shown = {one.uid: one for one in heard if one.removes is None and one.uid not in removed}
        one, two, three, four = (shared(target).uid for target in (1, 2, 3, 4))
        assert removed == {one, f"{one}.region", f"{three}.region"}
        assert set(shown) == {two, f"{two}.region", four, f"{four}.region"}
        assert abs(shown[two].lat_lon[0] - 47.50598) < 1e-6
        assert len(heard) == 8


def test_nobody_there() -> None:
    with publisher(f"tcp://127.0.0.1:{free_port()}") as ours:
        expect(ours, TakFault.REFUSED)


def test_a_server_that_closes_at_once() -> None:
    with Server(lambda _connection: None) as server, publisher(f"tcp://127.0.0.1:{server.port}") as ours:
        ours.tell_fire(shared())
        expect(ours, TakFault.CLOSED)


def test_a_server_that_speaks_something_else() -> None:
    def web(connection: socket.socket) -> None:
        connection.sendall(b"HTTP/1.1 400 Bad Request\r\n\r\n")
        connection.settimeout(HANG_S)
        while connection.recv(65_536):
            pass

    with Server(web) as server, publisher(f"tcp://127.0.0.1:{server.port}") as ours:
        expect(ours, TakFault.NONSENSE)


def test_a_server_that_floods_us_is_read_and_thrown_away() -> None:
    def flood(connection: socket.socket) -> None:
        connection.sendall(b"<event>" + bytes(20_000_000))
        server.hold(connection)

    with Server(flood) as server, publisher(f"tcp://127.0.0.1:{server.port}") as ours:
        until(lambda: ours.linked == {f"tcp://127.0.0.1:{server.port}": True})
        (counters,) = ours.counters.values()
        assert counters["faults"] == {}


def test_a_server_that_reads_nothing_holds_up_nobody() -> None:
    now = [NOW_S]

    def ticking() -> float:
        now[0] += 10.0  # so that all is due at each look
        return now[0]

    with Server() as server:
        server._talk = server.hold
        with publisher(f"tcp://127.0.0.1:{server.port}", ticking) as ours:
            for _ in range(100_000):
                for target in range(8):
                    ours.tell_fire(shared(target, seen_s=now[0]))
                if faults(ours):
                    break
            until(lambda: bool(faults(ours)))
            assert set(faults(ours)) == {str(TakFault.NOT_READING)}
        # closing waited for no server


def test_a_host_without_a_name() -> None:
    with publisher("tcp://no-such-host.invalid:8087") as ours:
        expect(ours, TakFault.NO_HOST)


@pytest.fixture(scope="module")
def authority(tmp_path_factory: pytest.TempPathFactory) -> Authority:
    return Authority(tmp_path_factory.mktemp("tak") / "ca")


def secured(authority: Authority, name: str = "server", host: str = "localhost", clients: str = "") -> ssl.SSLContext:
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.load_cert_chain(*authority.issue(name, host))
    if clients:
        context.verify_mode = ssl.CERT_REQUIRED
        context.load_verify_locations(clients)
    return context


def test_tls_with_certificates_on_both_sides(authority: Authority) -> None:
    certificate, key = authority.issue("drone1")
    with Server(context=secured(authority, clients=str(authority.ca))) as server:
        keys = {"ca_certificate": str(authority.ca), "certificate": certificate, "private_key": key}
        with publisher(f"tls://localhost:{server.port}", **keys) as ours:
            ours.tell_fire(shared())
            until(lambda: len(server.events()) == 2, ours.counters)


def test_a_server_of_another_authority_or_name_gets_nothing(authority: Authority, tmp_path: Path) -> None:
    other = Authority(tmp_path / "other")
    for context in (secured(other), secured(authority, "elsewhere", "elsewhere.example")):
        with Server(context=context) as server:
            with publisher(f"tls://localhost:{server.port}", ca_certificate=str(authority.ca)) as ours:
                ours.tell_fire(shared())
                expect(ours, TakFault.WRONG_CERTIFICATE)
            assert server.heard == b""


def test_the_name_that_a_servers_certificate_has_can_be_told(authority: Authority) -> None:
    keys = {"ca_certificate": str(authority.ca), "server_name": "elsewhere.example"}
    with (
        Server(context=secured(authority, "elsewhere", "elsewhere.example")) as server,
        publisher(f"tls://localhost:{server.port}", **keys) as ours,
    ):
        ours.tell_fire(shared())
        until(lambda: len(server.events()) == 2, ours.counters)


def test_a_server_that_wants_a_certificate_of_ours(authority: Authority) -> None:
    with (
        Server(context=secured(authority, clients=str(authority.ca))) as server,
        publisher(f"tls://localhost:{server.port}", ca_certificate=str(authority.ca)) as ours,
    ):
        expect(ours, TakFault.OUR_CERTIFICATE)


def test_a_server_that_hangs_in_the_handshake_or_spins_it_out(authority: Authority) -> None:
    def drip(connection: socket.socket) -> None:
        for byte in b"\x16\x03\x03\x40\x00" + bytes(1_000):
            connection.sendall(bytes([byte]))
            time.sleep(0.02)

    with Server() as silent, Server(drip) as slow:
        silent._talk = silent.hold
        for server in (silent, slow):
            with publisher(f"tls://localhost:{server.port}", ca_certificate=str(authority.ca)) as ours:
                until(lambda: faults(ours).get(str(TakFault.NO_HANDSHAKE), 0) >= 1, ours.counters)
                assert ours.is_lost


def test_a_server_without_tls(authority: Authority) -> None:
    def greet(connection: socket.socket) -> None:
        connection.sendall(b"<?xml version='1.0'?>" * 20)
        connection.settimeout(HANG_S)
        connection.recv(65_536)

    with (
        Server(greet) as server,
        publisher(f"tls://localhost:{server.port}", ca_certificate=str(authority.ca)) as ours,
    ):
        expect(ours, TakFault.NOT_TLS)


def test_datagrams_reach_a_multicast_group_on_loopback() -> None:
    group, port = "239.2.3.1", free_port(socket.SOCK_DGRAM)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as listener:
        listener.bind(("", port))
        member = struct.pack("4s4s", socket.inet_aton(group), socket.inet_aton("127.0.0.1"))
        listener.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, member)
        listener.settimeout(HANG_S)
        with publisher(f"udp://{group}:{port}", interface="127.0.0.1") as ours:
            ours.tell_fire(shared())
            events = [drawn(listener.recv(65_536)) for _ in range(2)]  # one event a datagram
    assert [one.kind for one in events] == ["a-u-X-i-f-w", "u-d-f"]


def test_a_network_that_is_not_there_is_one_reason() -> None:
    with publisher("udp://255.255.255.255:6969") as ours:  # broadcast, which the system does not allow us
        ours.tell_fire(shared())
        until(lambda: faults(ours).get(str(TakFault.UNREACHABLE), 0) >= 1, ours.counters)
        assert set(faults(ours)) == {str(TakFault.UNREACHABLE)}
