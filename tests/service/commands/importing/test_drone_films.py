"""A drone's film or pictures to a recording, and its poses back through the code that flies."""

import csv
import math
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from distloc.geometry.rotations import matrix_from_euler
from service.commands.importing.run import Wanted, run_import
from service.recordings.importers.flight import ImportRefusedError
from tests.support.drone_pictures import MAKERS, exif_of, write_picture
from tests.support.films import SIZE, numbered
from tests.support.imported_poses import poses_of
from tests.support.srt_lines import DIALECTS, Dialect, Moment, srt_of

FPS, SECONDS = 5.0, 24
METRES_A_DEGREE = 111_195.0


def moment_at(t_s: float) -> Moment:
    """8 m/s to the north-east in a bend, its camera turning slowly."""
    lat_deg = -20.2532 + 6.0 * t_s / METRES_A_DEGREE
    return Moment(
        lat_deg=lat_deg,
        lon_deg=149.0251 + (5.0 * t_s + 0.03 * t_s**2) / METRES_A_DEGREE / math.cos(math.radians(-20.2532)),
        above_home_m=60.0 + 0.5 * t_s,
        msl_m=112.0 + 0.5 * t_s,
        yaw_deg=-100.0 + 2.0 * t_s,
        pitch_deg=-12.3 - 0.1 * t_s,
        roll_deg=0.4,
        craft_yaw_deg=45.0 + t_s,
    )


def filmed(folder: Path, dialect: Dialect) -> Path:
    """A film, and its subtitles with a cue a frame or one a second, as the dialect has."""
    writer = cv2.VideoWriter(str(folder / "DJI_0001.MP4"), cv2.VideoWriter.fourcc(*"mp4v"), FPS, SIZE)
    for number in range(int(FPS * SECONDS)):
        writer.write(numbered(number % 250 + 1))
    writer.release()
    cue_s = 1.0 if dialect.cue_s == 1.0 else 1.0 / FPS
    count = round(SECONDS / cue_s)
    path = folder / "DJI_0001.SRT"
    path.write_text(srt_of(replace(dialect, cue_s=cue_s), [moment_at(n * cue_s) for n in range(count)]), "utf-8")
    return path


def imported(sources: list[Path], out: Path, **wanted: object) -> list[str]:
    lines: list[str] = []
    run_import(sources, Wanted(out, **wanted), lines.append)  # type: ignore[arg-type]
    return lines


def off_deg(R: np.ndarray, S: np.ndarray) -> float:  # type: ignore[type-arg]
    return math.degrees(math.acos(min(1.0, (np.trace(R.T @ S) - 1.0) / 2.0)))


@pytest.mark.parametrize("name", DIALECTS)
def test_a_films_poses_come_back_as_its_subtitles_told_them(name: str, tmp_path: Path) -> None:
    dialect = DIALECTS[name]
    source = filmed(tmp_path, dialect)
    lens = {} if "focal_len" in source.read_text("utf-8") else {"hfov_deg": 73.0}
    turned: dict[str, object] = {} if dialect.angle_deg else {"by_course": True}
    if "Enterprise" in name:
        turned = {"mount_deg": (0.0, -20.0, 0.0), "mount_sigma_deg": 5.0}
    imported([source, tmp_path / "DJI_0001.MP4"], tmp_path / "out", home_alt_m=52.0, **lens, **turned)
    poses = poses_of(tmp_path / "out")
    is_coarse = dialect.place_deg > 1e-5  # steps of 11 m: at the ends a course by them turns too fast to be used
    assert len(poses) >= (0.9 if is_coarse else 0.95) * FPS * (SECONDS - 1)
    coarse_m = dialect.place_deg * METRES_A_DEGREE
    for t_s, (lat_deg, lon_deg, alt_m), R in poses:
        true = moment_at(t_s)
        north_m = (lat_deg - true.lat_deg) * METRES_A_DEGREE
        east_m = (lon_deg - true.lon_deg) * METRES_A_DEGREE * math.cos(math.radians(lat_deg))
        assert math.hypot(north_m, east_m) <= (0.4 if is_coarse else 0.8) * coarse_m + 0.05
        assert alt_m == pytest.approx(true.msl_m, abs=dialect.above_home_m + 0.02)
        if dialect.angle_deg:
            expected = matrix_from_euler(*np.radians([true.yaw_deg, true.pitch_deg, true.roll_deg]))
            assert off_deg(R, expected) <= dialect.angle_deg
        elif "Enterprise" in name:
            assert off_deg(R, matrix_from_euler(math.radians(true.craft_yaw_deg), math.radians(-20.0), 0.0)) <= 0.1


