"""One soak: opens the service, its autopilot, camera and listener, plays the faults, measures once a second."""

import contextlib
import os
import socket
import tempfile
import threading
import time
from collections.abc import Callable
from pathlib import Path

import msgspec
import numpy as np

from service.commands.soak.faults import KINDS, FaultPlayer, Flown, Rig
from service.commands.soak.frame_ring import make_memory, read_handed
from service.commands.soak.judging.latency import Latencies
from service.commands.soak.judging.measuring import Measuring, Now
from service.commands.soak.judging.result import (
    Counts,
    Cpu,
    FaultResult,
    Latency,
    Life,
    SoakResult,
    memory_from_series,
    verdict,
)
from service.commands.soak.judging.series import Series
from service.commands.soak.judging.targets import TargetCount
from service.commands.soak.scene import config_toml, orbit
from service.commands.soak.schedule import Pace, planned_faults
from service.commands.soak.supervisor import Child, Notified
from service.common.files import write_whole
from service.config.sections import SegmenterConfig
from service.simulator.chatter import chatter_hz
from service.simulator.craft import CraftOnAir
from service.simulator.operator import Heard, Operator

_READY_S = 60.0
_TICK_S = 0.1


class SoakError(Exception):
    """A soak that cannot be flown: one line that says why."""


class Settings(msgspec.Struct, frozen=True):
    """`pace` and `kinds` are for who wants another flight than the command's."""

    minutes: float
    speed: float = 1.0
    seed: int = 1
    segmenter: SegmenterConfig = SegmenterConfig(kind="onnx")
    n_particles: int = 100_000
    pace: Pace = Pace()
    kinds: tuple[str, ...] = KINDS


