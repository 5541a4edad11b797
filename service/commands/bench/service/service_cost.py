"""What the whole service costs, measured from outside on the real process; `distloc bench` calls it.

CPU is user and system time of /proc/PID/stat over wall time, memory is VmRSS: Linux only. The autopilot's datagrams,
the camera's stream and the listener on zenoh go over real sockets on loopback, served by this process.
"""

import contextlib
import json
import os
import socket
import statistics
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import msgspec
import numpy as np
import zenoh

from distloc.simulation.renderer import Renderer
from service.commands.bench.service.link_load import MIX_HZ, Peer, Stream
from service.commands.bench.service.processes import free_port
from service.commands.install.unit_environment import unit_environment
from service.config.sections import ZenohConfig
from service.publish.zenoh import zenoh_config
from service.simulator.scenario import PathSection, PlumeSection, Scenario, camera_pose, plumes, service_config_toml

_HELP_RUNS = 5
_SETTLE_S = 3.0  # from the first heartbeat: the requests at a connection's start are not what flying costs
_LIMIT_S = 60.0  # for whatever is waited for
_HOVER = Scenario(
    path=PathSection(speed_mps=0.0),
    targets=tuple(PlumeSection(east_m=-2000.0, north_m=north_m) for north_m in (-400.0, 220.0, 840.0, 1500.0)),
)
_PLACE = (_HOVER.origin.lat_deg, _HOVER.origin.lon_deg, _HOVER.origin.alt_msl_m + _HOVER.path.height_m)
_FRAMES = 8  # pictures of the stream in turn: one that repeats would count as frozen
_WORK_FPS = 5.0
_TARGETS = 4


class ServiceCost(msgspec.Struct, frozen=True):
    """The service's own cost; CPU as a share of one core.

    `messages_hz` is what really arrived while `messages_cpu` was measured. Idle is an autopilot with a heartbeat a
    second and a camera with a frame a second. At work are the shipped model, 100,000 particles and `targets` targets;
    the median counts, the peak is of the whole run, while the model runs on a frame.
    """

    help_s: float
    ready_s: float
    messages_hz: float
    messages_cpu: float
    idle_cpu: float
    ready_rss_mb: float
    work_rss_mb: float
    peak_rss_mb: float
    targets: int


def service_cost(seconds: float = 10.0) -> ServiceCost:
    """Start the service three times and measure each for so long; RuntimeError where it does not serve."""
    with _Service(_config("")) as service, Peer(service.port, MIX_HZ, _PLACE) as peer:
        service.settle()
        before = peer.sent
        messages_cpu = service.cpu(seconds)
        messages_hz = (peer.sent - before) / seconds * service.heard_share(peer)
    pictures = _pictures()
    with (
        Stream(pictures, 1.0) as camera,
        _Service(_config(camera.url)) as service,
        Peer(service.port, {"heartbeat": 1}, _PLACE),
    ):
        service.settle()
        idle_cpu = service.cpu(seconds)
    with Stream(pictures, _WORK_FPS) as camera, _Service(_config(camera.url)) as service:
        ready_s, ready_rss_mb = service.ready_s, service.rss_mb()
        with Peer(service.port, MIX_HZ, _PLACE):
            service.wait(lambda: len(service.targets) >= _TARGETS, f"{_TARGETS} targets")
            work_rss_mb = statistics.median(service.rss_over(seconds))
            peak_rss_mb = service.rss_mb("VmHWM")
    return ServiceCost(
        help_s=round(_help_s(), 3),
        ready_s=round(ready_s, 3),
        messages_hz=round(messages_hz, 1),
        messages_cpu=round(messages_cpu, 4),
        idle_cpu=round(idle_cpu, 4),
        ready_rss_mb=round(ready_rss_mb, 1),
        work_rss_mb=round(work_rss_mb, 1),
        peak_rss_mb=round(peak_rss_mb, 1),
        targets=len(service.targets),
    )


def _help_s() -> float:
    return statistics.median(_timed_s([sys.executable, "-m", "service", "--help"]) for _ in range(_HELP_RUNS))


def _timed_s(command: list[str]) -> float:
    started_s = time.monotonic()
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    return time.monotonic() - started_s


def _config(stream: str) -> str:
    """All but the links, which the service's own ports are put into."""
    return service_config_toml(_HOVER) + (
        f'[camera.source]\nkind = "rtsp"\npath = "{stream}"\nfps = 30.0\n' if stream else ""
    )


def _pictures() -> list[bytes]:
    """JPEGs of the plumes from where the peer hovers, each with grain of its own."""
    rng = np.random.default_rng(0)
    renderer = Renderer(_HOVER.camera.camera(), plumes(_HOVER), rng)
    image = renderer.render(camera_pose(_HOVER, 0.0, 0.0))[0].astype(np.int16)
    grain = (rng.integers(-3, 4, image.shape, dtype=np.int16) for _ in range(_FRAMES))
    return [cv2.imencode(".jpg", np.clip(image + one, 0, 255).astype(np.uint8))[1].tobytes() for one in grain]