def test_a_crafts_attitude_alone_is_not_taken_for_its_cameras(tmp_path: Path) -> None:
    source = filmed(tmp_path, DIALECTS["Mavic 2 Enterprise"])
    wanted: dict[str, object]
    for wanted in ({}, {"mount_deg": (0.0, -20.0, 0.0)}):
        with pytest.raises(ImportRefusedError, match="not its camera's: give --attitude FILE, or --mount"):
            imported([source], tmp_path / "out", hfov_deg=57.0, **wanted)
    config = tmp_path / "c.toml"
    config.write_text("[camera]\nwidth = 160\nheight = 120\nhfov_deg = 57\n[camera.mount]\npitch_deg = -20.5\n")
    imported([source], tmp_path / "out", config=config)
    assert poses_of(tmp_path / "out")


@pytest.mark.parametrize("maker", MAKERS)
@pytest.mark.parametrize("step_s", [2, 1])
def test_pictures_poses_come_back_as_their_xmp_told_them(maker: str, step_s: int, tmp_path: Path) -> None:
    make, xmp = MAKERS[maker]
    folder = tmp_path / "pictures"
    folder.mkdir()
    for number in range(8):
        at = moment_at(step_s * number)
        exif = exif_of(make, at, f"2024:06:01 14:30:{step_s * number:02d}", tag_A405=24)
        write_picture(folder / f"P_{number:04d}.JPG", exif, xmp(at), numbered(number + 1))
    imported([folder], tmp_path / "out", geoid_m=0.0)
    poses = poses_of(tmp_path / "out")
    assert [t_s for t_s, _, _ in poses] == [step_s * number for number in range(8)]
    for t_s, (lat_deg, lon_deg, alt_m), R in poses:
        true = moment_at(t_s)
        assert (lat_deg, lon_deg) == pytest.approx((true.lat_deg, true.lon_deg), abs=1.1e-7)
        assert alt_m == pytest.approx(true.msl_m, abs=0.002)
        expected = matrix_from_euler(*np.radians([true.yaw_deg, true.pitch_deg, true.roll_deg]))
        assert off_deg(R, expected) <= 0.01


def test_pictures_by_their_names_are_one_flight(tmp_path: Path) -> None:
    make, xmp = MAKERS["DJI"]
    paths = []
    for number in range(3):
        exif = exif_of(make, moment_at(number), f"2024:06:01 14:30:{number:02d}", tag_A405=24)
        paths.append(write_picture(tmp_path / f"P_{number}.jpg", exif, xmp(moment_at(number)), numbered(number + 1)))
    lines = imported(paths, tmp_path / "out")
    assert len(poses_of(tmp_path / "out")) == 3 and "P_0.jpg and 2 more" in lines[0]


def test_one_picture_is_a_flight(tmp_path: Path) -> None:
    make, xmp = MAKERS["DJI"]
    exif = exif_of(make, moment_at(0), "2024:06:01 14:30:00", tag_A405=24)
    path = write_picture(tmp_path / "P.jpg", exif, xmp(moment_at(0)), numbered(3))
    imported([path], tmp_path / "out")
    assert len(poses_of(tmp_path / "out")) == 1


def test_frames_through_another_zoom_are_left_out(tmp_path: Path) -> None:
    plain = DIALECTS["Mavic 3"]
    zoomed = replace(
        plain,
        text=lambda number, t, at: plain.text(number, t, at).replace(
            "[dzoom_ratio: 1.00]", f"[dzoom_ratio: {4.0 if 10 <= number < 40 else 1.0:.2f}]"
        ),
    )
    imported([filmed(tmp_path, zoomed)], tmp_path / "out")
    rows = (tmp_path / "out" / "frames.csv").read_text().splitlines()[1:]
    numbers = [int(row.split(",")[1]) for row in rows]
    assert numbers == [*range(10), *range(40, int(FPS * SECONDS))]


def test_the_homes_height_that_the_user_gives_counts_more_than_the_barometers(tmp_path: Path) -> None:
    source = filmed(tmp_path, DIALECTS["Mini 3"])
    imported([source], tmp_path / "out", by_course=True, home_alt_m=300.0)
    _, (_, _, alt_m), _ = poses_of(tmp_path / "out")[0]
    assert alt_m == pytest.approx(360.0, abs=0.6)


