"""`distloc check` on a live system: with an autopilot, a zenoh router and a camera, and with each of them away."""

import asyncio
import itertools
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import cv2
import msgspec
import numpy as np
import pytest
import zenoh
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from service.commands.check.camera import check_camera
from service.commands.check.doctor import run_check
from service.commands.check.finding import Finding
from service.commands.check.links import check_links
from service.commands.check.zenoh import check_zenoh
from service.common.messages import Frame
from service.config.sections import (
    CameraConfig,
    Config,
    LinkConfig,
    MavlinkConfig,
    MountConfig,
    RecorderConfig,
    SegmenterConfig,
    SourceConfig,
    StateConfig,
    ZenohConfig,
)
from tests.support.frame_writer import writer
from tests.support.places import HANG_S
from tests.support.ports import free_port

WIDTH, HEIGHT = 640, 480


@pytest.fixture
def udp_port() -> int:
    return free_port(socket.SOCK_DGRAM)


@pytest.fixture
def endpoint() -> str:
    return f"tcp/127.0.0.1:{free_port(socket.SOCK_STREAM)}"


@contextmanager
def simulated_autopilot(port: int) -> Iterator[None]:
    command = [sys.executable, "-m", "service.simulator.simulated_autopilot", "--scenario", "demo"]
    command += ["--connect", f"127.0.0.1:{port}", "--start-monotonic-ns", str(time.monotonic_ns())]
    with subprocess.Popen(command) as process:
        try:
            yield
        finally:
            process.terminate()


def sent_anew(data: bytes, number: int) -> bytes:
    """The same message with the next sequence number and a later time; what is no MAVLink stays as it is."""
    if data[:1] != b"\xfd":
        return data
    for message in mavlink.MAVLink(None).parse_buffer(data) or ():
        if message.get_type() == "BAD_DATA":
            return data
        if getattr(message, "time_boot_ms", 0):
            message.time_boot_ms += 100 * number
        encoder = mavlink.MAVLink(None, message.get_srcSystem(), message.get_srcComponent())
        encoder.seq = number % 256
        return bytes(message.pack(encoder))
    return data


@contextmanager
def sending(port: int, *datagrams: bytes) -> Iterator[None]:
    """Sends the datagrams ten times a second from a thread, each time anew where they are MAVLink."""
    ended = threading.Event()

    def send() -> None:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
            for number in itertools.count():
                if ended.wait(0.1):
                    return
                for data in datagrams:
                    sock.sendto(sent_anew(data, number), ("127.0.0.1", port))

    thread = threading.Thread(target=send)
    thread.start()
    try:
        yield
    finally:
        ended.set()
        thread.join()


@contextmanager
def router(endpoint: str) -> Iterator[None]:
    config = zenoh.Config()
    for key, value in {
        "mode": '"router"',
        "listen/endpoints": f'["{endpoint}"]',
        "scouting/multicast/enabled": "false",
        "scouting/gossip/enabled": "false",
    }.items():
        config.insert_json5(key, value)
    with zenoh.open(config):
        yield


