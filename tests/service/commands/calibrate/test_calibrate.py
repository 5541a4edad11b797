"""`distloc calibrate` by its command line: a real autopilot's software, a rendered flight, what is refused."""

import csv
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import cv2
import msgspec
import numpy as np
import pytest

from distloc.backports import tomllib
from distloc.calibration.image_turns import TurnMeter
from distloc.geometry.camera import Camera
from distloc.geometry.rotations import R_cam_from_enu, matrix_from_euler, matrix_from_rotation_vector
from distloc.simulation.paths import FlightPath, straight
from distloc.simulation.renderer import Renderer
from distloc.types import CameraPose
from service.config.sections import Config
from service.recordings.recording import Recording
from service.simulator.scenario import CameraConfig, ErrorSection, MountConfig, Scenario, load_scenario
from service.simulator.simulate import simulate
from tests.support.places import HANG_S, SITL

TRUE_MOUNT = MountConfig(yaw_deg=-75.0, pitch_deg=-5.0)
LATE_US = 80_000
LINE = re.compile(r"^(yaw|pitch|roll)_deg = (\S+) +# was (\S+): (\S+), sigma ([0-9.]+)", re.MULTILINE)


class Rocking(Scenario, frozen=True):
    """A flight that rocks by some degrees."""

    @property
    def flight(self) -> FlightPath:
        return straight(np.array([0.0, 0.0, 120.0]), 0.0, 20.0, wobble_rad=0.08, seed=3)


def calibrate(
    folder: Path, place: tuple[float, float, float] | None, *options: str
) -> subprocess.CompletedProcess[str]:
    """The command as a user runs it."""
    landmark = ["--landmark", *map(str, place)] if place else []
    command = [sys.executable, "-m", "service", "calibrate", str(folder), *landmark, *options]
    # a wide terminal, or the usage error's box breaks the line
    return subprocess.run(
        command, capture_output=True, text=True, check=False, timeout=HANG_S, env={**os.environ, "COLUMNS": "300"}
    )


def place_of(folder: Path) -> tuple[float, float, float]:
    truth = Recording(folder).truth
    assert truth is not None
    centre = truth.targets[0].centre
    return centre.lat, centre.lon, centre.alt_msl_m


def found(text: str) -> dict[str, tuple[float, float]]:
    """Each angle and its sigma, as printed; the whole text must be TOML that the config takes."""
    msgspec.convert(tomllib.loads(text), Config)
    angles = {name: (float(value), float(sigma)) for name, value, _, _, sigma in LINE.findall(text)}
    assert list(angles) == ["yaw", "pitch", "roll"]
    return angles


def late_ms(text: str) -> tuple[float, float]:
    late = re.search(r"stamped (\S+) ms late, sigma (\d+) ms", text)
    assert late is not None
    return float(late[1]), float(late[2])


def link(source: Path, copy: Path, late_us: int = 0, names: tuple[str, ...] = ("telemetry.tlog", "masks")) -> Path:
    """A recording of the same bytes whose frames are stamped later."""
    copy.mkdir()
    for name in names:
        if (source / name).is_dir():
            shutil.copytree(source / name, copy / name, copy_function=os.link)
        else:
            os.link(source / name, copy / name)
    shutil.copy(source / "config.toml", copy)
    rows = list(csv.reader((source / "frames.csv").read_text().splitlines()))
    shifted = [rows[0], *([str(int(stamp) + late_us), name] for stamp, name in rows[1:])]
    (copy / "frames.csv").write_text("".join(",".join(row) + "\n" for row in shifted))
    return copy


