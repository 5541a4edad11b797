"""From a frame to its reports through the real service, segmenter aside: on loopback, with an autopilot and a listener.

The App runs here with true masks of four plumes; the autopilot sends about 200 messages a second over UDP from a
process of its own, a zenoh subscriber listens in another. Every frame is a filter step of every target, which is more
than a flight asks for. Frames are stamped 50 ms before they are handed over, so that their pose is there: these are the
pipeline's own times. A fresher frame waits for the attitude after it: at 50 Hz that adds up to 20 ms and the link's own
delay, at 150 Hz up to 7 ms.
"""

import asyncio
import socket
import threading
import time
from collections import Counter
from collections.abc import Callable

import msgspec
import numpy as np
from numpy.typing import NDArray

from distloc.backports import Self
from distloc.filter.settings import ENOUGH_PARTICLES
from distloc.types import CameraPose, RejectReason
from service.commands.bench.service.listening import OtherProcess
from service.commands.bench.service.processes import autopilot_of, free_port
from service.commands.bench.smoke_scene import flight_past, true_mask
from service.common import aio
from service.common.messages import Frame, LocatedTarget
from service.config.sections import (
    Config,
    LinkConfig,
    LocaliserSection,
    MavlinkConfig,
    SegmenterConfig,
    StateConfig,
    ZenohConfig,
)
from service.flight.app import App
from service.localise.stage import Localised
from service.simulator.scenario import camera_pose

FRAMES, TARGETS = 200, 4
_PERIOD_NS = 100_000_000
_STAMPED_AGO_NS = 50_000_000
_DRAW_NS = 40_000_000  # before a frame is due its mask is drawn, when the last one is long done
_START_NS = 500_000_000
_ATTITUDE_HZ, _POSITION_HZ = 150.0, 34.0  # with all else that it sends, 200 messages a second
_WAIT_S = 30.0


class Latency(msgspec.Struct, frozen=True):
    """Of `n` times."""

    p50_ms: float
    p95_ms: float
    n: int


class Pipeline(msgspec.Struct, frozen=True):
    """Only frames that had a report of all targets count; `to_subscriber` is of each report, `unheard` of none."""

    n_particles: int
    targets: int
    frames: int
    messages_per_s: float
    frame_to_report: Latency
    frame_to_subscriber: Latency
    unheard: int


def measure_pipeline(
    n_particles: int = ENOUGH_PARTICLES, number: int = FRAMES, on_step: Callable[[], None] = lambda: None
) -> Pipeline:
    """Fly `number` frames at 10 a second."""
    endpoint = f"tcp/127.0.0.1:{free_port(socket.SOCK_STREAM)}"
    start_ns = time.monotonic_ns() + _START_NS
    camera = PreparedCamera(start_ns, number)
    app = App(_config(n_particles, endpoint), source=camera)
    app.pipeline.stage.segmenter = camera
    watch = _Watch(on_step)
    app.observe(watch.see)
    with OtherProcess(endpoint) as other:
        messages_per_s = aio.run(_fly(app, camera, watch, other, start_ns))
        heard_ns = other.heard_ns()
    return _result(n_particles, number, messages_per_s, camera.handed_ns, watch, heard_ns)


class PreparedCamera:
    """The frames at their times and, as the segmenter, their true masks; gives none before `begin`."""

    def __init__(self, start_ns: int, number: int) -> None:
        self.name = "prepared"
        self.rejected: Counter[RejectReason] = Counter()
        self.handed_ns: dict[str, int] = {}
        self._scenario = flight_past(TARGETS)
        self._camera = self._scenario.camera.camera()
        shape = (self._camera.height, self._camera.width, 3)
        shades = np.linspace(0, 200, shape[1], dtype=np.uint8)[:, None]  # noise alone would count as blind
        self._image = shades + np.random.default_rng(0).integers(0, 50, shape, dtype=np.uint8)
        self._masks: dict[str, NDArray[np.uint8]] = {}
        self._start_ns, self.number = start_ns, number
        self._begun, self._closed = threading.Event(), threading.Event()
        self._due_ns = 0

    def begin(self) -> None:
        """The first frame is due in a period."""
        self._due_ns = time.monotonic_ns()
        self._begun.set()

    def read(self) -> Frame | None:
        """The next frame once it is due; None at the end."""
        self._begun.wait()
        if len(self.handed_ns) == self.number or self._closed.is_set():
            return None
        self._due_ns += _PERIOD_NS
        self._wait_until(self._due_ns - _DRAW_NS)
        stamp_ns = self._due_ns - _STAMPED_AGO_NS
        t_s = (stamp_ns - self._start_ns) * 1e-9
        name, image = str(stamp_ns), self._image.copy()
        image[::16] += np.uint8(len(self.handed_ns) % 255 + 1)  # a camera's noise is new in every frame
        self._masks[name] = true_mask(self._scenario, self._camera, camera_pose(self._scenario, t_s, t_s))
        self._wait_until(self._due_ns)
        self.handed_ns[name] = time.monotonic_ns()
        return Frame(stamp_ns, name, image)

    def segment(self, frame: Frame, pose: CameraPose | None) -> NDArray[np.uint8] | RejectReason:
        """The frame's mask, made before."""
        return self._masks.pop(frame.name)

    def close(self) -> None:
        """No more frames."""
        self._closed.set()
        self._begun.set()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _wait_until(self, due_ns: int) -> None:
        self._closed.wait(max(0, due_ns - time.monotonic_ns()) * 1e-9)