def landscape(number: int) -> np.ndarray:
    """Fine texture under a plain sky, another in each frame."""
    image = np.full((HEIGHT, WIDTH, 3), 180, np.uint8)
    image[HEIGHT // 2 :] = np.random.default_rng(number).integers(40, 140, (HEIGHT // 2, WIDTH, 3))
    return image


def camera_of(folder: Path, images: list[np.ndarray]) -> CameraConfig:
    folder.mkdir(exist_ok=True)
    for number, image in enumerate(images):
        cv2.imwrite(str(folder / f"{number:03d}.png"), image)
    source = SourceConfig(kind="folder", path=str(folder))
    return CameraConfig(width=WIDTH, height=HEIGHT, hfov_deg=60.0, source=source)


def linked(*links: LinkConfig, target_system: int = 0) -> Config:
    return Config(mavlink=MavlinkConfig(links=links, target_system=target_system), zenoh=ZenohConfig(enabled=False))


def lines(findings: list[Finding]) -> str:
    return "\n".join(map(str, findings))


def packed(message: mavlink.MAVLink_message, component: int = 1) -> bytes:
    return bytes(message.pack(mavlink.MAVLink(None, 1, component)))


def heartbeat(autopilot: int = mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA) -> mavlink.MAVLink_message:
    return mavlink.MAVLink_heartbeat_message(mavlink.MAV_TYPE_QUADROTOR, autopilot, 0, 0, 4, 3)


def test_all_is_well(tmp_path: Path, udp_port: int, endpoint: str) -> None:
    camera_of(tmp_path / "frames", [landscape(number) for number in range(8)])
    (tmp_path / "config.toml").write_text(
        f"""
        [[mavlink.links]]
        url = "udpin:127.0.0.1:{udp_port}"
        [camera]
        width = {WIDTH}
        height = {HEIGHT}
        hfov_deg = 60.0
        source = {{kind = "folder", path = "{tmp_path}/frames"}}
        [zenoh]
        connect = ["{endpoint}"]
        listen = ["tcp/127.0.0.1:{free_port(socket.SOCK_STREAM)}"]
        """
    )
    command = [sys.executable, "-m", "service", "check", "--config", str(tmp_path / "config.toml"), "--seconds", "12"]
    with simulated_autopilot(udp_port), router(endpoint):
        done = subprocess.run(command, capture_output=True, text=True, timeout=HANG_S, check=False)
    said = done.stdout.splitlines()
    assert [line for line in said if line.startswith("fail")] == [], done.stdout
    assert done.returncode == 0
    for start in (
        "ok    config: ",
        "ok    segmenter: onnx smoke-seg ",
        f"ok    link: udpin:127.0.0.1:{udp_port}: hears 1/1",
        "ok    clock: TIMESYNC, round trip ",
        "ok    utc: from GPS",
        "ok    view: 60 x 47 degrees, ",
        "ok    pose: the first camera pose after ",
        f"ok    camera: 8 frames of {WIDTH} x {HEIGHT}, sharpness ",
        f"ok    zenoh: connected to {endpoint}",
        "ok    zenoh: can listen on ",
    ):
        assert sum(line.startswith(start) for line in said) == 1, (start, done.stdout)
    (rates,) = [line for line in said if " rates: " in line]
    assert "attitude " in rates and " of 50 asked for" in rates
    assert sum(" disk: " in line for line in said) == 1


def test_nothing_is_there(tmp_path: Path, udp_port: int, endpoint: str) -> None:
    config = Config(
        mavlink=MavlinkConfig(links=(LinkConfig(url=f"udpin:127.0.0.1:{udp_port}"),)),
        camera=CameraConfig(source=SourceConfig(kind="folder", path=str(tmp_path / "none"))),
        segmenter=SegmenterConfig(kind="onnx", model=str(tmp_path / "none.onnx")),
        zenoh=ZenohConfig(connect=(endpoint,)),
    )
    said: list[str] = []
    assert asyncio.run(run_check(config, said.append, 1.0)) is False
    failures = [line.split(":")[0] for line in said if line.startswith("fail")]
    assert failures == ["fail  segmenter", "fail  link", "fail  camera", "fail  zenoh"]
    assert all("; " in line for line in said if not line.startswith("ok")), said


def test_the_exit_code_tells(tmp_path: Path) -> None:
    config = tmp_path / "config.toml"
    config.write_text(f'[camera.source]\nkind = "folder"\npath = "{tmp_path}/none"\n')
    command = [sys.executable, "-m", "service", "check", "--config", str(config), "--seconds", "1"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=HANG_S, check=False)
    assert done.returncode == 1
    assert done.stderr == ""
    assert f"fail  camera: camera.source.path is {tmp_path}/none: no such folder; " in done.stdout


def test_a_host_clock_that_is_wrong(udp_port: int, monkeypatch: pytest.MonkeyPatch) -> None:
    true_s = time.time
    with simulated_autopilot(udp_port):
        monkeypatch.setattr(time, "time", lambda: true_s() - 3600.0)
        findings = asyncio.run(check_links(linked(LinkConfig(url=f"udpin:127.0.0.1:{udp_port}")), 6.0))
    assert "warn  utc: the host's clock is -3600 s off the autopilot's; set it: timedatectl" in lines(findings)


HEARTBEAT = packed(heartbeat())
ATTITUDE = packed(mavlink.MAVLink_attitude_message(1000, 0, 0, 0, 0, 0, 0))


@pytest.mark.parametrize(
    ("datagrams", "target", "expected"),
    [
        ((), 0, ["fail  link: ", "nothing heard in 3 s (open); check the wiring"]),
        ((b"\x55\xaa" * 40,), 0, ["bytes but no MAVLink; correct the baud rate"]),
        ((packed(heartbeat(8), component=190),), 0, ["no autopilot's heartbeat, only 1/190; let the router"]),
        ((HEARTBEAT,), 7, ["fail  autopilot: its heartbeat was not heard; mavlink.target_system is 7: correct it"]),
        (
            (HEARTBEAT,),
            0,
            [
                "ok    link: ",
                "fail  rates: attitude 0 a second of 50 asked for, position 0 of 20; the autopilot must",
                "warn  clock: no TIMESYNC replies: poses are timed by arrival; let the link pass",
                "warn  utc: the autopilot has no UTC: the host's clock dates the reports; wait for GPS time",
                "fail  pose: no camera pose in 3 s: no_clock; the autopilot must send",
            ],
        ),
        (
            (
                HEARTBEAT,
                packed(mavlink.MAVLink_gps_raw_int_message(0, 1, 0, 0, 0, 0, 0, 0, 0, 0)),
                packed(mavlink.MAVLink_global_position_int_message(1000, 0, 0, 0, 0, 0, 0, 0, 0)),
                ATTITUDE,
            ),
            0,
            ["warn  rates: attitude ", "fail  pose: no camera pose in 3 s: no_fix; wait for a GPS fix"],
        ),
    ],
)
def test_what_comes_over_the_link(
    udp_port: int, datagrams: tuple[bytes, ...], target: int, expected: list[str]
) -> None:
    config = linked(LinkConfig(url=f"udpin:127.0.0.1:{udp_port}"), target_system=target)
    with sending(udp_port, *datagrams):
        said = lines(asyncio.run(check_links(config, 3.0)))
    for text in expected:
        assert text in said, said


def test_two_gimbals_and_a_zoomed_camera(udp_port: int) -> None:
    link = LinkConfig(url=f"udpin:127.0.0.1:{udp_port}")
    camera = CameraConfig(mount=MountConfig(gimbal=True))
    config = Config(mavlink=MavlinkConfig(links=(link,)), camera=camera, zenoh=ZenohConfig(enabled=False))
    gimbal = mavlink.MAVLink_gimbal_device_attitude_status_message(0, 0, 1000, 32, [1.0, 0, 0, 0], 0, 0, 0, 0)
    settings = packed(mavlink.MAVLink_camera_settings_message(0, 0, 40.0, 0.0), 101)
    with sending(udp_port, HEARTBEAT, ATTITUDE, packed(gimbal, 154), packed(gimbal, 171), settings):
        said = lines(asyncio.run(check_links(config, 2.0)))
    assert "fail  gimbal: gimbals 154, 171 are heard: camera.mount.gimbal_device must be one of them; set" in said
    assert "camera.mount.gimbal_device to the camera's: 154 or 171" in said
    assert "fail  zoom: camera 101: zoom level 40 %, calibrated at 0 % (camera.zoom_level); zoom back" in said
    assert "fail  pose: no camera pose in 2 s: zoomed; zoom back" in said


def test_ground_control_whose_commands_would_be_refused_is_told(udp_port: int) -> None:
    config = linked(LinkConfig(url=f"udpin:127.0.0.1:{udp_port}", faces="ground"))
    encoders = (mavlink.MAVLink(None, 245, 190), mavlink.MAVLink(None, 255, 190))
    beats = [bytes(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3).pack(one)) for one in encoders]
    with sending(udp_port, *beats):
        said = lines(asyncio.run(check_links(config, 1.0)))
    (told,) = [one for one in said.splitlines() if "commands" in one]
    assert told.startswith(f"warn  commands: udpin:127.0.0.1:{udp_port}: commands of ground control 245 are refused; ")
    assert "mavlink.command_systems is [255]: add 245" in told