@pytest.mark.parametrize("clock", ["dates", "seconds of the film", "frames"])
def test_a_table_of_attitudes_stands_in_where_subtitles_tell_none(clock: str, tmp_path: Path) -> None:
    source = filmed(tmp_path, DIALECTS["Mini 3"])
    table = tmp_path / "attitude.csv"
    rows = [f"{'frame' if clock == 'frames' else 'time'},yaw_deg,pitch_deg,roll_deg"]
    rate = FPS if clock == "frames" else 10.0
    for number in range(int(SECONDS * rate)):
        t_s, true = number / rate, moment_at(number / rate)
        when = {"dates": f"2024-06-01T14:30:{t_s:06.3f}Z", "frames": f"{number}"}.get(clock, f"{t_s}")
        rows.append(f"{when},{true.yaw_deg:.3f},{true.pitch_deg:.3f},{true.roll_deg:.3f}")
    table.write_text("\n".join(rows))
    with pytest.raises(ImportRefusedError, match="--attitude FILE"):
        imported([source], tmp_path / "none")
    imported([source], tmp_path / "out", attitude=table)
    poses = poses_of(tmp_path / "out")
    assert len(poses) > 100
    for t_s, _, R in poses:
        true = moment_at(t_s)
        expected = matrix_from_euler(*np.radians([true.yaw_deg, true.pitch_deg, true.roll_deg]))
        assert off_deg(R, expected) <= 0.05


def test_a_table_for_locate_has_each_pictures_pose_and_nothing_marked(tmp_path: Path) -> None:
    make, xmp = MAKERS["DJI"]
    folder = tmp_path / "pictures"
    folder.mkdir()
    for number in range(4):
        at = moment_at(3 * number)
        exif = exif_of(make, at, f"2024:06:01 14:30:{3 * number:02d}", tag_A405=24)
        write_picture(folder / f"P_{number:04d}.JPG", exif, xmp(at), numbered(number + 1))
    lines: list[str] = []
    run_import([folder], Wanted(sightings=tmp_path / "marks.csv"), lines.append)
    assert "distloc locate" in lines[-1] and not (tmp_path / "out").exists()
    with (tmp_path / "marks.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [row["picture"] for row in rows] == [f"P_{number:04d}.JPG" for number in range(4)]
    for number, row in enumerate(rows):
        true = moment_at(3 * number)
        assert float(row["lat"]) == pytest.approx(true.lat_deg, abs=1e-8)
        assert float(row["alt_msl_m"]) == pytest.approx(true.msl_m, abs=0.001)
        angles = [float(row[name]) for name in ("yaw_deg", "pitch_deg", "roll_deg")]
        assert angles == pytest.approx([true.yaw_deg, true.pitch_deg, true.roll_deg], abs=0.01)
        assert float(row["heading_deg"]) == pytest.approx(true.craft_yaw_deg, abs=0.1)  # of a body that is tilted
        assert row["time"] == f"2024-06-01T14:30:{3 * number:02d}.000Z" and row["u_px"] == row["v_px"] == ""
    with pytest.raises(ImportRefusedError, match="exists already"):
        run_import([folder], Wanted(sightings=tmp_path / "marks.csv"), lines.append)
    with pytest.raises(ImportRefusedError, match="nothing to write"):
        run_import([folder], Wanted(), lines.append)


def test_a_films_table_has_a_row_a_second(tmp_path: Path) -> None:
    run_import([filmed(tmp_path, DIALECTS["Mavic 3"])], Wanted(sightings=tmp_path / "m.csv"), lambda line: None)
    with (tmp_path / "m.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [int(row["picture"]) for row in rows] == [int(FPS) * second for second in range(SECONDS)]


def test_pictures_without_a_place_belong_to_a_log_by_their_time(tmp_path: Path) -> None:
    folder = tmp_path / "pictures"
    folder.mkdir()
    for number in range(1, 6):
        exif = exif_of("Sony", None, f"2024:06:01 16:30:{2 * number:02d}", tag_A405=24)
        write_picture(folder / f"P_{number:04d}.JPG", exif, b"", numbered(number))
    table = tmp_path / "poses.csv"
    rows = ["time,lat,lon,alt_msl_m,yaw_deg,pitch_deg,roll_deg"]
    for number in range(130):
        at = moment_at(number / 10.0)
        angles = f"{at.yaw_deg:.3f},{at.pitch_deg:.3f},{at.roll_deg:.3f}"
        rows.append(
            f"2024-06-01T14:30:{number / 10.0:06.3f}Z,{at.lat_deg:.8f},{at.lon_deg:.8f},{at.msl_m:.2f},{angles}"
        )
    table.write_text("\n".join(rows))
    with pytest.raises(ImportRefusedError, match="tied to nothing"):
        imported([table, folder], tmp_path / "none")
    imported([table, folder], tmp_path / "out", utc_offset_h=2.0)
    poses = poses_of(tmp_path / "out")
    assert len(poses) == 5
    for number, (_, (lat_deg, _, _), _) in enumerate(poses, 1):
        assert lat_deg == pytest.approx(moment_at(2.0 * number).lat_deg, abs=1e-6)