class Flight:
    """`with` opens and closes it all; no process stays behind, whatever happens to this one."""

    def __init__(self, settings: Settings, out: Path) -> None:
        self.settings = settings
        self.series = Series(int(settings.minutes * 60.0) + 2)
        self._stack = contextlib.ExitStack()
        try:
            self._open(settings, out)
        except BaseException:
            self._stack.close()
            raise

    def _open(self, settings: Settings, out: Path) -> None:
        # beside the results, as /tmp may be memory
        folder = Path(self._stack.enter_context(tempfile.TemporaryDirectory(prefix=".flight-", dir=out)))
        self._scenario = scenario = orbit(settings.speed)
        mavlink_port, endpoint = _free_port(socket.SOCK_DGRAM), f"tcp/127.0.0.1:{_free_port(socket.SOCK_STREAM)}"
        config = folder / "config.toml"
        config.write_text(
            config_toml(
                scenario, settings.segmenter, settings.speed, settings.n_particles, mavlink_port, endpoint, folder
            ),
            encoding="utf-8",
        )
        scene = folder / "scenario.json"
        write_whole(scene, msgspec.json.encode(scenario))
        self._memory = make_memory(3 * scenario.camera.width * scenario.camera.height)
        self._stack.callback(os.close, self._memory)
        ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self._notified = Notified()
        self._stack.callback(self._notified.close)
        self._start_ns = time.monotonic_ns()
        with ours, theirs:
            begun_s = time.monotonic()
            self._camera = self._child(
                "renderer",
                [str(scene), str(self._start_ns), str(settings.seed), str(self._memory), str(ours.fileno())],
                out / "renderer.log",
                (self._memory, ours.fileno()),
            )
            self._service = self._child(
                "served",
                [str(config), str(self._memory), str(theirs.fileno())],
                out / "service.log",
                (self._memory, theirs.fileno()),
                NOTIFY_SOCKET=self._notified.address,
            )
        self._await_ready()
        self._ready_s = time.monotonic() - begun_s
        self._targets = TargetCount(scenario)
        self._latencies = Latencies(lambda: read_handed(self._memory), self._start_ns)
        self._operator = Operator(endpoint, self._on_report)
        self._stack.callback(self._operator.close)
        rates_hz = chatter_hz(settings.speed)
        self._air = CraftOnAir(scenario, mavlink_port, self._start_ns, chatter_hz=rates_hz, seed=settings.seed)
        self._stack.callback(self._air.close)
        self._rig = Rig(self._air, self._camera, self._operator, self._service.pid, folder / "recording")

    def __enter__(self) -> "Flight":
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()

    def fly(self, stop: threading.Event, tell: Callable[[Now], None]) -> SoakResult:
        """Until the time is over, `stop` or the service's end; `tell` is called once a second."""
        settings, duration_s = self.settings, self.settings.minutes * 60.0
        planned = planned_faults(duration_s, settings.kinds, settings.pace, np.random.default_rng(settings.seed))
        start_s = time.monotonic()
        player = FaultPlayer(planned, self._rig, start_s)
        measuring = Measuring(self.series, self._service.pid, self._memory, self._latencies, self._air, self._operator)
        rows = 0
        while not stop.wait(_TICK_S) and self._service.exit_code is None:
            self._notified.listen()
            player.play()
            t_s = time.monotonic() - start_s
            if t_s >= duration_s:
                break
            if t_s >= rows:
                rows = int(t_s) + 1
                measuring.row(t_s, player.current, tell)
            if self._camera.exit_code is not None:
                raise SoakError(f"the renderer ended: {_last_line(self._camera.log)}")
        flown_s = time.monotonic() - start_s
        is_clean = self._service.exit_code is None
        player.end()
        flown = measuring.flown
        is_clean = is_clean and self._service.end() == 0
        self._notified.listen()
        if not self.series["t_s"].size:
            raise SoakError("it ended before a second was over: there is nothing to judge")
        return self._result(flown, player.flown, flown_s, is_clean)

    def _result(self, flown: dict[str, int], played: list[Flown], flown_s: float, is_clean: bool) -> SoakResult:
        overall, targets = self._latencies.overall(), self._targets.found
        faults = [
            FaultResult(
                kind=one.kind,
                start_s=one.start_s,
                end_s=one.end_s,
                recovered_s=one.recovered_s,
                degraded=sorted(one.degraded),
            )
            for one in played
            # one that was cut short by the flight's end had no time to recover
            if one.recovered_s is not None or one.end_s + self.settings.pace.rest_s <= flown_s
        ]
        counts = Counts(
            frames_wanted=round(flown_s * self._scenario.fps),
            frames_sent=flown["frames"],
            frames_late=flown["late"],
            frames_localised=flown["localised"],
            messages_sent=flown["messages"],
            messages_used=flown["used"],
            reports=flown["reports"],
            reports_unmatched=self._latencies.unmatched,
            targets=len(targets),
            targets_inside=sum(target.is_inside for target in targets),
            targets_false=sum(target.is_false for target in targets),
        )
        memory = memory_from_series(self.series["t_s"], self.series["memory_mb"], self.series["peak_mb"])
        latency = Latency(p50_ms=_ms(overall.p50_ms), p95_ms=_ms(overall.p95_ms), max_ms=_ms(overall.max_ms))
        life = Life(ready_s=round(self._ready_s, 2), crashes=int(not is_clean), watchdog_misses=self._notified.misses)
        cpu = self.series["cpu_share"]
        return SoakResult(
            minutes=round(flown_s / 60.0, 3),
            minutes_wanted=self.settings.minutes,
            speed=self.settings.speed,
            seed=self.settings.seed,
            segmenter=self.settings.segmenter.kind,
            n_particles=self.settings.n_particles,
            counts=counts,
            memory=memory,
            cpu=Cpu(mean=round(float(cpu.mean()), 3), p95=round(float(np.percentile(cpu, 95)), 3)),
            latency=latency,
            life=life,
            faults=faults,
            targets=targets,
            verdict=verdict(memory, latency, life, counts, faults, flown_s),
        )

    def _on_report(self, heard: Heard) -> None:
        self._latencies.take(heard)
        self._targets.take(heard.what, self._operator.places[heard.what["target"]])

    def _child(self, module: str, arguments: list[str], log: Path, fds: tuple[int, ...], **env: str) -> Child:
        child = Child(module, arguments, log, fds, **env)
        self._stack.callback(child.end)
        return child

    def _await_ready(self) -> None:
        until_s = time.monotonic() + _READY_S
        while not self._notified.is_ready:
            if self._service.exit_code is not None:
                raise SoakError(f"the service ended before it was ready: {_last_line(self._service.log)}")
            if time.monotonic() > until_s:
                raise SoakError(f"the service was not ready within {_READY_S:.0f} s: see {self._service.log}")
            self._notified.listen(_TICK_S)


def _ms(value: float) -> float | None:
    return round(value, 1) if np.isfinite(value) else None


def _last_line(log: Path) -> str:
    lines = log.read_text(errors="replace").split("\n")
    return next((line for line in reversed(lines) if line.strip()), f"{log} is empty")


def _free_port(kind: socket.SocketKind) -> int:
    with socket.socket(socket.AF_INET, kind) as free:
        free.bind(("127.0.0.1", 0))
        return int(free.getsockname()[1])
