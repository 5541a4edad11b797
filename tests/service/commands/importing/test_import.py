"""`distloc import` from sources to a recording that the other commands take, and what it says of poor sources."""

import os
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from distloc.simulation.paths import FlightPath, straight
from service.autopilot.timesync import Timesync
from service.mavlink.framer import Framer, decode
from service.recordings.recording import Recording
from service.recordings.tlog import TlogReader
from service.simulator.scenario import CameraConfig, ErrorSection, MountConfig, Scenario, load_scenario
from service.simulator.simulate import simulate
from tests.support.dataflash import write_dataflash
from tests.support.flown import Flown, imported, write_pictures
from tests.support.places import HANG_S

FPS, START_S = 10.0, 1_780_000_000.0  # the simulator's epoch
OPTIONS = ("--mount", -75, -5, 0, "--hfov", 70.84)


class Rocking(Scenario, frozen=True):
    """A flight that rocks by degrees."""

    @property
    def flight(self) -> FlightPath:
        return straight(np.array([0.0, 0.0, 120.0]), 0.0, 12.0, wobble_rad=0.06, seed=3)


@pytest.fixture(scope="module")
def sources(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A simulated flight as others would have it: a table of poses in UTC, and a film that knows no time."""
    folder = tmp_path_factory.mktemp("sources")
    camera = CameraConfig(
        width=640, height=360, fx=450.0, fy=450.0, cx=319.5, cy=179.5, mount=MountConfig(yaw_deg=-75.0, pitch_deg=-5.0)
    )
    errors = ErrorSection(heading_bias_deg=0.5, tilt_bias_deg=0.2, attitude_white_deg=0.02, position_sigma_m=1.0)
    targets = load_scenario("straight").targets
    scenario = Rocking(targets=targets, camera=camera, errors=errors, fps=FPS, duration_s=30.0)
    simulate(folder / "flight", scenario, 5, lambda share: None)
    write_table(folder / "poses.csv", folder / "flight" / "telemetry.tlog")
    recording = Recording(folder / "flight")
    film = cv2.VideoWriter(str(folder / "film.mp4"), cv2.VideoWriter.fourcc(*"mp4v"), FPS, (640, 360))
    for _, name in recording.frames():
        image = recording.load_image(name)
        assert image is not None
        film.write(image)
    film.release()
    return folder


def messages_of(tlog: Path, *kinds: str) -> Iterator[object]:
    return (message for _, component, message in stamped(tlog, *kinds) if component == 1)


def stamped(tlog: Path, *kinds: str) -> Iterator[tuple[int, int, Any]]:
    """Stamp in ns, component, message."""
    framer = Framer()
    for stamp_us, raw in TlogReader(tlog):
        for frame in framer.feed(raw):
            message = decode(frame)
            if message is not None and message.get_type() in kinds:
                yield stamp_us * 1000, frame.component, message


def clock_of(tlog: Path) -> Timesync:
    """What a replay makes of the recording's clock."""
    sync = Timesync()
    for stamp_ns, _, word in stamped(tlog, "TIMESYNC"):
        if word.tc1:
            assert sync.reply(word.ts1, word.tc1, stamp_ns)
        else:
            sync.request_sent(word.ts1, stamp_ns)
    return sync


def write_table(path: Path, tlog: Path) -> None:
    """The log's poses, 20 a second, on the clock of the log (boot is 90 s before it)."""
    attitudes = np.array(
        [(m.time_boot_ms, m.yaw, m.pitch, m.roll) for m in messages_of(tlog, "ATTITUDE")]  # type: ignore[attr-defined]
    )
    angles_deg = np.degrees(np.unwrap(attitudes[:, 1:], axis=0))
    lines = ["time,lat,lon,alt_msl_m,craft_yaw_deg,craft_pitch_deg,craft_roll_deg"]
    for m in messages_of(tlog, "GLOBAL_POSITION_INT"):
        at_ms = m.time_boot_ms  # type: ignore[attr-defined]
        yaw, pitch, roll = (np.interp(at_ms, attitudes[:, 0], one) for one in angles_deg.T)
        time_s = START_S + at_ms * 1e-3 - 90.0
        place = f"{m.lat * 1e-7:.7f},{m.lon * 1e-7:.7f},{m.alt * 1e-3:.3f}"  # type: ignore[attr-defined]
        lines.append(f"{time_s:.3f},{place},{yaw:.4f},{pitch:.4f},{roll:.4f}")
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def test_a_film_that_knows_no_time_is_tied_and_flown(sources: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    code, said = imported(sources / "poses.csv", sources / "film.mp4", "--out", out, *OPTIONS)
    assert code == 0, said
    tie = re.search(r"first frame ([+-][0-9.]+) s after the first pose, sigma (\d+) ms, by the turning in (\d+)", said)
    assert tie is not None, said
    sigma_s = float(tie[2]) * 1e-3
    assert 0.0 < sigma_s <= 0.02 and int(tie[3]) >= 50
    first_us = int((out / "frames.csv").read_text().split()[1].split(",")[0])
    late_s = first_us * 1e-6 - START_S  # the simulator's first frame is at its start
    assert 0.0 < abs(late_s) < 4.0 * max(sigma_s, 0.001)
    assert said.strip().endswith(f"next: distloc replay {out}")
    clock = clock_of(out / "telemetry.tlog")
    assert clock.spread_s == pytest.approx(sigma_s, abs=6e-4) and clock.spread_s >= 0.005  # the tie's
    stamp_ns, _, pose = next(stamped(out / "telemetry.tlog", "ATTITUDE_QUATERNION"))
    assert clock.offset_ns() == stamp_ns - pose.time_boot_ms * 1_000_000  # it shifts nothing
    for command in (["replay", str(out), "--out", str(tmp_path / "replayed")], ["calibrate", str(out)]):
        done = subprocess.run(
            [sys.executable, "-m", "service", *command], capture_output=True, text=True, check=False, timeout=HANG_S
        )
        assert done.returncode == 0, done.stderr
        if command[0] == "replay":
            used = re.search(r"(\d+) of 300 frames used", done.stdout)
            assert used is not None and int(used[1]) >= 250
        else:
            angles = re.findall(r"^(?:yaw|pitch|roll)_deg = (\S+) .*sigma ([0-9.]+)", done.stdout, re.MULTILINE)
            for (angle, sigma), truth in zip(angles, (-75.0, -5.0, 0.0), strict=True):
                assert abs(float(angle) - truth) < 3.0 * float(sigma) < 12.0


def test_an_offset_that_is_given_is_taken_and_the_clock_stays_in_doubt(sources: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    code, said = imported(sources / "poses.csv", sources / "film.mp4", "--out", out, *OPTIONS, "--time-offset", "0.25")
    assert code == 0 and "+0.250 s later, as --time-offset says" in said
    first_pose_s = float((sources / "poses.csv").read_text().split("\n")[1].split(",")[0])
    first_us = int((out / "frames.csv").read_text().split()[1].split(",")[0])
    assert first_us * 1e-6 == pytest.approx(first_pose_s + 0.25, abs=1e-3)
    assert not list(messages_of(out / "telemetry.tlog", "TIMESYNC"))


def test_a_film_that_shows_something_else_is_never_tied(sources: Path, tmp_path: Path) -> None:
    film = tmp_path / "other.mp4"
    writer = cv2.VideoWriter(str(film), cv2.VideoWriter.fourcc(*"mp4v"), FPS, (640, 360))
    large = cv2.GaussianBlur(np.random.default_rng(1).integers(0, 255, (500, 900, 3), dtype=np.uint8), (0, 0), 2)
    for number in range(250):
        u, v = int(100 + 80 * np.sin(number * 0.11)), int(60 + 50 * np.cos(number * 0.17))
        writer.write(np.ascontiguousarray(large[v : v + 360, u : u + 640]))
    writer.release()
    code, said = imported(sources / "poses.csv", film, "--out", tmp_path / "out", *OPTIONS)
    assert code == 1 and "the camera's turning in the frames is not found in the attitudes" in said
    assert "--time-offset SECONDS" in said and not (tmp_path / "out").exists()


def test_a_film_too_short_to_tie_says_what_to_give(sources: Path, tmp_path: Path) -> None:
    film = tmp_path / "short.mp4"
    whole, part = cv2.VideoCapture(str(sources / "film.mp4")), None
    part = cv2.VideoWriter(str(film), cv2.VideoWriter.fourcc(*"mp4v"), FPS, (640, 360))
    for _ in range(40):
        part.write(whole.read()[1])
    part.release()
    whole.release()
    code, said = imported(sources / "poses.csv", film, "--out", tmp_path / "out", *OPTIONS)
    assert (code, "--time-offset SECONDS" in said, said.strip().count("\n")) == (1, True, 0), said


def test_a_film_longer_than_its_log_is_counted(sources: Path, tmp_path: Path) -> None:
    lines = (sources / "poses.csv").read_text().split("\n")
    table = tmp_path / "short.csv"
    table.write_text("\n".join(lines[:1] + lines[150:400]) + "\n")
    code, said = imported(table, sources / "film.mp4", "--out", tmp_path / "out", *OPTIONS)
    assert code == 0, said
    inside = re.search(r"frames: 300, (\d+) of them during the poses", said)
    assert inside is not None and 115 <= int(inside[1]) <= 130
    assert len((tmp_path / "out" / "frames.csv").read_text().split()) == 301


def test_what_is_there_is_never_overwritten(tmp_path: Path) -> None:
    log = write_dataflash(tmp_path / "a.bin", Flown())
    for there in ("folder", "file", "link"):
        out = tmp_path / there
        if there == "folder":
            out.mkdir()
        elif there == "file":
            out.write_text("mine")
        else:
            out.symlink_to(tmp_path / "nowhere")
        code, said = imported(log, "--out", out)
        assert (code, "exists already" in said, said.strip().count("\n")) == (1, True, 0), said
    assert (tmp_path / "file").read_text() == "mine"
    assert sorted(one.name for one in tmp_path.iterdir()) == ["a.bin", "file", "folder", "link"]


def test_pictures_are_linked_in_and_lead_nowhere_else(tmp_path: Path) -> None:
    log, pictures = write_dataflash(tmp_path / "a.bin", Flown()), write_pictures(tmp_path / "p")
    code, said = imported(log, pictures, "--out", tmp_path / "out", "--hfov", 60)
    assert code == 0, said
    for path in (tmp_path / "out" / "frames").iterdir():
        assert not path.is_symlink() and path.stat().st_nlink == 2
    assert Recording(tmp_path / "out").load_image(next((tmp_path / "out" / "frames").iterdir()).name) is not None


def test_a_link_to_pictures_is_followed_into_the_recording(tmp_path: Path) -> None:
    log, pictures = write_dataflash(tmp_path / "a.bin", Flown()), write_pictures(tmp_path / "p")
    for path in list((pictures / "frames").iterdir()):
        path.rename(tmp_path / path.name)
        path.symlink_to(tmp_path / path.name)
    code, said = imported(log, pictures, "--out", tmp_path / "out", "--hfov", 60)
    assert code == 0, said
    assert not any(path.is_symlink() for path in (tmp_path / "out" / "frames").iterdir())


def test_a_lens_that_nobody_tells_is_asked_for(tmp_path: Path) -> None:
    log, pictures = write_dataflash(tmp_path / "a.bin", Flown()), write_pictures(tmp_path / "p")
    code, said = imported(log, pictures, "--out", tmp_path / "out")
    assert code == 1 and "does not tell its lens: give --hfov DEGREES, or --config FILE" in said
    config = tmp_path / "c.toml"
    config.write_text("[camera]\nwidth = 64\nheight = 48\nhfov_deg = 50.0\n\n[camera.mount]\npitch_deg = -9.0\n")
    code, said = imported(log, pictures, "--out", tmp_path / "out", "--config", config)
    assert code == 0, said
    assert (tmp_path / "out" / "config.toml").read_text().startswith(config.read_text())
    config.write_text("[camera]\nwidth = 3\n")
    code, said = imported(log, pictures, "--out", tmp_path / "other", "--config", config)
    assert code == 1 and "camera.width is 3" in said and not (tmp_path / "other").exists()


def test_an_attitude_may_come_from_elsewhere_or_from_the_course(tmp_path: Path) -> None:
    lacking = write_dataflash(tmp_path / "a.bin", Flown(), leave_out=("ATT",))
    whole, pictures = write_dataflash(tmp_path / "b.bin", Flown()), write_pictures(tmp_path / "p")
    code, said = imported(lacking, pictures, "--out", tmp_path / "x", "--hfov", 60, "--attitude", whole)
    assert code == 0, said
    from tests.support.flown import replayed

    assert replayed(tmp_path / "x").attitude_deg < 0.03
    options = ("--by-course", "--mount", 0, -20, 0, "--mount-sigma", 10)
    code, said = imported(lacking, pictures, "--out", tmp_path / "y", "--hfov", 60, *options)
    assert code == 0 and "level, the nose along the course" in said
    config = (tmp_path / "y" / "config.toml").read_text()
    assert "heading_bias_deg = 22.361" in config and "tilt_bias_deg = 11.180" in config


@pytest.mark.parametrize("name", ["x.bin", "x.ulg", "x.tlog", "x.csv", "x.mp4", "x.xyz", "nothing"])
@pytest.mark.parametrize("content", [b"", b"\0" * 3000, b"GIF89a" + bytes(range(256)) * 9])
def test_what_is_none_of_these_is_one_line(tmp_path: Path, name: str, content: bytes) -> None:
    path = tmp_path / name
    if name != "nothing":
        path.write_bytes(content)
    code, said = imported(path, "--out", tmp_path / "out")
    assert (code, str(path) in said, said.strip().count("\n")) == (1, True, 0), said
    assert not (tmp_path / "out").exists()


def test_pipes_and_far_too_large_files_are_refused_unread(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe.bin")
    code, said = imported(tmp_path / "pipe.bin", "--out", tmp_path / "out")
    assert code == 1 and "is no regular file" in said
    for name, head in (("a.bin", b"\xa3\x95\x80"), ("a.ulg", b"ULog\x01\x12\x35\x01")):
        with (tmp_path / name).open("wb") as file:
            file.write(head)
            file.truncate(5_000_000_000)  # holds no block of the disk
        code, said = imported(tmp_path / name, "--out", tmp_path / "out")
        assert code == 1 and "has 5.0 GB, 4 GB are taken: cut it" in said


def test_poses_years_apart_are_no_flight(tmp_path: Path) -> None:
    rows = [f"{stamp},47.1,8.1,500,0,0,0" for stamp in (1.5e9, 1.5e9 + 1, 1.78e9, 1.78e9 + 1)]
    path = tmp_path / "a.csv"
    path.write_text("time,lat,lon,alt_msl_m,craft_yaw_deg,craft_pitch_deg,craft_roll_deg\n" + "\n".join(rows) + "\n")
    code, said = imported(path, "--out", tmp_path / "out")
    assert code == 1 and "a time days from the others'" in said
