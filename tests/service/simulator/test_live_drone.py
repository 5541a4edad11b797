"""The drone that anybody can listen to, and the README's walk-through: from its first command to a confirmed fire."""

import contextlib
import math
import re
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
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from service.config.load import load_config
from service.ground.subscriber import Subscriber, line_from_report
from service.mavlink.framer import Framer
from service.simulator.begun_anew import BegunAnew
from service.simulator.live_drone import LiveError, fly, live_config_toml, parse_host_port, write_config
from service.simulator.on_air import serve
from service.simulator.pictures import PicturesError, draw_pictures
from service.simulator.scenario import load_scenario
from service.simulator.served_camera import ServedCamera
from service.simulator.simulated_autopilot import SimulatedAutopilot
from tests.support.places import HANG_S
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
        process.communicate(timeout=HANG_S)


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
            assert confirmed.wait(HANG_S)


def test_a_folder_of_pictures_as_the_camera_and_a_service_that_starts_later(tmp_path: Path) -> None:
    """The doctor looks first; the flight begins with the service, so that its pictures are in step."""
    scenario, config, pictures = tmp_path / "quick.toml", tmp_path / "drone.toml", tmp_path / "pictures"
    scenario.write_text(QUICK)
    port, endpoint = free_port(socket.SOCK_DGRAM), f"tcp/127.0.0.1:{free_port()}"
    confirmed = threading.Event()
    heard: list[str] = []

    def hear(key: str, payload: bytes) -> None:
        heard.append(line_from_report(key, payload))
        if " confirmed " in heard[-1]:
            confirmed.set()

    options = ["--scenario", str(scenario), "--connect", f"127.0.0.1:{port}", "--pictures", str(pictures)]
    with distloc("autopilot", *options, "--seconds", "60", "--write-config", str(config)) as drone:
        assert drone.stdout is not None
        assert drone.stdout.readline().startswith(f"wrote 300 pictures to {pictures}: 60 s of flight")
        assert drone.stdout.readline() == f"wrote {config}\n"
        text = config.read_text().replace("tcp/127.0.0.1:7447", endpoint)
        config.write_text(text + "[localizer]\nn_particles = 20000\n")
        with distloc("check", "--config", str(config), "--seconds", "3") as doctor:
            said, _ = doctor.communicate(timeout=HANG_S)
        assert "ok    pose: " in said and "ok    camera: " in said, said
        with distloc("run", "--config", str(config)), Subscriber([endpoint], hear):
            assert confirmed.wait(HANG_S)
    lat_deg, lon_deg = (float(number) for number in re.findall(r" (\d+\.\d{5})", heard[-1])[:2])
    fire = load_scenario(str(scenario))
    lat_fire, lon_fire, _ = fire.frame.geodetic_from_enu(fire.targets[0].plume.base_enu_m)
    off_m = math.hypot((lat_deg - lat_fire) * 111_000.0, (lon_deg - lon_fire) * 75_000.0)
    assert off_m < 150.0, heard[-1]  # a second out of step would be 60 m of flight and 3 degrees of turn


def test_pictures_go_into_a_new_folder_only(tmp_path: Path) -> None:
    with pytest.raises(PicturesError, match=r"^--pictures .*: File exists: it must be a new folder$"):
        draw_pictures(tmp_path, load_scenario("patrol"), 0, 1, lambda done: None)


def test_the_flight_begins_anew_with_each_companion() -> None:
    scenario = load_scenario("patrol")
    drone = BegunAnew(lambda booted_s: SimulatedAutopilot(scenario, np.random.default_rng(1), 0.0, booted_s))
    companion = mavlink.MAVLink(None, 1, 191)

    def heartbeat(component: int = 191) -> bytes:
        companion.srcComponent = component
        return bytes(mavlink.MAVLink_heartbeat_message(18, 8, 0, 0, 4, 3).pack(companion))

    def boot_s(t_s: float) -> float:
        return drone._flying.boot_ns(t_s - drone._since_s) * 1e-9

    def heartbeats(t_s: float) -> int:
        return sum(frame.message_id == 0 for _, raw in drone.due(t_s) for frame in Framer().feed(raw))

    assert sum(heartbeats(0.05 * step) for step in range(40)) >= 20  # it is found at once
    drone.receive(heartbeat(190), 5.0)  # ground control is no companion
    assert boot_s(5.0) == pytest.approx(10_005.0, abs=1.0)
    for t_s in (10.0, 11.0, 12.5):
        drone.receive(heartbeat(), t_s)
    assert boot_s(12.5) == pytest.approx(92.5, abs=0.2) and heartbeats(12.6) < 5
    drone.receive(heartbeat(), 30.0)
    assert boot_s(30.0) == pytest.approx(90.0, abs=0.2)


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
        viewers = [stack.enter_context(urllib.request.urlopen(camera.url, timeout=HANG_S)) for _ in range(8)]
        with pytest.raises(urllib.error.HTTPError):
            urllib.request.urlopen(camera.url, timeout=HANG_S)
        assert viewers[-1].readline() == b"--frame\r\n"
        length = [viewers[-1].readline() for _ in range(3)][1].split(b":")[1]
        image = cv2.imdecode(np.frombuffer(viewers[-1].read(int(length)), np.uint8), cv2.IMREAD_COLOR)
        assert image is not None and image.shape == (180, 320, 3)
