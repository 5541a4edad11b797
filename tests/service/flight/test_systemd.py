"""The unit files as systemd reads them, and a watchdog that a stalled pipeline starves; nothing is ever started."""

import asyncio
import re
import shutil
import socket
import subprocess
import sys
import threading
import time
from collections import Counter
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager
from pathlib import Path

import numpy as np
import pytest

from distloc.types import RejectReason
from service.common.messages import Frame
from service.config.sections import CameraConfig, Config, LinkConfig, MavlinkConfig, SourceConfig, ZenohConfig
from service.flight import watchdog
from service.flight.app import App
from service.mavlink import link as mavlink_link
from service.mavlink.link import Link
from service.mavlink.serial_carrier import SerialCarrier
from tests.support.places import HANG_S, ROOT

SYSTEMD = ROOT / "systemd"
UNIT = SYSTEMD / "distloc.service"
SHADES = np.tile(np.arange(0, 192, 3, dtype=np.uint8)[:, None], (48, 1, 3))
needs_analyze = pytest.mark.skipif(shutil.which("systemd-analyze") is None, reason="systemd-analyze is not installed")


def analyzed(folder: Path, drop_in: Path | None, *more: str) -> subprocess.CompletedProcess[str]:
    """What systemd-analyze says of the unit's copy, with an executable that exists here and perhaps a drop-in."""
    text = UNIT.read_text(encoding="utf-8")
    assert "ExecStart=/opt/distloc/bin/distloc run --config /etc/distloc/config.toml\n" in text
    unit = folder / "distloc.service"
    unit.write_text(text.replace("/opt/distloc/bin/distloc", sys.executable), encoding="utf-8")
    if drop_in:
        (folder / "distloc.service.d").mkdir()
        shutil.copy(drop_in, folder / "distloc.service.d")
    command = ["systemd-analyze", *more, str(unit)]
    return subprocess.run(command, capture_output=True, text=True, timeout=HANG_S, check=False)


DROP_INS = [None, *sorted((SYSTEMD / "distloc.service.d").glob("*.conf"))]


@needs_analyze
@pytest.mark.parametrize("drop_in", DROP_INS)
def test_verify_says_nothing(tmp_path: Path, drop_in: Path | None) -> None:
    done = analyzed(tmp_path, drop_in, "verify")
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")


@needs_analyze
def test_verify_would_see_a_mistake_in_a_drop_in(tmp_path: Path) -> None:
    wrong = tmp_path / "wrong.conf"
    wrong.write_text("[Service]\nDeviceAlow=/dev/nvmap rw\n")
    assert "DeviceAlow" in analyzed(tmp_path, wrong, "verify").stderr


@needs_analyze
@pytest.mark.parametrize("drop_in", DROP_INS)
def test_its_exposure_is_at_most_2(tmp_path: Path, drop_in: Path | None) -> None:
    done = analyzed(tmp_path, drop_in, "security", "--offline=true", "--threshold=20", "--no-pager")
    found = re.search(r"Overall exposure level for distloc.service: ([0-9.]+)", done.stdout)
    assert found is not None, done.stderr
    assert float(found[1]) <= 2.0
    assert done.returncode == 0


def test_what_the_service_counts_on() -> None:
    lines = UNIT.read_text(encoding="utf-8").splitlines()
    for line in ("Type=notify", "Restart=always", "RestartPreventExitStatus=78", "User=distloc", "WatchdogSec=20"):
        assert line in lines


class Supervisor:
    """systemd's end of the notify socket."""

    def __init__(self, sock: socket.socket) -> None:
        self._sock = sock

    async def said(self) -> str:
        data = await asyncio.wait_for(asyncio.get_running_loop().sock_recv(self._sock, 4096), HANG_S)
        return data.decode()

    async def wait_for(self, word: str) -> list[str]:
        """All that is said until a message has `word`, that one last."""
        heard: list[str] = []
        end_s = time.monotonic() + HANG_S
        while not heard or word not in heard[-1]:
            assert time.monotonic() < end_s, heard
            heard.append(await self.said())
        return heard