def test_links_that_nobody_faces(udp_port: int) -> None:
    config = linked(LinkConfig(url=f"udpin:127.0.0.1:{udp_port}", faces="ground"))
    said = lines(asyncio.run(check_links(config, 1.0)))
    assert f"warn  link: udpin:127.0.0.1:{udp_port}: nothing heard in 1 s; start the ground's side" in said
    assert "fail  autopilot: no link faces one; give one of mavlink.links faces = 'autopilot'" in said
    assert str(asyncio.run(check_links(linked(), 1.0))[0]).startswith("warn  link: mavlink.links is empty")


def test_a_port_that_the_service_holds() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(("127.0.0.1", 0))
        config = linked(LinkConfig(url=f"udpin:127.0.0.1:{taken.getsockname()[1]}"))
        said = lines(asyncio.run(check_links(config, 1.0)))
    assert "port in use by another program; if distloc runs already, systemctl stop distloc first" in said


SKY = np.full((HEIGHT, WIDTH, 3), 180, np.uint8)


@pytest.mark.parametrize(
    ("images", "expected"),
    [
        ([], "gives no frame in"),
        ([cv2.GaussianBlur(landscape(0), (0, 0), 8)], "warn  camera: blurred, or no detail in view: sharpness "),
        ([landscape(0) // 32], "warn  camera: dark: mean level "),
        ([np.full((HEIGHT, WIDTH, 3), 255, np.uint8)], "warn  camera: overexposed: mean level 255"),
        ([landscape(0)] * 5, "all the same picture; start the camera again"),
        ([landscape(0)[:, :500]], "camera.width, camera.height are 640 x 480: the source gives 500 x 480"),
        ([landscape(number) for number in range(3)], "ok    camera: 3 frames of 640 x 480, sharpness "),
    ],
)
def test_what_the_camera_gives(tmp_path: Path, images: list[np.ndarray], expected: str) -> None:
    findings = check_camera(camera_of(tmp_path / "frames", images), 5.0)
    assert expected in lines(findings)
    assert all(finding.mend for finding in findings if finding.level != "ok")


def test_a_camera_that_is_not_there() -> None:
    source = SourceConfig(kind="v4l2", path="/dev/video99")
    assert "fail  camera: camera.source.path is /dev/video99: no such device; " in lines(
        check_camera(CameraConfig(source=source), 5.0)
    )
    assert lines(check_camera(CameraConfig(), 5.0)).startswith("warn  camera: camera.source.kind is 'none'")


class LiveCamera:
    """Ten frames a second, `most` of them; then it hangs, or ends, as a live camera never should."""

    def __init__(self, most: int, ends: bool) -> None:
        self._most, self._ends = most, ends
        self._closed = threading.Event()

    def read(self) -> Frame | None:
        if self._most == 0 and not self._ends:
            self._closed.wait(30.0)
        if self._most == 0 or self._closed.wait(0.1):
            return None
        self._most -= 1
        return Frame(time.monotonic_ns(), "", landscape(self._most))

    def __enter__(self) -> "LiveCamera":
        return self

    def __exit__(self, *_: object) -> None:
        self._closed.set()


@pytest.mark.parametrize(
    ("most", "ends", "fps", "expected"),
    [
        (1000, False, 5.0, "ok    camera: "),
        (1000, False, 30.0, "frames a second; lower camera.source.fps from 30"),
        (0, False, 5.0, "fail  camera: /dev/video0 gives no frame in 2 s; check the cable"),
        (5, True, 5.0, "fail  camera: 5 frames of 640 x 480, the last "),
    ],
)
def test_a_live_camera(monkeypatch: pytest.MonkeyPatch, most: int, ends: bool, fps: float, expected: str) -> None:
    monkeypatch.setattr("service.commands.check.camera.open_source", lambda *_: LiveCamera(most, ends))
    source = SourceConfig(kind="v4l2", path="/dev/video0", fps=fps)
    assert expected in lines(check_camera(CameraConfig(width=WIDTH, height=HEIGHT, hfov_deg=60.0, source=source), 2.0))


@pytest.mark.parametrize(
    ("verbs", "listen_s", "expected"),
    [
        (("picture 1000 0.05",), 8.0, "ok    camera: "),
        (("say no sensor", "exit 1"), 60.0, 'status 1 after 0 frames; its last words: "no sensor"; correct camera'),
        (("sleep",), 1.0, "gives no frame in 1 s; run the command by hand, with | wc -c behind it"),
    ],
)
def test_a_command_as_the_camera(verbs: tuple[str, ...], listen_s: float, expected: str) -> None:
    source = SourceConfig(kind="command", command=writer(*verbs), format="bgr", fps=1.0)
    config = CameraConfig(width=64, height=48, hfov_deg=60.0, source=source)
    assert expected in lines(check_camera(config, listen_s))


def test_a_command_that_is_missing() -> None:
    config = CameraConfig(source=SourceConfig(kind="command", command=("no-such-program",)))
    assert "fail  camera: camera.source.command[0] is 'no-such-program': no such program" in lines(
        check_camera(config, 5.0)
    )


@pytest.mark.parametrize("mode", ["peer", "client"])
def test_zenoh_is_reached_or_not(endpoint: str, mode: str) -> None:
    config = msgspec.convert({"mode": mode, "connect": [endpoint]}, ZenohConfig)
    with router(endpoint):
        assert lines(check_zenoh(config, 10.0)) == f"ok    zenoh: connected to {endpoint}"
    (finding,) = check_zenoh(config, 1.0)
    assert finding.level == "fail"
    assert endpoint in finding.said and finding.mend.startswith("start what listens there")


def test_zenoh_hears_a_peer_as_well_as_a_router(endpoint: str) -> None:
    peer = zenoh.Config()
    peer.insert_json5("listen/endpoints", f'["{endpoint}"]')
    peer.insert_json5("scouting/multicast/enabled", "false")
    with zenoh.open(peer):
        assert lines(check_zenoh(ZenohConfig(connect=(endpoint,)), 10.0)) == f"ok    zenoh: connected to {endpoint}"


def test_zenoh_that_cannot_listen_or_is_told_nothing(endpoint: str) -> None:
    with router(endpoint):
        (finding,) = check_zenoh(ZenohConfig(listen=(endpoint,)), 1.0)
    assert finding.level == "fail" and "systemctl stop distloc" in finding.mend
    assert check_zenoh(ZenohConfig(), 1.0)[0].level == "warn"
    assert check_zenoh(ZenohConfig(enabled=False), 1.0)[0].level == "ok"
    (finding,) = check_zenoh(ZenohConfig(connect=(endpoint,), ca_certificate="/none.pem"), 1.0)
    assert (
        str(finding)
        == "fail  zenoh: zenoh.ca_certificate is '/none.pem': there is no such file that can be read; correct that key"
    )


def test_the_classical_segmenter_is_warned_of() -> None:
    config = Config(segmenter=SegmenterConfig(kind="classical"), zenoh=ZenohConfig(enabled=False))
    said: list[str] = []
    assert asyncio.run(run_check(config, said.append, 0.1)) is True
    (line,) = [one for one in said if " segmenter: " in one]
    assert line.startswith("warn  segmenter: classical, which needs no model and finds ")
    assert "leave segmenter.kind out" in line


def test_a_disk_that_fills(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    config = Config(recorder=RecorderConfig(folder=str(tmp_path / "not" / "yet")), zenoh=ZenohConfig(enabled=False))
    for free, start in ((1e11, "ok  "), (1e9, "warn"), (1e8, "fail")):
        usage = type("Usage", (), {"free": free})
        monkeypatch.setattr("service.commands.check.doctor.shutil.disk_usage", lambda folder, usage=usage: usage)
        said: list[str] = []
        assert asyncio.run(run_check(config, said.append, 1.0)) is (start != "fail")
        (line,) = [one for one in said if " disk: " in one]
        assert line.startswith(f"{start}  disk: {free * 1e-9:.1f} GB free in {tmp_path}")


def test_where_targets_are_kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("STATE_DIRECTORY", raising=False)
    (tmp_path / "file").write_text("")

    def said(state: StateConfig) -> str:
        lines: list[str] = []
        asyncio.run(run_check(Config(state=state, zenoh=ZenohConfig(enabled=False)), lines.append, 0.1))
        (line,) = [one for one in lines if " state: " in one]
        return line

    assert said(StateConfig()).startswith("ok    state: off without systemd")
    assert said(StateConfig(dir="")).startswith("ok    state: off: after a crash")
    assert said(StateConfig(dir=str(tmp_path / "new"))) == f"ok    state: targets are kept in {tmp_path / 'new'}"
    monkeypatch.setenv("STATE_DIRECTORY", str(tmp_path / "file" / "in"))
    assert said(StateConfig()) == (
        f"warn  state: {tmp_path / 'file'} cannot be written; "
        "give it to the service's user, or state.dir another folder"
    )
