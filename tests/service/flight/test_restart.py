"""The service as a process, killed in flight and started again: its targets are back under their ids.

All is real: the simulated autopilot's bytes on a UDP socket, rendered frames as a network camera's stream, the
service, a zenoh subscriber.
"""

import contextlib
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import cv2

from distloc.types import TargetState
from service.ground.subscriber import Subscriber
from service.localise.track_store import Kept, decode
from service.publish import wire
from service.publish.wire import Properties, decode_report
from service.simulator.rendered_camera import RenderedCamera
from service.simulator.scenario import load_scenario, service_config_toml
from tests.support.places import HANG_S, ROOT
from tests.support.ports import free_port

SCENARIO = """
fps = 5.0
[path]
kind = "arc"
turn_rate_dps = -0.1
speed_mps = 40.0
[[targets]]
east_m = -2000.0
north_m = 1130.0
[camera]
width = 640
height = 360
fx = 450.0
fy = 450.0
cx = 320.0
cy = 180.0
[camera.mount]
yaw_deg = -75.0
pitch_deg = -5.0
"""


class Stream:
    """The newest frame of a camera as a JPEG, for whoever is connected."""

    def __init__(self, camera: RenderedCamera) -> None:
        self.changed = threading.Condition()
        self.number, self.jpeg = 0, b""
        self._camera = camera
        self.is_over = False

    def feed(self) -> None:
        while (frame := self._camera.read()) is not None:
            assert frame.image is not None
            ok, data = cv2.imencode(".jpg", frame.image)
            assert ok
            with self.changed:
                self.number, self.jpeg = self.number + 1, data.tobytes()
                self.changed.notify_all()

    def next(self, after: int) -> tuple[int, bytes]:
        with self.changed:
            self.changed.wait_for(lambda: self.number > after or self.is_over, HANG_S)
            return self.number, self.jpeg

    def end(self) -> None:
        with self.changed:
            self.is_over = True
            self.changed.notify_all()


@contextlib.contextmanager
def served(camera: RenderedCamera) -> Iterator[str]:
    """The address of a stream as network cameras have it: multipart JPEG over HTTP."""
    stream = Stream(camera)

    class Handler(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            self.send_response(200)
            self.send_header("Content-Type", "multipart/x-mixed-replace; boundary=frame")
            self.end_headers()
            number = 0
            with contextlib.suppress(OSError):  # the service was killed
                while not stream.is_over:
                    number, jpeg = stream.next(number)
                    head = f"--frame\r\nContent-Type: image/jpeg\r\nContent-Length: {len(jpeg)}\r\n\r\n"
                    self.wfile.write(head.encode() + jpeg + b"\r\n")

        def log_message(self, *_: object) -> None:
            pass

    server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    server.daemon_threads = True
    threads = [threading.Thread(target=one, daemon=True) for one in (stream.feed, server.serve_forever)]
    for thread in threads:
        thread.start()
    try:
        yield f"http://127.0.0.1:{server.server_address[1]}/"
    finally:
        stream.end()
        server.shutdown()
        server.server_close()


class Heard:
    """What the subscriber got, with the time of its arrival."""

    def __init__(self) -> None:
        self.reports: list[tuple[float, Properties]] = []
        self._changed = threading.Condition()

    def on_report(self, _key: str, payload: bytes) -> None:
        with self._changed:
            self.reports.append((time.monotonic(), decode_report(payload).properties))
            self._changed.notify_all()

    def wait_for(self, is_it: Callable[[Properties], bool], after_s: float) -> tuple[float, Properties]:
        def found() -> tuple[float, Properties] | None:
            return next((one for one in self.reports if one[0] > after_s and is_it(one[1])), None)

        with self._changed:
            assert self._changed.wait_for(lambda: found() is not None, HANG_S), self.reports[-3:]
            one = found()
        assert one is not None
        return one


@contextlib.contextmanager
def running(arguments: list[str], log: Path) -> Iterator[subprocess.Popen[bytes]]:
    with (
        log.open("ab") as file,
        subprocess.Popen([sys.executable, "-m", *arguments], cwd=ROOT, stdout=file, stderr=file) as process,
    ):
        try:
            yield process
        finally:
            process.kill()


def utc_s(text: str | None) -> float:
    assert text is not None
    return wire.utc_s(text)


def wait_until(is_so: Callable[[], bool]) -> None:
    end_s = time.monotonic() + HANG_S
    while not is_so():
        assert time.monotonic() < end_s
        time.sleep(0.02)


def test_killed_in_flight_it_has_its_targets_back(tmp_path: Path) -> None:
    scenario_file, config_file, folder = tmp_path / "scenario.toml", tmp_path / "config.toml", tmp_path / "state"
    scenario_file.write_text(SCENARIO)
    scenario = load_scenario(str(scenario_file))
    mavlink_port, zenoh_port = free_port(socket.SOCK_DGRAM), free_port(socket.SOCK_STREAM)
    start_ns = time.monotonic_ns()
    endpoint, heard = f"tcp/127.0.0.1:{zenoh_port}", Heard()
    autopilot = ["service.simulator.simulated_autopilot", "--scenario", str(scenario_file), "--connect"]
    autopilot += [f"127.0.0.1:{mavlink_port}", "--start-monotonic-ns", str(start_ns), "--seed", "1"]
    service = ["service", "run", "--config", str(config_file)]
    kept_file, log = folder / "drone1.tracks", tmp_path / "service.log"

    def is_kept() -> bool:
        if not kept_file.exists():
            return False
        found = decode(kept_file.read_bytes())
        assert isinstance(found, Kept), found  # at no moment is half a file there
        return any(one.life.state is TargetState.CONFIRMED for one in found.localizer.tracks)

    with (
        RenderedCamera(scenario, start_ns, 1) as camera,
        served(camera) as address,
        running(autopilot, tmp_path / "autopilot.log"),
        Subscriber([], heard.on_report, [endpoint]),
    ):
        config_file.write_text(
            f'{service_config_toml(scenario)}\n[camera.source]\nkind = "rtsp"\npath = "{address}"\n'
            f'[[mavlink.links]]\nurl = "udpin:127.0.0.1:{mavlink_port}"\n'
            f'[zenoh]\nconnect = ["{endpoint}"]\n[localizer]\nn_particles = 20000\n[state]\ndir = "{folder}"\n'
        )
        with running(service, log) as first:
            _, confirmed = heard.wait_for(lambda one: one.state == "confirmed", 0.0)
            wait_until(is_kept)
            first.kill()
            first.wait()
        killed_s = time.monotonic()
        with running(service, log):
            # not one of the first process that was still on its way: a new process counts its reports from 1
            first_s, back = heard.wait_for(
                lambda one: one.target == confirmed.target and one.seq < confirmed.seq, killed_s
            )
            heard.wait_for(lambda one: one.observations > confirmed.observations and one.seq > back.seq, killed_s)
    print(f"the first report came {first_s - killed_s:.2f} s after the restart")
    # a target that began anew would be tentative, seen a few times, and for the first time after the restart
    assert back.state in ("confirmed", "coasting")
    assert back.observations >= confirmed.observations
    assert abs(utc_s(back.first_seen_utc) - utc_s(confirmed.first_seen_utc)) < 0.2
    assert {one.target for at_s, one in heard.reports if at_s > killed_s} == {confirmed.target}
    assert "targets are taken up: 1" in log.read_text()