@pytest.fixture(scope="module")
def rendered(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """18 s that rock, past a plume, with masks and frames; the believed mount is wrong by 2, -1.5 and 1 deg."""
    folder = tmp_path_factory.mktemp("calibrate") / "flight"
    camera = CameraConfig(width=640, height=360, fx=450.0, fy=450.0, cx=319.5, cy=179.5, mount=TRUE_MOUNT)
    errors = ErrorSection(heading_bias_deg=0.5, tilt_bias_deg=0.2, attitude_white_deg=0.02, position_sigma_m=1.0)
    straight_on = load_scenario("straight")
    scenario = Rocking(targets=straight_on.targets, camera=camera, errors=errors, fps=4.0, duration_s=18.0)
    simulate(folder, scenario, 5, lambda share: None)
    text = (folder / "config.toml").read_text()
    for key, old, new in (("yaw", "-75.0", "-77.0"), ("pitch", "-5.0", "-3.5"), ("roll", "0.0", "-1.0")):
        assert f"{key}_deg = {old}" in text
        text = text.replace(f"{key}_deg = {old}", f"{key}_deg = {new}")
    assert 'kind = "onnx"' in text
    (folder / "config.toml").write_text(text.replace('kind = "onnx"', 'kind = "recorded"'))
    return folder


def near_truth(text: str) -> None:
    angles = found(text)
    for (value, sigma), truth in zip(angles.values(), (-75.0, -5.0, 0.0), strict=True):
        assert abs(value - truth) < 2.5 * sigma
    assert all(0.05 < sigma < 1.5 for _, sigma in list(angles.values())[1:])
    assert 0.3 < angles["yaw"][1] < 2.1


def test_a_rendered_flight(rendered: Path) -> None:
    done = calibrate(rendered, place_of(rendered), "--time-offset")
    assert (done.returncode, done.stderr) == (0, "")
    near_truth(done.stdout)
    late, sigma = late_ms(done.stdout)
    assert abs(late) < 3.0 * sigma + 1.0 and sigma <= 15.0
    assert "by the motion of the landmark's segment" in done.stdout


def test_late_frames_are_found_and_do_not_turn_the_mount(rendered: Path, tmp_path: Path) -> None:
    late_masks = link(rendered, tmp_path / "masks", LATE_US)
    done = calibrate(late_masks, place_of(rendered), "--time-offset")
    late, sigma = late_ms(done.stdout)
    assert abs(late - 80.0) < 3.0 * sigma + 1.0 and sigma <= 10.0
    assert "by the motion of the landmark's segment" in done.stdout
    near_truth(done.stdout)
    assert tomllib.loads(done.stdout)["camera"]["source"]["latency_ms"] == pytest.approx(late, abs=1.0)
    unasked = calibrate(late_masks, place_of(rendered))
    near_truth(unasked.stdout)
    assert "late; see --time-offset" in unasked.stdout and "latency_ms" not in unasked.stdout


def test_where_the_landmark_is_seen_too_seldom_the_frames_tell(rendered: Path, tmp_path: Path) -> None:
    late_frames = link(rendered, tmp_path / "frames", LATE_US, ("telemetry.tlog", "frames"))
    (late_frames / "masks").mkdir()
    for mask in sorted((rendered / "masks").iterdir())[8:33]:
        shutil.copy(mask, late_frames / "masks")
    done = calibrate(late_frames, place_of(rendered), "--time-offset")
    late, sigma = late_ms(done.stdout)
    assert abs(late - 80.0) < 3.0 * sigma + 3.0 and sigma <= 10.0  # and a few ms of the flight over the ground
    assert "by the motion of the frames" in done.stdout
    known = found(done.stdout)
    near_truth(done.stdout)
    shutil.rmtree(late_frames / "frames")
    done = calibrate(late_frames, place_of(rendered), "--time-offset")
    assert done.returncode == 0
    assert "the time offset cannot be estimated by the motion of the landmark's segment" in done.stdout
    assert "at least 30 frames" in done.stdout and "latency_ms" not in done.stdout
    unknown = found(done.stdout)  # 80 ms late and nobody knows: the sigmas hold it
    for name, truth in (("yaw", -75.0), ("pitch", -5.0), ("roll", 0.0)):
        assert abs(unknown[name][0] - truth) < 2.5 * unknown[name][1]
        assert unknown[name][1] >= known[name][1]
    assert any(unknown[name][1] > 1.2 * known[name][1] for name in unknown)


def test_config_and_segmenter_of_ones_own(rendered: Path, tmp_path: Path) -> None:
    text = (rendered / "config.toml").read_text()
    (tmp_path / "own.toml").write_text(text.replace("yaw_deg = -77.0", "yaw_deg = -74.0").replace("recorded", "sobel"))
    options = ("--config", str(tmp_path / "own.toml"))
    done = calibrate(rendered, place_of(rendered), *options, "--segmenter", "recorded")
    near_truth(done.stdout)
    assert "# was -74:" in done.stdout
    none = calibrate(rendered, place_of(rendered), *options)
    assert none.returncode == 1
    assert "segmenter 'sobel'" in none.stderr or "sights" in none.stderr


@pytest.mark.skipif(not SITL.is_dir(), reason="no shared data")
@pytest.mark.parametrize(
    ("name", "truth"), [("copter_misaligned", (-73.5, -4.5, -0.4)), ("copter_nominal", (-75.0, -5.0, 0.0))]
)
def test_a_real_autopilots_software(name: str, truth: tuple[float, float, float]) -> None:
    done = calibrate(SITL / name, place_of(SITL / name), "--time-offset")
    assert (done.returncode, done.stderr) == (0, "")
    for (value, sigma), angle in zip(found(done.stdout).values(), truth, strict=True):
        assert abs(value - angle) < 0.35
        assert abs(value - angle) < 2.0 * sigma and 0.2 < sigma < 1.1
    late, sigma = late_ms(done.stdout)
    assert abs(late) <= 2.5 * sigma and sigma <= 5.0


def fails(done: subprocess.CompletedProcess[str], code: int, *parts: str) -> None:
    assert done.returncode == code
    assert done.stdout == ""
    (line,) = done.stderr.splitlines()
    assert line.startswith("distloc: ") and all(part in line for part in parts), line


def test_a_landmark_that_is_not_seen(rendered: Path) -> None:
    lat, lon, alt = place_of(rendered)
    fails(calibrate(rendered, (lat, lon + 0.08, alt)), 1, "never in view", "deg off the camera's axis")  # behind
    fails(calibrate(rendered, (lon, lat, alt)), 1, "km off", "LAT LON ALT")  # swapped
    fails(calibrate(rendered, (lat + 0.0025, lon, alt + 350.0)), 1, "no whole segment within 10 deg", "'recorded'")


def test_what_a_recording_may_lack(rendered: Path, tmp_path: Path) -> None:
    place = place_of(rendered)
    fails(calibrate(tmp_path / "nowhere", place), 1, "no such file")
    masks = link(rendered, tmp_path / "no_masks", names=("telemetry.tlog",))
    fails(calibrate(masks, place), 78, "segmenter.kind", "no such folder")
    fails(calibrate(masks, place, "--segmenter", "classical"), 1, "bad_frame")
    few = link(rendered, tmp_path / "few")
    rows = (few / "frames.csv").read_text().splitlines()
    (few / "frames.csv").write_text("\n".join(rows[:12] + rows[-3:]) + "\n")
    fails(calibrate(few, place), 1, "at least 20 sights are needed")
    (few / "frames.csv").unlink()
    fails(calibrate(few, place), 1, "frames.csv with at least one frame is missing")
    deaf = link(rendered, tmp_path / "deaf", names=("masks",))
    (deaf / "telemetry.tlog").write_bytes((rendered / "telemetry.tlog").read_bytes()[:2000])
    fails(calibrate(deaf, place), 1, "has a pose")


@pytest.mark.parametrize("place", [(float("nan"), 8.0, 400.0), (91.0, 8.0, 400.0), (47.0, 8.0, float("inf"))])
def test_a_place_that_is_none(rendered: Path, place: tuple[float, float, float]) -> None:
    done = calibrate(rendered, place)
    assert done.returncode == 2
    assert "is no place: LAT is -90 to 90" in done.stderr and "Traceback" not in done.stderr
    unknown = calibrate(rendered, None, "--time-offset")
    assert unknown.returncode == 2 and "--time-offset needs a --landmark" in unknown.stderr


def test_turn_of_a_picture() -> None:
    camera = Camera(640, 360, 450.0, 450.0, 319.5, 179.5)
    rng = np.random.default_rng(0)
    picture = cv2.resize(rng.integers(0, 255, (90, 160, 3), dtype=np.uint8), (640, 360), interpolation=cv2.INTER_CUBIC)
    turn = np.array([0.01, -0.02, 0.03])
    R = matrix_from_rotation_vector(turn)
    warp = camera.matrix @ R @ np.linalg.inv(camera.matrix)
    turned = np.asarray(cv2.warpPerspective(picture, warp, (640, 360)), dtype=np.uint8)
    meter, pose = TurnMeter(camera), CameraPose(0.0, np.zeros(3), np.eye(3))
    assert meter.turn(np.asarray(picture, dtype=np.uint8), pose, None) is None
    found_R = meter.turn(turned, pose, None)
    assert found_R is not None
    assert np.degrees(np.linalg.norm(found_R - R)) < 0.05
    assert meter.turn(np.zeros((360, 640, 3), dtype=np.uint8), pose, None) is None  # nothing to follow
    meter.forget()
    assert meter.turn(turned, pose, None) is None


def test_turn_over_flat_ground_is_not_the_flights() -> None:
    camera = CameraConfig(width=640, height=360, fx=450.0, fy=450.0, cx=319.5, cy=179.5).camera()
    renderer = Renderer(camera, (), np.random.default_rng(0))
    down = R_cam_from_enu(matrix_from_euler(0.0, -0.3, 0.0), np.eye(3))
    turn = np.array([0.005, -0.01, 0.01])
    poses = [
        CameraPose(0.0, np.array([0.0, 0.0, 120.0]), down),
        CameraPose(0.2, np.array([5.0, 2.0, 121.0]), matrix_from_rotation_vector(turn) @ down),
    ]
    off_deg = {}
    for ground_up_m in (0.0, None):
        meter = TurnMeter(camera)
        _, R = (meter.turn(renderer.render(pose)[0], pose, ground_up_m) for pose in poses)
        assert R is not None
        off_deg[ground_up_m] = np.degrees(np.linalg.norm(R - matrix_from_rotation_vector(turn)))
    assert off_deg[0.0] < 0.1
    assert off_deg[None] > 0.3