class _Watch:
    """When each frame's reports were handed to the publishers, and which report is of which frame."""

    def __init__(self, on_step: Callable[[], None]) -> None:
        self.reported_ns: dict[str, int] = {}
        self.frame_of: dict[int, str] = {}
        self.seen = 0
        self._on_step = on_step

    def see(self, localised: Localised, targets: list[LocatedTarget]) -> None:
        now_ns = time.monotonic_ns()
        self.seen += 1
        if len(targets) == TARGETS:
            self.reported_ns[localised.frame.name] = now_ns
            self.frame_of |= {target.sequence: localised.frame.name for target in targets}
        self._on_step()


async def _fly(app: App, camera: PreparedCamera, watch: _Watch, other: OtherProcess, start_ns: int) -> float:
    """Serve until every frame was used or refused; messages a second while the frames came."""
    stop = asyncio.Event()
    serving = asyncio.create_task(app.run(stop))
    try:
        await _until(lambda: app.links[0].state == "open" or serving.done(), "the link")
        with autopilot_of("straight", app.links[0].port, start_ns):
            await _until(lambda: _has_pose(app), "a pose from the simulated autopilot")
            await _until(other.is_ready, "the subscriber's session")
            before, began_ns = sum(app.autopilot.messages.values()), time.monotonic_ns()
            camera.begin()
            await _until(lambda: watch.seen + _lost(app) == camera.number, "the frames", _WAIT_S + camera.number * 0.1)
            messages, took_s = sum(app.autopilot.messages.values()) - before, (time.monotonic_ns() - began_ns) * 1e-9
    finally:
        stop.set()
        camera.close()
        await serving
    return round(messages / took_s, 1)


def _has_pose(app: App) -> bool:
    now_ns = time.monotonic_ns()
    return isinstance(app.autopilot.camera_pose(now_ns - _STAMPED_AGO_NS, now_ns), CameraPose)


def _lost(app: App) -> int:
    """Frames that were refused, or dropped for a newer one."""
    return sum(app.rejects.values()) + app.frames.dropped


async def _until(condition: Callable[[], object], what: str, limit_s: float = _WAIT_S) -> None:
    end_s = time.monotonic() + limit_s
    while not condition():
        if time.monotonic() > end_s:
            raise RuntimeError(f"not within {limit_s:.0f} s: {what}")
        await asyncio.sleep(0.02)


def _config(n_particles: int, endpoint: str) -> Config:
    return Config(
        vehicle="bench",
        camera=flight_past(TARGETS).camera,
        localizer=LocaliserSection(n_particles=n_particles, step_distance_m=0.0),
        segmenter=SegmenterConfig(kind="classical"),  # the camera's own masks take its place
        mavlink=MavlinkConfig(
            links=(LinkConfig(url="udpin:127.0.0.1:0"),), attitude_hz=_ATTITUDE_HZ, position_hz=_POSITION_HZ
        ),
        zenoh=ZenohConfig(listen=(endpoint,)),
        state=StateConfig(dir=""),
    )


def _result(
    n_particles: int,
    number: int,
    messages_per_s: float,
    handed_ns: dict[str, int],
    watch: _Watch,
    heard_ns: dict[int, int],
) -> Pipeline:
    to_report = [done_ns - handed_ns[name] for name, done_ns in watch.reported_ns.items()]
    heard = [seq for seq in watch.frame_of if seq in heard_ns]
    to_subscriber = [heard_ns[seq] - handed_ns[watch.frame_of[seq]] for seq in heard]
    if not to_report or not to_subscriber:
        raise RuntimeError("the pipeline reported nothing of all its targets, or nobody heard it")
    return Pipeline(
        n_particles=n_particles,
        targets=TARGETS,
        frames=number,
        messages_per_s=messages_per_s,
        frame_to_report=_latency(to_report),
        frame_to_subscriber=_latency(to_subscriber),
        unheard=len(watch.frame_of) - len(heard),
    )


def _latency(times_ns: list[int]) -> Latency:
    p50, p95 = np.percentile(times_ns, [50.0, 95.0])
    return Latency(round(float(p50) * 1e-6, 3), round(float(p95) * 1e-6, 3), len(times_ns))