class Paced:
    """A camera of ten frames a second, each unlike the one before."""

    def __init__(self) -> None:
        self.rejected: Counter[RejectReason] = Counter()
        self._closed = threading.Event()
        self._number = 0

    def read(self) -> Frame | None:
        if self._closed.wait(0.1):
            return None
        self._number += 1
        return Frame(time.monotonic_ns(), "shades", SHADES + np.uint8(self._number % 9))

    def close(self) -> None:
        self._closed.set()

    def __enter__(self) -> "Paced":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


@asynccontextmanager
async def served(app: App, supervisor: Supervisor) -> AsyncIterator[None]:
    stop = asyncio.Event()
    serving = asyncio.create_task(app.run(stop))
    try:
        await supervisor.wait_for("READY=1")
        yield
    finally:
        stop.set()
        await asyncio.wait_for(serving, HANG_S)


Body = Callable[[Supervisor], Awaitable[None]]


@pytest.fixture
def supervise(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[[Body], None]:
    """Runs a test's body with a notify socket of its own and limits of 4 s."""
    monkeypatch.setattr(watchdog, "FRAME_LIMIT_NS", 4_000_000_000)
    monkeypatch.setattr(watchdog, "LINK_LIMIT_NS", 4_000_000_000)
    monkeypatch.setenv("NOTIFY_SOCKET", str(tmp_path / "n"))

    def run(body: Body) -> None:
        with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as sock:
            sock.bind(str(tmp_path / "n"))
            sock.setblocking(False)
            asyncio.run(asyncio.wait_for(body(Supervisor(sock)), 2 * HANG_S))  # type: ignore[arg-type]

    return run


def config(*urls: str) -> Config:
    camera = CameraConfig(width=64, height=48, fx=60.0, fy=60.0, cx=32.0, cy=24.0, source=SourceConfig())
    links = tuple(LinkConfig(url=url) for url in urls)
    return Config(camera=camera, mavlink=MavlinkConfig(links=links), zenoh=ZenohConfig(enabled=False))


async def assert_starved_then_fed(supervisor: Supervisor, name: str, release: Callable[[], None]) -> None:
    heard = await supervisor.wait_for(f"STATUS=stalled: {name}")
    heard += [await supervisor.said() for _ in range(2)]
    after = heard[next(i for i, text in enumerate(heard) if "stalled" in text) :]
    assert not any("WATCHDOG=1" in text for text in after)
    release()
    await supervisor.wait_for("WATCHDOG=1")


def test_a_stuck_worker_starves_the_watchdog(
    supervise: Callable[[Body], None], monkeypatch: pytest.MonkeyPatch
) -> None:
    async def body(supervisor: Supervisor) -> None:
        app = App(config("udpin:127.0.0.1:0"), source=Paced())
        process = app.pipeline.stage.process
        free = threading.Event()
        free.set()
        monkeypatch.setattr(
            app.pipeline.stage, "process", lambda frame, pose: (free.wait(2 * HANG_S), process(frame, pose))[1]
        )
        async with served(app, supervisor):
            command = [sys.executable, "-m", "service.simulator.simulated_autopilot", "--scenario", "demo"]
            command += ["--connect", f"127.0.0.1:{app.links[0].port}"]
            command += ["--start-monotonic-ns", str(time.monotonic_ns())]
            with subprocess.Popen(command) as autopilot:
                try:
                    while not app.pipeline.stage.frames:
                        assert "stalled" not in await supervisor.said()
                    free.clear()
                    await assert_starved_then_fed(supervisor, "localise", free.set)
                finally:
                    free.set()
                    autopilot.terminate()

    supervise(body)


def test_a_stuck_link_starves_the_watchdog(supervise: Callable[[Body], None], monkeypatch: pytest.MonkeyPatch) -> None:
    async def body(supervisor: Supervisor) -> None:
        free = asyncio.Event()
        connect = mavlink_link.open_carrier

        async def hangs(*arguments: object) -> mavlink_link.Carrier:
            await free.wait()
            return await connect(*arguments)  # type: ignore[arg-type]

        monkeypatch.setattr(mavlink_link, "open_carrier", hangs)
        async with served(App(config("udpout:127.0.0.1:9")), supervisor):
            await assert_starved_then_fed(supervisor, "udpout:127.0.0.1:9", free.set)

    supervise(body)


@pytest.mark.parametrize("urls", [(), ("udpin:127.0.0.1:0", "tcp:127.0.0.1:9")])
@pytest.mark.parametrize("has_camera", [False, True])
def test_no_camera_and_no_autopilot_are_no_stall(
    supervise: Callable[[Body], None], urls: tuple[str, ...], has_camera: bool
) -> None:
    async def body(supervisor: Supervisor) -> None:
        app = App(config(*urls), source=Paced() if has_camera else None)
        async with served(app, supervisor):
            heard = [await supervisor.said() for _ in range(7)]  # one a second: past both limits
            assert all("WATCHDOG=1" in text for text in heard)
            assert bool(app.rejects) is has_camera

    supervise(body)


class Wedged:
    """A serial device whose driver never comes back from a read."""

    baudrate = 57600
    in_waiting = 0

    def __init__(self) -> None:
        self.free = threading.Event()

    def read(self, _size: int) -> bytes:
        self.free.wait(HANG_S)
        return b""

    def write(self, data: bytes) -> int:
        return len(data)

    def close(self) -> None:
        pass


def test_a_wedged_serial_driver_stalls_its_link(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(mavlink_link, "BEAT_S", 0.25)

    async def body() -> None:
        device = Wedged()

        async def opened(*_: object) -> SerialCarrier:
            return SerialCarrier(device, lambda data: None)

        monkeypatch.setattr(mavlink_link, "open_carrier", opened)
        link = Link(mavlink_link.Endpoint("serial", "/dev/ttyX", 57600), lambda link, data: None)
        task = asyncio.create_task(link.run())
        end_s = time.monotonic() + HANG_S
        while time.monotonic_ns() - link.beat_ns < 1_500_000_000:
            assert time.monotonic() < end_s
            await asyncio.sleep(0.05)
        device.free.set()
        stuck_ns = link.beat_ns
        while link.beat_ns == stuck_ns:
            assert time.monotonic() < end_s
            await asyncio.sleep(0.05)
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)

    asyncio.run(body())


def test_a_segmenter_that_fails_on_every_frame_is_a_stall_and_one_failure_is_not() -> None:
    dog = watchdog.Watchdog(())
    second_ns = 1_000_000_000
    dog.frame_waits(0)
    dog.frame_failed(second_ns)
    assert dog.stalled(60 * second_ns) == ()
    for now_s in range(60, 82):
        dog.frame_waits(now_s * second_ns)
        dog.frame_failed(now_s * second_ns)
        assert dog.stalled(now_s * second_ns) == (("segmenter",) if now_s == 81 else ())
    dog.frame_waits(82 * second_ns)
    dog.frame_done()
    assert dog.stalled(82 * second_ns) == ()


@pytest.mark.parametrize(("failure_s", "refused_every"), [(0.5, 0), (6.0, 0), (19.0, 0), (0.5, 3), (6.0, 2)])
def test_slow_failures_and_refused_poses_between_do_not_hide_a_segmenter_that_fails(
    failure_s: float, refused_every: int
) -> None:
    dog = watchdog.Watchdog(())
    for number in range(1, 200):
        dog.frame_waits(round((number - 1) * failure_s * 1e9))
        if refused_every and number % refused_every == 0:
            dog.frame_refused()
        else:
            dog.frame_failed(round(number * failure_s * 1e9))
        if dog.stalled(round(number * failure_s * 1e9)):
            break
    assert dog.stalled(round(number * failure_s * 1e9)) == ("segmenter",)
    assert 20.0 < number * failure_s - failure_s < 60.0


def test_a_frame_refused_for_its_pose_does_not_excuse_the_segmenter(supervise: Callable[[Body], None]) -> None:
    async def body(supervisor: Supervisor) -> None:
        app = App(config(), source=Paced())
        async with served(app, supervisor):
            start_ns = time.monotonic_ns() - 10_000_000_000
            app.watchdog.frame_failed(start_ns)
            app.watchdog.frame_failed(start_ns + 9_000_000_000)
            while sum(app.rejects.values()) < 3:
                await asyncio.sleep(0.01)
            assert app.watchdog.stalled(time.monotonic_ns()) == ("segmenter",)

    supervise(body)
