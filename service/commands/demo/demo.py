"""`distloc demo`: a simulated autopilot's bytes and rendered frames through the real service, told as a live table."""

import asyncio
import contextlib
import logging
import socket
import subprocess
import sys
import time
from dataclasses import dataclass, field
from pathlib import Path

import msgspec
import numpy as np
from rich.console import Console
from rich.live import Live
from rich.table import Table

from distloc.filter.uncertainty import ellipse_holds
from distloc.geometry.geodesy import LocalFrame
from distloc.types import FloatArray, TargetEstimate, TargetState
from service.commands.demo.bias_blind import BiasBlind
from service.commands.demo.compass_watch import CompassWatch
from service.commands.demo.draw_map import MapPicture
from service.commands.demo.page import crew_page
from service.common import aio
from service.common.files import write_whole
from service.common.messages import LocatedTarget
from service.config.sections import Config, LinkConfig, MavlinkConfig, SegmenterConfig, ZenohConfig
from service.flight.app import App
from service.localise.mount_watch import mount_line
from service.localise.stage import Localised
from service.publish.overlay import annotated, encoded_png
from service.simulator.rendered_camera import RenderedCamera
from service.simulator.scenario import Scenario, base_enu_m, load_scenario

_MAX_PATH = 4096
_INSET_PX = (680, 500)
_START_AFTER_S = 1.0


class DemoResult(msgspec.Struct):
    """demo/result.json; nulls where no target was confirmed, or where the scenery measured nothing.

    A heading error is the reported heading minus the true one, clockwise; the scenery's with one standard deviation.
    """

    target: int | None
    state: str | None
    error_m: float | None
    range_m: float | None
    baseline_m: float | None
    semi_major_m: float | None
    semi_minor_m: float | None
    inside95: bool | None
    elapsed_s: float
    attitude: str | None = None
    heading_error_deg: float | None = None
    heading_sigma_deg: float | None = None
    true_heading_error_deg: float | None = None


@dataclass
class _Watch:
    """What the demo sees of the service, from the event loop's thread."""

    app: App
    blind: BiasBlind
    compass: CompassWatch
    path_enu_m: list[FloatArray] = field(default_factory=list)
    best: LocatedTarget | None = None
    best_frame: Localised | None = None
    particles_enu_m: FloatArray | None = None
    latest: LocatedTarget | None = None

    def see(self, localised: Localised, targets: list[LocatedTarget]) -> None:
        self.blind.see(localised)
        self.compass.see(localised, self.app.pipeline.stage.scenery.state)
        if len(self.path_enu_m) < _MAX_PATH:
            self.path_enu_m.append(localised.pose.position_enu_m)
        for target in targets:
            self.latest = target
            if target.estimate.state is TargetState.CONFIRMED:
                self.best, self.best_frame = target, localised
                self.particles_enu_m = self.app.pipeline.stage.particles_enu_m(target.estimate.id)


