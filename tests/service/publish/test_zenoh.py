import os
import signal
import socket
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path

import msgspec
import pytest
import zenoh

from service.config.sections import ConfigError, ZenohConfig
from service.ground.subscriber import Subscriber, line_from_report
from service.publish import wire
from service.publish.zenoh import NullPublisher, ZenohPublisher, zenoh_config
from tests.support.places import HANG_S, ROOT
from tests.support.ports import free_port
from tests.support.wire_samples import located


def report(target_id: int, semi_major_m: float = 180.0) -> bytes:
    return wire.encode(wire.report_from_target(located(target_id, semi_major_m=semi_major_m), "drone1"))


@pytest.fixture
def endpoint() -> str:
    return f"tcp/127.0.0.1:{free_port()}"


@pytest.fixture
def publisher(endpoint: str) -> Iterator[ZenohPublisher]:
    with ZenohPublisher(ZenohConfig(listen=(endpoint,)), "drone1") as made:
        yield made


def wait_until_published(publisher: ZenohPublisher, number: int) -> None:
    with publisher._changed:
        assert publisher._changed.wait_for(lambda: publisher._published >= number, HANG_S), publisher.state


def wait_until_state(publisher: ZenohPublisher, state: str) -> None:
    with publisher._changed:
        assert publisher._changed.wait_for(lambda: publisher.state == state, HANG_S), publisher.state


def test_a_late_process_gets_the_last_report_of_each_target(
    publisher: ZenohPublisher, endpoint: str, tmp_path: Path
) -> None:
    for target_id, semi_major_m in ((1, 300.0), (2, 180.0)):
        publisher.publish_report(target_id, report(target_id, semi_major_m))
    wait_until_published(publisher, 2)
    publisher.publish_report(1, report(1, 150.0))
    wait_until_published(publisher, 3)
    out = tmp_path / "reports.jsonl"
    command = [sys.executable, "-m", "service.ground.station", "--connect", endpoint, "--out", str(out)]
    with subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, text=True, env=dict(os.environ)) as process:
        killer = threading.Timer(HANG_S, process.kill)
        killer.start()
        assert process.stdout is not None
        lines: list[str] = []
        for line in process.stdout:
            lines.append(line)
            if any("targets/1 " in line for line in lines) and any("targets/2 " in line for line in lines):
                break
        publisher.publish_report(3, report(3))
        assert any("targets/3 " in line for line in process.stdout)
        process.send_signal(signal.SIGTERM)
        assert process.wait(HANG_S) == 0
        killer.cancel()
    assert not any("+-300x60" in line for line in lines)
    assert any("distloc/drone1/targets/1 confirmed 47.42774 8.60559 +-150x60 m at 4100 m" in line for line in lines)
    assert {wire.decode_report(line).properties.target for line in out.read_bytes().splitlines()} == {1, 2, 3}


def test_a_plain_get_and_liveliness(publisher: ZenohPublisher, endpoint: str) -> None:
    publisher.publish_report(1, report(1))
    publisher.publish_report(2, report(2))
    wait_until_published(publisher, 2)
    with zenoh.open(zenoh_config(ZenohConfig(connect=(endpoint,)))) as session:
        alive, gone = threading.Event(), threading.Event()
        session.liveliness().declare_subscriber(
            "distloc/*/alive",
            lambda sample: (alive if sample.kind == zenoh.SampleKind.PUT else gone).set(),
            history=True,
        )
        assert alive.wait(HANG_S)
        samples = [reply.ok for reply in session.get("distloc/drone1/targets/*", timeout=HANG_S) if reply.ok]
        assert {str(s.key_expr): s.payload.to_bytes() for s in samples} == {
            f"distloc/drone1/targets/{target_id}": report(target_id) for target_id in (1, 2)
        }
        assert {str(sample.encoding) for sample in samples} == {"application/geo+json"}
        one = [r.ok for r in session.get("distloc/drone1/targets/2", timeout=HANG_S) if r.ok]
        assert {sample.payload.to_bytes() for sample in one} == {report(2)}
        publisher.close()
        assert gone.wait(HANG_S)


