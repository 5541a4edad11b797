"""The ground with a hundred drones of ten fires each, in processes of their own on loopback; `distloc bench` calls it.

CPU is user and system time over wall time, memory VmRSS. The record is written as in use. A probing drone's reports are
timed from the call that publishes to the screen, or, where there is no Chromium, to the page's WebSocket.
"""

import socket
import tempfile
import time
from collections.abc import Callable
from functools import partial
from importlib.util import find_spec
from pathlib import Path

import msgspec
import numpy as np

from distloc.types import TargetState
from service.commands.bench.ground.crowd import LAT_DEG, LON_DEG, Crowd, fire
from service.commands.bench.ground.screens import Screen, screen
from service.commands.bench.ground.served import Served
from service.commands.bench.service.pipeline import Latency
from service.commands.bench.service.processes import free_port
from service.commands.errors import MissingExtraError
from service.config.sections import ZenohConfig
from service.publish.wire import Report, encode
from service.publish.zenoh import ZenohPublisher

DRONES, FIRES = 100, 10
SECONDS = 30.0
ROUNDS = 40
STEPS = ROUNDS + 4
LONG_S = 300.0  # only from so long on is a slope more than noise
_FRAMES_S = 5.0
_PROBE = "probe"
_MOST_UNSEEN = 3  # then no more are sent
_LEAST_PAUSE_S, _MOST_PAUSE_S = 0.1, 0.3  # between two reports: the ground looks ten times a second


class GroundCost(msgspec.Struct, frozen=True):
    """CPU as a share of a core; `screen` is what a report was timed to, and null are the frames without one.

    The slope is of the memory after half of `seconds`.
    """

    drones: int
    fires: int
    reports_hz: float
    cpu: float
    cpu_watched: float
    seconds: float
    rss_mb: float
    peak_rss_mb: float
    rss_mb_per_hour: float
    screen: str
    late_joiner_s: float
    frames_hz: float | None
    put_to_screen: Latency
    unseen: int


def is_ground_installed() -> bool:
    """Whether the extra `ground` is here."""
    return find_spec("aiohttp") is not None


def measure_ground(
    drones: int = DRONES,
    fires: int = FIRES,
    seconds: float = SECONDS,
    rounds: int = ROUNDS,
    settle_s: float = 8.0,
    on_step: Callable[[], None] = lambda: None,
) -> GroundCost:
    """Serve that many drones; RuntimeError where the ground or they don't, MissingExtraError without `ground`."""
    if not is_ground_installed():
        raise MissingExtraError("the ground's page needs aiohttp: pip install 'distloc[ground]'")
    endpoint = f"tcp/127.0.0.1:{free_port(socket.SOCK_STREAM)}"
    with (
        tempfile.TemporaryDirectory(prefix="distloc-") as folder,
        Served(endpoint, Path(folder)) as ground,
        Crowd(endpoint, drones, fires) as crowd,
    ):
        crowd.published()
        ground.rest(settle_s)
        on_step()
        before, cpu_s, begun_s = crowd.published(), ground.cpu_s(), time.monotonic()
        held_mb = _memory(ground, seconds)
        taken_s = time.monotonic() - begun_s
        cpu, reports_hz = (ground.cpu_s() - cpu_s) / taken_s, (crowd.published() - before) / taken_s
        on_step()
        with screen(ground.address) as watcher:
            late_joiner_s = watcher.late_s(drones * fires)
            on_step()
            frames_hz = watcher.frames_hz(LAT_DEG, LON_DEG, _FRAMES_S)
            on_step()
            cpu_s, begun_s = ground.cpu_s(), time.monotonic()
            seen_s = _seen(watcher, endpoint, rounds, on_step)
            cpu_watched = (ground.cpu_s() - cpu_s) / (time.monotonic() - begun_s)
        return GroundCost(
            drones=drones,
            fires=fires,
            reports_hz=round(reports_hz, 1),
            cpu=round(cpu, 4),
            cpu_watched=round(cpu_watched, 4),
            seconds=seconds,
            rss_mb=round(held_mb[-1], 1),
            peak_rss_mb=round(ground.rss_mb("VmHWM"), 1),
            rss_mb_per_hour=round(_slope(held_mb, seconds), 2),
            screen=watcher.kind,
            late_joiner_s=round(late_joiner_s, 2),
            frames_hz=None if frames_hz is None else round(frames_hz, 1),
            put_to_screen=_latency(seen_s),
            unseen=rounds - len(seen_s),
        )


def _memory(ground: Served, seconds: float) -> list[float]:
    """MB, twice a second."""
    held_mb = []
    for _ in range(max(4, round(2 * seconds))):
        ground.rest(0.5)
        held_mb.append(ground.rss_mb())
    return held_mb


def _slope(held_mb: list[float], seconds: float) -> float:
    late = held_mb[len(held_mb) // 2 :]
    return float(np.polyfit(np.linspace(0.0, seconds / 2.0, len(late)), late, 1)[0]) * 3600.0


def _seen(watcher: Screen, endpoint: str, rounds: int, on_step: Callable[[], None]) -> list[float]:
    """Seconds of each report that was seen: the ellipse of one fire, another length each time."""
    rng = np.random.default_rng(0)
    times_s: list[float] = []
    with ZenohPublisher(ZenohConfig(mode="client", connect=(endpoint,)), _PROBE) as publisher:
        for size_m in range(100, 100 + rounds):
            tell = partial(publisher.publish_report, 1, encode(_probe(size_m)))
            after_s = watcher.seen_after_s(f"{_PROBE}/1", size_m, tell)
            times_s += [] if after_s is None else [after_s]
            if size_m - 99 - len(times_s) > _MOST_UNSEEN:
                break
            time.sleep(rng.uniform(_LEAST_PAUSE_S, _MOST_PAUSE_S))
            on_step()
    return times_s


def _probe(size_m: int) -> Report:
    """Of a fire that was first seen just now: it is among the rows of the table, where the newest come first."""
    report = fire(_PROBE, 1, TargetState.CONFIRMED, LAT_DEG, LON_DEG)
    said, replace = report.properties, msgspec.structs.replace
    ellipse = replace(said.ellipse95, semi_major_m=float(size_m))
    return replace(report, properties=replace(said, ellipse95=ellipse, first_seen_utc=said.time_utc, seq=size_m))


def _latency(times_s: list[float]) -> Latency:
    if not times_s:
        raise RuntimeError("no report of the probing drone came to the screen: the bench measures nothing")
    p50_s, p95_s = np.quantile(times_s, (0.5, 0.95))
    return Latency(round(float(p50_s) * 1e3, 1), round(float(p95_s) * 1e3, 1), len(times_s))
