"""Faults of what the service writes to, zenoh and the disk; docs/faults.md says what must come of each."""

import contextlib
import os
import resource
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
import zenoh

from service.recordings.flights import flights_in
from service.recordings.recording import Recording
from service.recordings.tlog import read_tlog
from service.simulator.operator import zenoh_session
from tests.faults.harness import RECOVERED_S, Flight
from tests.support.places import HANG_S, ROOT
from tests.support.ports import free_port

PREVIEW_BYTES, PREVIEWS = 1_000_000, 30  # together more than the sockets' buffers hold


class Peer:
    """One of `tests.faults.peer`'s processes; `out` has its lines."""

    def __init__(self, kind: str, endpoint: str, out: Path) -> None:
        self.out = out
        self._command = [sys.executable, "-m", "tests.faults.peer", kind, endpoint]
        self.start()

    def start(self) -> None:
        with self.out.open("a") as file:
            self._process = subprocess.Popen(self._command, cwd=ROOT, stdin=subprocess.PIPE, stdout=file)

    def wait(self, seconds: float) -> None:
        """So long, and no longer than it lives."""
        with contextlib.suppress(subprocess.TimeoutExpired):
            raise AssertionError(f"it ended with {self._process.wait(seconds)}")

    def send(self, number: signal.Signals) -> None:
        self._process.send_signal(number)

    def end(self, number: signal.Signals = signal.SIGKILL) -> None:
        self._process.send_signal(number)
        assert self._process.stdin is not None
        self._process.stdin.close()
        self._process.wait(HANG_S)

    def lines(self, ending: str) -> int:
        """How many samples it heard of keys that end so."""
        return sum(line.endswith(ending) for line in self.out.read_text().splitlines())


class Far:
    """A subscriber behind the router."""

    def __init__(self, endpoint: str) -> None:
        self.heard_s = 0.0
        self._session = zenoh_session(mode="client", connect=[endpoint])  # a router does not join two peers
        self._subscriber = self._session.declare_subscriber("distloc/*/targets/*", self._on_report)

    def _on_report(self, _sample: zenoh.Sample) -> None:
        self.heard_s = time.monotonic()

    def close(self) -> None:
        self._session.close()


@pytest.fixture(scope="module")
def router(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[str, Peer]]:
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    out = tmp_path_factory.mktemp("router") / "out.txt"
    made = Peer("router", endpoint, out)
    end_s = time.monotonic() + HANG_S
    while "open" not in out.read_text():
        assert time.monotonic() < end_s, "the router did not begin to listen"
        made.wait(0.02)
    yield endpoint, made
    made.end()


@pytest.fixture(scope="module")
def flight(router: tuple[str, Peer], tmp_path_factory: pytest.TempPathFactory) -> Iterator[Flight]:
    with Flight(router=router[0], recording=tmp_path_factory.mktemp("flights") / "flight") as made:
        yield made


@pytest.mark.parametrize(("name", "number"), [("goes down and up", signal.SIGTERM), ("is killed", signal.SIGKILL)])
def test_zenoh_router(flight: Flight, router: tuple[str, Peer], name: str, number: signal.Signals) -> None:
    endpoint, process = router
    far = Far(endpoint)
    try:
        flight.confirm()
        flight.operator.wait_for(lambda: far.heard_s, "reports come through the router", HANG_S)
        with flight.fault(f"zenoh router {name}", degraded="zenoh") as fault:
            process.end(number)
            down_s = time.monotonic()
            fault.ends_with(process.start)
            fault.is_over = lambda: far.heard_s > down_s + 1.0
    finally:
        far.close()


def test_subscriber_that_does_not_read(flight: Flight, tmp_path: Path) -> None:
    flight.confirm()
    subscriber = Peer("subscriber", flight.endpoint, tmp_path / "out.txt")
    try:
        flight.operator.wait_for(lambda: subscriber.lines("targets/1"), "it hears", HANG_S)
        with flight.fault("zenoh subscriber does not read") as fault:
            subscriber.send(signal.SIGSTOP)
            payload = os.urandom(PREVIEW_BYTES)
            for _ in range(PREVIEWS):
                published = flight.app.zenoh.counters["zenoh_published"]
                flight.app.zenoh.publish_preview(payload)
                fault.see(lambda published=published: flight.app.zenoh.counters["zenoh_published"] > published, "put")
                gap_s = time.monotonic() - flight.operator.reports[flight.target].at_s
                assert gap_s < RECOVERED_S / 2, "the others wait for the one that does not read"
            heard = subscriber.lines("targets/1")
            fault.ends_with(lambda: subscriber.send(signal.SIGCONT))
            fault.is_over = lambda: subscriber.lines("targets/1") > heard
    finally:
        subscriber.end()


def test_disk_full(flight: Flight) -> None:
    folder = Path(flight.app.config.recorder.folder)
    flight.operator.wait_for(lambda: any(folder.glob("*/telemetry.tlog")), "a log is begun", HANG_S)
    (recorded,) = flights_in(folder)
    log = recorded / "telemetry.tlog"
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    flight.confirm()
    flight.operator.wait_for(lambda: log.stat().st_size > 150_000, "something is recorded", HANG_S)
    try:
        with flight.fault("disk full while recording", degraded="recorder") as fault:
            size = log.stat().st_size
            resource.setrlimit(resource.RLIMIT_FSIZE, (size, hard))  # what goes beyond is refused as on a full disk
            fault.ends_with(lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard)))
            fault.is_over = lambda: log.stat().st_size > size + 1000
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    recording = Recording(recorded)
    assert len(recording.frames()) > 10 and not recording.dropped
    assert sum(1 for _ in read_tlog(log)) > 1000


def test_recorder_folder_gone(flight: Flight) -> None:
    folder = Path(flight.app.config.recorder.folder)
    with flight.fault("recorder's folder gone", degraded="recorder") as fault:
        folder.rename(folder.with_name("elsewhere"))
        folder.write_text("something else is there now")
        fault.ends_with(folder.unlink)
        fault.is_over = lambda: any(folder.glob("*/telemetry.tlog"))
