"""What the ground station says of links, of who is there and how they are."""

import msgspec

from service.common.degraded import Degraded
from service.ground.watch import MAX_VEHICLES, VehicleWatch
from service.publish.wire import StatusReport

KEY, STATUS = "distloc/drone1/alive", "distloc/drone1/status"


def payload(*degraded: str) -> bytes:
    status = StatusReport(
        vehicle="drone1", time_utc=None, state="degraded" if degraded else "ok", degraded=list(degraded)
    )
    return msgspec.json.encode(status)


def test_a_link_is_told_once_a_change() -> None:
    watch, endpoint = VehicleWatch(), "tcp/192.0.2.1:7447"
    assert watch.link(endpoint, False)[0].startswith(f"not connected to {endpoint}: trying again")
    assert watch.link(endpoint, False) == []
    assert watch.link(endpoint, True) == [f"connected to {endpoint}"]
    assert watch.link(endpoint, True) == []
    assert watch.link(endpoint, False) != []


def test_who_is_there_and_how_is_told_once_a_change() -> None:
    watch = VehicleWatch()
    assert watch.alive(KEY, True) == ["drone1 is there"]
    assert watch.alive(KEY, True) == []
    assert watch.status(STATUS, payload()) == ["drone1 ok"]
    assert watch.status(STATUS, payload()) == []
    (line,) = watch.status(STATUS, payload("clock", "something_new"))
    assert line == f"drone1 degraded: clock ({Degraded.CLOCK.meaning}), something_new"
    assert watch.status(STATUS, payload()) == ["drone1 ok"]
    assert watch.alive(KEY, False)[0].startswith("drone1 is gone")
    assert watch.alive(KEY, True) == ["drone1 is there"]
    assert watch.status(STATUS, payload()) == ["drone1 ok"]


def test_foreign_text_is_escaped_and_memory_bounded() -> None:
    watch = VehicleWatch()
    foul = "\x1b[2J\n"
    lines = [
        *watch.alive(f"distloc/{foul}/alive", True),
        *watch.status(f"distloc/{foul}/status", payload(foul)),
        *watch.status(STATUS, b'{"state": "' + foul.encode() + b'"'),
        *watch.status(STATUS, b"[" * 100_000),
        *watch.link(foul, True),
    ]
    assert len(lines) == 5 and all(line.isprintable() for line in lines)
    assert len(watch.status(STATUS, payload(*("x" * 10_000 for _ in range(1000))))[0]) < 20_000
    for number in range(1000):
        watch.alive(f"distloc/v{number}/alive", True)
    assert len(watch._last) == MAX_VEHICLES