class _Service:
    """`distloc run` in a process of its own, ready, with a listener on its zenoh."""

    def __init__(self, config_text: str) -> None:
        self._stack = contextlib.ExitStack()
        self.port, zenoh_port = free_port(socket.SOCK_DGRAM), free_port(socket.SOCK_STREAM)
        self.targets: set[str] = set()
        self.heard_bytes = 0
        self._status = threading.Event()
        try:
            self._start(config_text, f"tcp/127.0.0.1:{zenoh_port}")
        except BaseException:
            self._stack.close()
            raise

    def _start(self, config_text: str, endpoint: str) -> None:
        folder = Path(self._stack.enter_context(tempfile.TemporaryDirectory(prefix="distloc-")))
        config = folder / "config.toml"
        links = f'[[mavlink.links]]\nurl = "udpin:127.0.0.1:{self.port}"\n[zenoh]\nlisten = ["{endpoint}"]\n'
        config.write_text(config_text + links, encoding="utf-8")
        told = self._stack.enter_context(socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM))
        told.bind(str(folder / "notify"))
        log = self._stack.enter_context((folder / "log").open("w+b"))
        started_s = time.monotonic()
        self._process = subprocess.Popen(
            [sys.executable, "-m", "service", "run", "--config", str(config)],
            env=os.environ | unit_environment() | {"NOTIFY_SOCKET": str(folder / "notify")},
            stdout=log,
            stderr=subprocess.STDOUT,
        )
        self._stack.callback(self._end)
        self._wait_ready(told, log, started_s + _LIMIT_S)
        self.ready_s = time.monotonic() - started_s
        session = zenoh.open(zenoh_config(ZenohConfig(connect=(endpoint,))))
        self._stack.callback(session.close)
        session.declare_subscriber("distloc/**", self._on_sample)

    def __enter__(self) -> "_Service":
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()

    def settle(self) -> None:
        """Wait until it serves as it will."""
        self.wait(self._status.is_set, "the first status")
        self.wait_seconds(_SETTLE_S)

    def wait(self, condition: Callable[[], bool], what: str) -> None:
        """RuntimeError where it is not so in time, or the service ends."""
        end_s = time.monotonic() + _LIMIT_S
        while not condition():
            if self._process.poll() is not None or time.monotonic() > end_s:
                raise RuntimeError(f"the service did not come to {what} within {_LIMIT_S:.0f} s")
            time.sleep(0.05)

    def wait_seconds(self, seconds: float) -> None:
        """Let it serve for so long."""
        with contextlib.suppress(subprocess.TimeoutExpired):
            self._process.wait(seconds)
            raise RuntimeError(f"the service ended with {self._process.returncode}")

    def cpu(self, seconds: float) -> float:
        """Share of a core over so many seconds from now."""
        before_s, started_s = self._cpu_s(), time.monotonic()
        self.wait_seconds(seconds)
        return (self._cpu_s() - before_s) / (time.monotonic() - started_s)

    def rss_mb(self, which: str = "VmRSS") -> float:
        """Memory now, or VmHWM's most: what is resident, shared libraries with it."""
        status = Path(f"/proc/{self._process.pid}/status").read_text(encoding="ascii")
        return int(status.partition(f"{which}:")[2].split()[0]) * 1024e-6

    def rss_over(self, seconds: float) -> list[float]:
        """Memory, ten times a second for so long."""
        held_mb = []
        for _ in range(max(1, round(10 * seconds))):
            self.wait_seconds(0.1)
            held_mb.append(self.rss_mb())
        return held_mb

    def heard_share(self, peer: "Peer") -> float:
        """Share of the peer's bytes that the service says it heard, by the next status."""
        sent_bytes = peer.sent_bytes
        self._status.clear()
        self.wait(self._status.is_set, "a status")
        return min(1.0, self.heard_bytes / sent_bytes)

    def _cpu_s(self) -> float:
        fields = Path(f"/proc/{self._process.pid}/stat").read_text(encoding="utf-8").rpartition(")")[2].split()
        return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")

    def _wait_ready(self, told: socket.socket, log: Any, end_s: float) -> None:
        while time.monotonic() < end_s and self._process.poll() is None:
            told.settimeout(0.1)
            with contextlib.suppress(TimeoutError):
                if b"READY=1" in told.recv(4096):
                    return
        log.seek(0)
        raise RuntimeError(f"the service was not ready: {log.read().decode(errors='replace').strip()[-500:]}")

    def _on_sample(self, sample: zenoh.Sample) -> None:
        kind, _, name = str(sample.key_expr).partition("/")[2].partition("/")[2].partition("/")
        if kind == "targets":
            self.targets.add(name)
        elif kind == "status":
            links = json.loads(bytes(sample.payload))["counters"]["links"]
            self.heard_bytes = next(iter(links.values()))["received_bytes"]
            self._status.set()

    def _end(self) -> None:
        self._process.terminate()
        try:
            self._process.wait(15.0)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
