"""The drone that anybody can listen to, and the README's walk-through: from its first command to a confirmed fire."""

import contextlib
import socket
import subprocess
import sys
import threading
import time
import urllib.error
import urllib.request
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest

from service.config.load import load_config
from service.ground.subscriber import Subscriber, line_from_report
from service.simulator.live_drone import LiveError, fly, live_config_toml, parse_host_port, write_config
from service.simulator.on_air import serve
from service.simulator.scenario import load_scenario
from service.simulator.served_camera import ServedCamera
from tests.support.ports import free_port

QUICK = """
fps = 5.0
[path]
kind = "arc"
turn_rate_dps = 3.4
speed_mps = 60.0
[[targets]]
east_m = 880.0
north_m = 120.0
[camera]
width = 320
height = 180
fx = 225.0
fy = 225.0
cx = 160.0
cy = 90.0
[camera.mount]
yaw_deg = 90.0
pitch_deg = 15.0
"""


@contextlib.contextmanager
def distloc(*arguments: str) -> Iterator[subprocess.Popen[str]]:
    command = [sys.executable, "-m", "service", *arguments]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    try:
        yield process
    finally:
        process.terminate()
        process.communicate(timeout=60)


def test_from_the_first_command_to_a_confirmed_fire(tmp_path: Path) -> None:
    scenario, config = tmp_path / "quick.toml", tmp_path / "drone.toml"
    scenario.write_text(QUICK)
    mavlink, camera = free_port(socket.SOCK_DGRAM), free_port(socket.SOCK_STREAM)
    endpoint = f"tcp/127.0.0.1:{free_port(socket.SOCK_STREAM)}"
    confirmed = threading.Event()

    def hear(key: str, payload: bytes) -> None:
        if " confirmed " in line_from_report(key, payload):
            confirmed.set()

    options = ["--scenario", str(scenario), "--connect", f"127.0.0.1:{mavlink}", "--camera", f"127.0.0.1:{camera}"]
    with distloc("autopilot", *options, "--write-config", str(config)) as drone:
        assert drone.stdout is not None
        said = [drone.stdout.readline() for _ in range(4)]
        assert said[0] == f"wrote {config}\n" and said[1] == f"camera: http://127.0.0.1:{camera}/\n"
        text = config.read_text().replace("tcp/127.0.0.1:7447", endpoint)
        config.write_text(text + "[localizer]\nn_particles = 20000\n")
        with distloc("run", "--config", str(config)), Subscriber([endpoint], hear):
            assert confirmed.wait(120.0)


@pytest.mark.parametrize("name", ["patrol", "demo"])
def test_the_config_that_it_writes_is_one(name: str, tmp_path: Path) -> None:
    path = tmp_path / "drone.toml"
    write_config(path, live_config_toml(load_scenario(name), ("127.0.0.1", 14550), ("127.0.0.1", 8090)))
    config = load_config(path)
    assert config.mavlink.links[0].url == "udpin:127.0.0.1:14550"
    assert (config.camera.source.kind, config.camera.source.path) == ("rtsp", "http://127.0.0.1:8090/")
    assert (config.camera.width, config.camera.mount.yaw_deg) == (
        load_scenario(name).camera.width,
        load_scenario(name).camera.mount.yaw_deg,
    )
    with pytest.raises(FileExistsError):
        write_config(path, "")


@pytest.mark.parametrize("text", ["", "14550", "host:", ":14550", "host:port", "host:0", "host:70000"])
def test_what_is_no_address_is_refused(text: str) -> None:
    with pytest.raises(ValueError, match="must be HOST:PORT"):
        parse_host_port(text)


def test_an_address_may_have_brackets() -> None:
    assert parse_host_port("[::1]:14550") == ("::1", 14550)


def test_a_port_in_use_and_an_address_that_is_none_are_one_line() -> None:
    scenario = load_scenario("hover")
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        with pytest.raises(LiveError, match=f"^--camera 127.0.0.1:{port}: Address already in use$"):
            fly(scenario, 1, [], ("127.0.0.1", port), print)
    with pytest.raises(LiveError, match=r"^--connect no\.invalid:1: "):
        fly(scenario, 1, [("no.invalid", 1)], None, print)


def test_each_link_hears_the_autopilot_and_the_others() -> None:
    class Flying:
        heard: list[bytes] = []  # noqa: RUF012

        def receive(self, data: bytes, t_s: float) -> None:
            self.heard.append(data)
            if len(self.heard) == 2:
                stopper.send(b"s")

        def due(self, t_s: float) -> list[tuple[float, bytes]]:
            return [(0.0, b"autopilot")] if not self.heard else []

    with contextlib.ExitStack() as stack:
        stop, stopper = (stack.enter_context(one) for one in socket.socketpair())
        ours, theirs = [], []
        for _ in range(2):
            a, b = (stack.enter_context(one) for one in socket.socketpair(socket.AF_UNIX, socket.SOCK_DGRAM))
            a.setblocking(False)
            b.settimeout(30.0)
            ours.append(a)
            theirs.append(b)
        theirs[0].send(b"companion")
        theirs[1].send(b"station")
        serve(Flying(), ours, time.monotonic_ns(), 30.0, stop)
        for other, said in zip(theirs, (b"station", b"companion"), strict=True):
            assert {other.recv(100), other.recv(100)} == {b"autopilot", said}


def test_the_camera_serves_pictures_and_only_so_many_viewers(tmp_path: Path) -> None:
    (tmp_path / "quick.toml").write_text(QUICK)
    scenario = load_scenario(str(tmp_path / "quick.toml"))
    with ServedCamera(scenario, time.monotonic_ns(), 1, "127.0.0.1", 0) as camera, contextlib.ExitStack() as stack:
        viewers = [stack.enter_context(urllib.request.urlopen(camera.url, timeout=60)) for _ in range(8)]
        with pytest.raises(urllib.error.HTTPError):
            urllib.request.urlopen(camera.url, timeout=60)
        assert viewers[-1].readline() == b"--frame\r\n"
        length = [viewers[-1].readline() for _ in range(3)][1].split(b":")[1]
        image = cv2.imdecode(np.frombuffer(viewers[-1].read(int(length)), np.uint8), cv2.IMREAD_COLOR)
        assert image is not None and image.shape == (180, 320, 3)