def run_demo(out: Path, duration_s: float, seed: int, segmenter: SegmenterConfig, shows_page: bool = False) -> bool:
    """Fly, show, write `out`; True if a target was confirmed."""
    started_s = time.monotonic()
    logging.getLogger().setLevel(logging.WARNING)
    console = Console()
    scenario = load_scenario("demo")
    out.mkdir(parents=True, exist_ok=True)
    mavlink_port, zenoh_port = _free_port(socket.SOCK_DGRAM), _free_port(socket.SOCK_STREAM)
    endpoint = f"tcp/127.0.0.1:{zenoh_port}"
    config = Config(
        vehicle="demo",
        camera=scenario.camera,
        segmenter=segmenter,
        mavlink=MavlinkConfig(links=(LinkConfig(url=f"udpin:127.0.0.1:{mavlink_port}"),)),
        zenoh=ZenohConfig(listen=(endpoint,)),
    )
    start_ns = time.monotonic_ns() + round(_START_AFTER_S * 1e9)
    reports = out / "reports.jsonl"
    reports.unlink(missing_ok=True)
    with contextlib.ExitStack() as stack:
        camera = stack.enter_context(RenderedCamera(scenario, start_ns, seed))
        autopilot = [
            "service.simulator.simulated_autopilot", "--scenario", "demo", "--connect", f"127.0.0.1:{mavlink_port}",
            "--start-monotonic-ns", str(start_ns), "--seed", str(seed),
        ]  # fmt: skip
        stack.enter_context(_process(autopilot, out / "autopilot.log"))
        if shows_page:
            stack.enter_context(crew_page(endpoint, out / "ground.log", lambda line: _say(console, line)))
        listener = ["service.ground.station", "--connect", endpoint, "--out", str(reports)]
        stack.enter_context(_process(listener, out / "subscriber.txt"))
        app = App(config, source=camera)
        watch = _Watch(app, BiasBlind(config), CompassWatch(scenario, start_ns))
        app.observe(watch.see)
        aio.run(_fly(app, watch, console, duration_s, out / "subscriber.txt"))
    result = _result(watch, scenario, time.monotonic() - started_s)
    write_whole(out / "result.json", msgspec.json.format(msgspec.json.encode(result), indent=1) + b"\n")
    _write_pictures(watch, scenario, out)
    for name in ("result.json", "reports.jsonl", "subscriber.txt", "map.png", "frame.png"):
        if (out / name).exists():
            console.print(f"wrote {out / name}", highlight=False)
    console.print(watch.compass.line(), highlight=False, soft_wrap=True)
    if (line := mount_line(app.pipeline.stage.scenery.state.mount, config.camera.mount)) is not None:
        console.print(line, highlight=False, soft_wrap=True)
    console.print(_last_line(result, watch), highlight=False, soft_wrap=True)
    return result.target is not None


def _say(console: Console, line: str) -> None:
    console.print(line, highlight=False, soft_wrap=True, markup=False)


async def _fly(app: App, watch: _Watch, console: Console, duration_s: float, heard: Path) -> None:
    stop = asyncio.Event()
    serving = asyncio.create_task(app.run(stop))
    end_s = time.monotonic() + _START_AFTER_S + duration_s
    with Live(console=console, auto_refresh=False) as live:
        while not serving.done() and (left_s := end_s - time.monotonic()) > 0:
            live.update(_table(app, watch, heard, left_s), refresh=True)
            await asyncio.wait([serving], timeout=min(0.5, left_s))
    stop.set()
    await serving


def _table(app: App, watch: _Watch, heard: Path, left_s: float) -> Table:
    table = Table(title=f"distloc demo: {left_s:.0f} s of flight left", width=78)
    for name in ("target", "state", "position", "95 % ellipse", "range", "baseline"):
        table.add_column(name, no_wrap=True)
    if watch.latest:
        one, place = watch.latest.estimate, watch.latest.place
        table.add_row(
            str(one.id),
            str(one.state),
            f"{place.lat_deg:.5f} {place.lon_deg:.5f}",
            f"{one.ellipse95.semi_major_m:.0f} x {one.ellipse95.semi_minor_m:.0f} m",
            f"{one.range_m / 1000:.2f} km",
            f"{one.baseline_m:.0f} m",
        )
    lines = heard.read_text(errors="replace").count("/targets/") if heard.exists() else 0
    degraded = ", ".join(app.degraded(time.monotonic_ns())) or "nothing"
    frames = app.pipeline.stage.frames
    table.caption = f"{frames} frames; the ground station heard {lines} reports; degraded: {degraded}"
    return table


def _result(watch: _Watch, scenario: Scenario, elapsed_s: float) -> DemoResult:
    compass = watch.compass
    nothing = DemoResult(None, None, None, None, None, None, None, None, round(elapsed_s, 1))
    result = msgspec.structs.replace(
        nothing,
        heading_error_deg=_rounded(compass.error_deg),
        heading_sigma_deg=_rounded(compass.sigma_deg),
        true_heading_error_deg=_rounded(compass.truth_deg),
    )
    if watch.best is None or watch.best_frame is None:
        return result
    one = watch.best.estimate
    offset_m = _truth_enu_m(watch, scenario) - one.position_enu_m
    return msgspec.structs.replace(
        result,
        target=one.id,
        state=str(one.state),
        error_m=round(float(np.hypot(offset_m[0], offset_m[1])), 1),
        range_m=round(float(np.linalg.norm(_truth_enu_m(watch, scenario) - watch.best_frame.pose.position_enu_m)), 1),
        baseline_m=round(one.baseline_m, 1),
        semi_major_m=round(one.ellipse95.semi_major_m, 1),
        semi_minor_m=round(one.ellipse95.semi_minor_m, 1),
        inside95=ellipse_holds(one.ellipse95, offset_m[:2]),
        attitude=one.attitude,
    )