def test_a_busy_port_is_tried_again(endpoint: str) -> None:
    heard = threading.Event()
    host, port = endpoint.removeprefix("tcp/").split(":")
    blocker = socket.socket()
    blocker.bind((host, int(port)))
    blocker.listen()
    with ZenohPublisher(ZenohConfig(listen=(endpoint,)), "drone1") as publisher:
        publisher.publish_report(1, report(1, 200.0))
        publisher.publish_report(1, report(1))
        assert publisher.counters["zenoh_dropped"] == 1
        with publisher._changed:
            assert publisher._changed.wait_for(lambda: publisher.state.startswith("retrying"), HANG_S)
        blocker.close()
        wait_until_published(publisher, 1)
        assert publisher.state == "open"
        with Subscriber([endpoint], lambda key, payload: heard.set()):
            assert heard.wait(HANG_S)


def test_memory_is_bounded_while_there_is_no_session() -> None:
    publisher = ZenohPublisher(ZenohConfig(), "drone1")
    for number in range(1000):
        publisher.publish_report(number, b"{}")
    assert len(publisher._pending) <= 67
    assert len(publisher._last) == 64
    assert publisher.counters["zenoh_dropped"] == 1000 - 67


@pytest.mark.parametrize(
    ("config", "names"),
    [
        (ZenohConfig(connect=("nonsense",)), "connect/endpoints"),
        (ZenohConfig(ca_certificate="/nowhere/ca.pem"), "ca_certificate"),
        (ZenohConfig(certificate="/nowhere/c.pem"), "private_key"),
        (ZenohConfig(user="crew"), "password_file"),
        (ZenohConfig(user="crew", password_file=__file__), "password_file"),
    ],
)
def test_a_bad_config_is_named(config: ZenohConfig, names: str) -> None:
    with pytest.raises(ConfigError, match=names):
        zenoh_config(config)


def test_nothing_is_open_that_was_not_asked_for(tmp_path: Path) -> None:
    (tmp_path / "secret").write_text("fire\n")
    (tmp_path / "secret").chmod(0o600)
    made = zenoh_config(ZenohConfig(user="crew", password_file=str(tmp_path / "secret")))
    assert made.get_json("scouting/multicast/enabled") == "false"
    assert made.get_json("scouting/gossip/enabled") == "false"
    assert made.get_json("listen/endpoints") == "[]"
    assert made.get_json("mode") == '"peer"'
    assert made.get_json("transport/auth/usrpwd/user") == '"crew"'


def test_what_is_no_report_gets_a_line_too() -> None:
    assert line_from_report("k", b"{").startswith("k no report")
    for place, said in (([1e308, 47.0], "47, 1e+308"), ([8.0, -91.0], "-91, 8")):
        content = msgspec.json.decode(report(1))
        content["geometry"]["coordinates"] = place
        assert line_from_report("k", msgspec.json.encode(content)) == f"k no report: its place is {said}: not on earth"


def test_the_null_publisher() -> None:
    with NullPublisher() as publisher:
        publisher.publish_report(1, b"")
        publisher.publish_vehicle(b"")
        publisher.publish_status(b"")
        publisher.publish_preview(b"")
    assert publisher.state == "off"


def test_whatever_error_the_thread_goes_on(endpoint: str, monkeypatch: pytest.MonkeyPatch) -> None:
    publisher = ZenohPublisher(ZenohConfig(listen=(endpoint,)), "drone1")
    has_no_link, failures = publisher._has_no_link, iter([RuntimeError("odd"), KeyError()])

    def fails_twice(session: zenoh.Session) -> bool:
        if (error := next(failures, None)) is not None:
            raise error
        return has_no_link(session)

    monkeypatch.setattr(publisher, "_has_no_link", fails_twice)
    with publisher:
        for expected in ("retrying: odd", "retrying: KeyError", "open"):
            publisher.publish_status(b"{}")
            wait_until_state(publisher, expected)
        publisher.publish_status(b"{}")
        wait_until_published(publisher, 1)
