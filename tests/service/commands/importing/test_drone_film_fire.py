"""A drone's film of a fire, or its pictures, imported and replayed: the fire is found where it stands."""

import math
from pathlib import Path

import cv2
import msgspec
import numpy as np
import pytest

from distloc.geometry.rotations import R_ENU_FROM_NED, R_FRD_FROM_CAM, euler_from_matrix
from service.commands.importing.run import Wanted, run_import
from service.config.load import load_config
from service.recordings.recording import Recording
from service.recordings.replay import replay
from service.simulator.drawn_scene import DrawnScene
from service.simulator.scenario import Scenario, camera_pose, load_scenario, truth_json
from tests.support.drone_pictures import dji, exif_of, write_picture
from tests.support.srt_lines import DIALECTS, Dialect, Moment, srt_of

HEADING_OFF_DEG, TILT_OFF_DEG = 1.5, 0.3  # of the craft's compass and its gimbal
FPS, SECONDS = 2.0, 60


@pytest.fixture(scope="module")
def scenario() -> Scenario:
    """The demo's flight past a fire 2 km away, its camera at half the size."""
    demo = load_scenario("demo")
    camera = msgspec.structs.replace(demo.camera, width=640, height=360, fx=450.0, fy=450.0, cx=319.5, cy=179.5)
    return msgspec.structs.replace(demo, camera=camera)


@pytest.fixture(scope="module")
def scene(scenario: Scenario) -> DrawnScene:
    return DrawnScene(scenario, np.random.default_rng(0))


def moment_at(scenario: Scenario, t_s: float) -> Moment:
    """What the craft would write: its place as it is, its angles as compass and gimbal have them."""
    pose = camera_pose(scenario, t_s, t_s)
    lat_deg, lon_deg, alt_m = scenario.frame.geodetic_from_enu(pose.position_enu_m)
    R_ned_from_frd = R_ENU_FROM_NED.T @ pose.R_cam_from_enu.T @ R_FRD_FROM_CAM.T
    yaw, pitch, roll = (math.degrees(one) for one in euler_from_matrix(R_ned_from_frd))
    above_m = alt_m - scenario.origin.alt_msl_m
    return Moment(lat_deg, lon_deg, above_m, alt_m, yaw + HEADING_OFF_DEG, pitch + TILT_OFF_DEG, roll, 0.0)


def found_at(folder: Path, scenario: Scenario, out: Path) -> tuple[str, float, bool]:
    """The fire's state, its error in metres and whether its ellipse holds it."""
    (folder / "truth.json").write_bytes(msgspec.json.encode(truth_json(scenario)))
    recording = Recording(folder)
    score, _ = replay(recording, load_config(folder / "config.toml"), out, seed=0)
    recording.close()
    assert score is not None and score.false_confirmed == 0
    return score.targets[0].state, score.targets[0].error_m, score.targets[0].inside95


def test_a_film_with_its_subtitles(scenario: Scenario, scene: DrawnScene, tmp_path: Path) -> None:
    size = (scenario.camera.width, scenario.camera.height)
    writer = cv2.VideoWriter(str(tmp_path / "DJI_0001.MP4"), cv2.VideoWriter.fourcc(*"mp4v"), FPS, size)
    times_s = np.arange(int(SECONDS * FPS)) / FPS
    for t_s in times_s:
        writer.write(scene.seen_at(t_s))
    writer.release()
    plain = DIALECTS["Mavic 3"]
    focal_mm = 36.0 * 450.0 / 640.0
    told = Dialect(
        lambda number, t, at: plain.text(number, t, at).replace("focal_len: 24.00", f"focal_len: {focal_mm:.2f}"),
        1e-6,
        0.1,
        cue_s=1.0 / FPS,
    )
    source = tmp_path / "DJI_0001.SRT"
    source.write_text(srt_of(told, [moment_at(scenario, t_s) for t_s in times_s]), "utf-8")
    run_import([source], Wanted(tmp_path / "out"), lambda line: None)
    state, error_m, is_inside = found_at(tmp_path / "out", scenario, tmp_path / "replay")
    assert (state, is_inside) == ("confirmed", True) and error_m < 150.0


def test_a_folder_of_pictures(scenario: Scenario, scene: DrawnScene, tmp_path: Path) -> None:
    folder = tmp_path / "pictures"
    folder.mkdir()
    focal_35_mm = round(450.0 * math.hypot(36.0, 24.0) / math.hypot(640.0, 360.0))
    for number in range(30):
        t_s = 2.0 * number
        at = moment_at(scenario, t_s)
        exif = exif_of("DJI", at, f"2024:06:01 14:30:{int(t_s):02d}", tag_A405=focal_35_mm)
        write_picture(folder / f"DJI_{number:04d}.JPG", exif, dji(at), scene.seen_at(t_s), quality=95)
    run_import([folder], Wanted(tmp_path / "out"), lambda line: None)
    state, error_m, is_inside = found_at(tmp_path / "out", scenario, tmp_path / "replay")
    assert (state, is_inside) == ("confirmed", True) and error_m < 200.0
