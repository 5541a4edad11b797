"""A drone's film of a fire, or its pictures, imported and replayed: the fire is found where it stands."""

import csv
import math
import re
from pathlib import Path

import cv2
import msgspec
import numpy as np
import pytest

from distloc.geometry.rotations import R_ENU_FROM_NED, R_FRD_FROM_CAM, euler_from_matrix
from service.commands.importing.run import Wanted, run_import
from service.commands.locate.run import Wanted as LocateWanted
from service.commands.locate.run import run_locate
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


@pytest.fixture(scope="module")
def film(scenario: Scenario, scene: DrawnScene, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A film, and beside it the subtitles that a Mavic 3 Enterprise would write."""
    folder = tmp_path_factory.mktemp("film")
    size = (scenario.camera.width, scenario.camera.height)
    writer = cv2.VideoWriter(str(folder / "DJI_0001.MP4"), cv2.VideoWriter.fourcc(*"mp4v"), FPS, size)
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
    source = folder / "DJI_0001.SRT"
    source.write_text(srt_of(told, [moment_at(scenario, t_s) for t_s in times_s]), "utf-8")
    return source


def test_a_film_with_its_subtitles(film: Path, scenario: Scenario, tmp_path: Path) -> None:
    run_import([film], Wanted(tmp_path / "out"), lambda line: None)
    state, error_m, is_inside = found_at(tmp_path / "out", scenario, tmp_path / "replay")
    assert (state, is_inside) == ("confirmed", True) and error_m < 150.0


def test_a_film_without_any_angle_by_a_mount_that_is_five_degrees_off(
    film: Path, scenario: Scenario, tmp_path: Path
) -> None:
    """The nose by the course, the camera's place in the craft by eye: the scenery measures what that is wrong by."""
    source = tmp_path / "DJI_0001.SRT"
    source.write_text(re.sub(r"\[gb_yaw[^\]]*\]", "", film.read_text("utf-8")), "utf-8")
    mount = scenario.camera.mount
    by_eye = (mount.yaw_deg + 5.0, mount.pitch_deg + 2.0, 0.0)
    wanted = Wanted(tmp_path / "out", by_course=True, mount_deg=by_eye, mount_sigma_deg=5.0)
    run_import([source, film.with_suffix(".MP4")], wanted, lambda line: None)
    state, error_m, is_inside = found_at(tmp_path / "out", scenario, tmp_path / "replay")
    assert (state, is_inside) == ("confirmed", True) and error_m < 150.0
    told = msgspec.json.decode((tmp_path / "replay" / "status.json").read_bytes())["scenery"]
    assert told["state"] == "scenery" and told["heading_error_deg"] == pytest.approx(5.0, abs=1.5)


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


def test_pictures_that_an_analyst_marked(scenario: Scenario, tmp_path: Path) -> None:
    """Only the table is needed: the fire's foot marked to 3 px in five of ten pictures."""
    folder, table = tmp_path / "pictures", tmp_path / "marks.csv"
    folder.mkdir()
    focal_35_mm = round(450.0 * math.hypot(36.0, 24.0) / math.hypot(640.0, 360.0))
    base_enu_m, rng = scenario.targets[0].plume.base_enu_m, np.random.default_rng(5)
    times_s = [6.0 * number for number in range(10)]
    for number, t_s in enumerate(times_s):
        at = moment_at(scenario, t_s)
        exif = exif_of("DJI", at, f"2024:06:01 14:30:{int(t_s):02d}", tag_A405=focal_35_mm)
        write_picture(folder / f"D_{number}.JPG", exif, dji(at), np.full((360, 640, 3), 99, np.uint8))
    run_import([folder], Wanted(sightings=table), lambda line: None)
    rows = list(csv.DictReader(table.read_text("utf-8").splitlines()))
    for number in range(0, 10, 2):
        pose = camera_pose(scenario, times_s[number], times_s[number])
        base_cam_m = pose.R_cam_from_enu @ (base_enu_m - pose.position_enu_m)
        pixels, _ = scenario.camera.camera().project(base_cam_m[:, None])
        marked = pixels[:, 0] + 3.0 * rng.standard_normal(2)
        rows[number]["u_px"], rows[number]["v_px"] = (f"{one:.1f}" for one in marked)
    with table.open("w", newline="") as file:
        writer = csv.DictWriter(file, rows[0])
        writer.writeheader()
        writer.writerows(rows)
    warned: list[str] = []
    (place,) = run_locate([table], LocateWanted(), lambda line: None, warned.append).places
    assert len(place.used) == 5 and any("5 pictures with nothing marked" in line for line in warned)
    assert place.lat_deg is not None and place.lon_deg is not None and place.ellipse95 is not None
    off_m = scenario.frame.enu_from_geodetic(place.lat_deg, place.lon_deg, 430.0)[:2] - base_enu_m[:2]
    assert np.hypot(*off_m) < place.ellipse95.semi_major_m < 1000.0