def _rounded(value: float | None) -> float | None:
    return None if value is None else round(value, 3)


def _truth_enu_m(watch: _Watch, scenario: Scenario) -> FloatArray:
    """The nearest plume's centre (3,) in the service's own axes."""
    frame_enu = watch.app.autopilot.frame_enu
    assert frame_enu is not None and watch.best is not None
    position_enu_m = watch.best.estimate.position_enu_m
    centres = [_in_axes(scenario.frame, frame_enu, base_enu_m(target)) for target in scenario.targets]
    return min(centres, key=lambda centre: float(np.linalg.norm((centre - position_enu_m)[:2])))


def _in_axes(source: LocalFrame, target: LocalFrame, position_enu_m: FloatArray) -> FloatArray:
    return target.enu_from_geodetic(*source.geodetic_from_enu(position_enu_m))


def _write_pictures(watch: _Watch, scenario: Scenario, out: Path) -> None:
    for name in ("map.png", "frame.png"):
        (out / name).unlink(missing_ok=True)
    if watch.best is None or watch.best_frame is None or watch.particles_enu_m is None:
        return
    one: TargetEstimate = watch.best.estimate
    truth_enu_m = _truth_enu_m(watch, scenario)
    path = np.array(watch.path_enu_m).T[:2]
    cloud = watch.particles_enu_m[:2]
    blind = watch.blind.nearest(one.position_enu_m)
    shown = np.hstack([path, cloud[:, :: max(cloud.shape[1] // 500, 1)], truth_enu_m[:2, None]])
    picture, near = (
        MapPicture(shown),
        MapPicture(np.hstack([_corners(it) for it in (one, blind) if it is not None]), _INSET_PX),
    )
    for part in (picture, near):
        part.particles(cloud)
        part.path(path)
        if blind is not None:
            part.ellipse(blind.position_enu_m[:2], blind.ellipse95, is_blind=True)
        part.ellipse(one.position_enu_m[:2], one.ellipse95)
        part.truth(truth_enu_m[:2])
    picture.inset(near, shown, "the target, nearer")
    picture.legend(f"distloc demo: target {one.id}, {one.range_m / 1000:.2f} km away")
    picture.write(out / "map.png")
    frame = annotated(watch.best_frame, scenario.camera.camera())
    if frame is not None:
        write_whole(out / "frame.png", encoded_png(frame))


def _corners(one: TargetEstimate) -> FloatArray:
    """South-west and north-east (2, 2) of the square about an ellipse."""
    return one.position_enu_m[:2, None] + one.ellipse95.semi_major_m * np.array([[-1.0, 1.0], [-1.0, 1.0]])


def _last_line(result: DemoResult, watch: _Watch) -> str:
    if result.target is None or watch.best is None:
        return f"no target was confirmed in {result.elapsed_s:.0f} s"
    place = watch.best.place
    return (
        f"target {result.target} {result.state} at {place.lat_deg:.5f}, {place.lon_deg:.5f}: "
        f"{result.error_m:.0f} m off the truth at {result.range_m:.0f} m, "
        f"95 % ellipse {result.semi_major_m:.0f} x {result.semi_minor_m:.0f} m, "
        f"truth {'inside' if result.inside95 else 'outside'} it"
    )


@contextlib.contextmanager
def _process(module_and_arguments: list[str], output: Path):  # type: ignore[no-untyped-def]
    with output.open("wb") as file:
        process = subprocess.Popen([sys.executable, "-m", *module_and_arguments], stdout=file, stderr=subprocess.STDOUT)
        try:
            yield process
        finally:
            process.terminate()
            try:
                process.wait(5)
            except subprocess.TimeoutExpired:
                process.kill()


def _free_port(kind: socket.SocketKind) -> int:
    with socket.socket(socket.AF_INET, kind) as sock:
        sock.bind(("127.0.0.1", 0))
        return int(sock.getsockname()[1])
