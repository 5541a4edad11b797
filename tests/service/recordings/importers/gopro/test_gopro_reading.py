"""Films with a GoPro's telemetry to flights: places, time, the picture's attitude by the camera's own orientation."""

import json
import re
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from distloc.geometry.rotations import R_FRD_FROM_CAM, matrix_from_euler, matrix_from_quaternion
from distloc.types import FloatArray
from service.commands.cli import app
from service.recordings.importers.flight import Film, Given, ImportedFlight, ImportRefusedError
from service.recordings.importers.gopro.reading import read_gopro
from service.recordings.importers.readers import reader_of
from tests.support.gopro_films import device, element, nested, stream, text, write_film

FPS, SECONDS = 25.0, 8
COUNT = int(FPS * SECONDS)
GPS_HZ = 10
NORTH_M, SPEED_MPS, COURSE_RAD = 111_195.0, 8.0, np.radians(60.0)
YAW_AT_START_RAD = np.radians(200.0)  # what the camera's own orientation counts from is anywhere
NOISE = np.random.default_rng(3).integers(0, 250, (96, 228, 3)).astype(np.uint8)
PICTURES = [np.ascontiguousarray(NOISE[:, i % 100 : i % 100 + 128]) for i in range(COUNT)]


def R_ned_from_picture(time_s: float) -> FloatArray:
    """Looks along the course on the whole, swings by 4 degrees, down and rolled."""
    yaw = COURSE_RAD + np.radians(4.0) * np.sin(2.0 * time_s)
    return matrix_from_euler(yaw, np.radians(-15.0 + 3.0 * np.cos(time_s)), np.radians(4.0)) @ R_FRD_FROM_CAM


def R_camera_from_picture(time_s: float) -> FloatArray:
    """What the stabilisation turns the picture by."""
    return matrix_from_euler(*np.radians([1.5 * np.sin(9.0 * time_s), 1.0, -2.0]))


def quaternion(R: FloatArray) -> FloatArray:
    w = np.sqrt(max(1e-12, 1.0 + np.trace(R))) / 2.0
    return np.array([w, (R[2, 1] - R[1, 2]) / (4 * w), (R[0, 2] - R[2, 0]) / (4 * w), (R[1, 0] - R[0, 1]) / (4 * w)])


def orientation(times_s: FloatArray) -> list[FloatArray]:
    """CORI (start to camera), IORI (camera to picture) and GRAV (down in the camera), as a HERO11 has them."""
    rows: list[list[FloatArray]] = []
    R_start_from_ned = (R_ned_from_picture(0.0) @ R_camera_from_picture(0.0).T).T
    for time_s in times_s.tolist():
        R_ned_from_camera = R_ned_from_picture(time_s) @ R_camera_from_picture(time_s).T
        R_camera_from_start = (R_start_from_ned @ R_ned_from_camera).T
        rows.append(
            [quaternion(R_camera_from_start), quaternion(R_camera_from_picture(time_s).T), R_ned_from_camera.T[:, 2]]
        )
    return [np.stack([row[i] for row in rows]) for i in range(3)]


def place(time_s: FloatArray) -> FloatArray:
    """GPS5's columns."""
    way_m = SPEED_MPS * time_s
    lat = 47.4 + way_m * np.cos(COURSE_RAD) / NORTH_M
    lon = 8.5 + way_m * np.sin(COURSE_RAD) / NORTH_M / np.cos(np.radians(47.4))
    flat = np.full(len(time_s), SPEED_MPS)
    return np.column_stack([lat, lon, 500.0 + 0.5 * time_s, flat, flat])


def gps5(second: int, *, fix: int = 3, altitude: str = "MSLV") -> bytes:
    values = place(second + np.arange(GPS_HZ) / GPS_HZ)
    scale = element("SCAL", "l", [(10_000_000,), (10_000_000,), (1000,), (1000,), (100,)], "i")
    whole = [tuple(round(x) for x in row * [1e7, 1e7, 1e3, 1e3, 1e2]) for row in values]
    notes = [text("GPSA", altitude)] if altitude else []
    notes += [element("GPSF", "L", [(fix,)], "I"), element("GPSP", "S", [(150,)], "H")]
    notes.append(element("GPSU", "U", [f"2607140930{second:02d}.500".encode()], ""))
    return nested("STRM", *notes, scale, element("GPS5", "l", whole, "iiiii"))


def gps9(second: int) -> bytes:
    at_s = second + np.arange(GPS_HZ) / GPS_HZ
    whole = [
        (*(round(x) for x in row * [1e7, 1e7, 1e3, 1e3, 1e2]), 9691, round(1e3 * (34_200.5 + t)), 150, 3)
        for row, t in zip(place(at_s), at_s, strict=True)
    ]
    scales = [(10_000_000,), (10_000_000,), (1000,), (1000,), (100,), (1,), (1000,), (100,), (1,)]
    data = element("GPS9", "?", whole, "iiiiiiiHH")
    return nested("STRM", text("TYPE", "lllllllSS"), element("SCAL", "l", scales, "i"), data)


def payload(second: int, *, places: bytes = b"", with_orientation: bool = True, spoil: float = 0.0) -> bytes:
    times_s = second + np.arange(int(FPS)) / FPS
    streams = [stream("GYRO", np.zeros((200, 3)), 939.0, text("ORIN", "ZXY"))]
    if with_orientation:
        cori, iori, grav = orientation(times_s)
        grav = grav + spoil * np.random.default_rng(second).normal(size=grav.shape)
        grav /= np.linalg.norm(grav, axis=1, keepdims=True)
        streams += [stream(key, one, 32767.0) for key, one in (("CORI", cori), ("IORI", iori), ("GRAV", grav))]
    return device("HERO11 Black", *streams, *([places] if places else []))


def read(tmp_path: Path, payloads: list[bytes], by_course: bool = True) -> ImportedFlight:
    path = tmp_path / "film.mp4"
    write_film(path, PICTURES, payloads, FPS)
    return read_gopro(path, Given(by_course=by_course))


def test_the_pictures_attitude_is_found_but_for_the_course(tmp_path: Path) -> None:
    flight = read(tmp_path, [payload(i, places=gps5(i)) for i in range(SECONDS)])
    assert flight.camera is not None and len(flight.camera.time_s) == COUNT
    off_deg = []
    for time_s, q in zip(flight.camera.time_s, flight.camera.q_ned_from_body, strict=True):
        R = matrix_from_quaternion(q) @ R_FRD_FROM_CAM @ R_ned_from_picture(time_s).T
        off_deg.append(np.degrees([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]]) / 2.0)
    tilt_deg, heading_deg = np.abs(np.array(off_deg)[:, :2]).max(), np.array(off_deg)[:, 2]
    assert tilt_deg < 0.02
    assert np.ptp(heading_deg) < 0.02  # it follows the swing
    assert abs(heading_deg.mean()) < 1.0  # the mean of a swing that is not whole
    assert flight.yaw_sigma_deg is not None and flight.yaw_sigma_deg >= 20.0
    assert any("along the course" in line for line in flight.remarks.assumed)


def test_without_the_users_word_no_north_is_made_up(tmp_path: Path) -> None:
    flight = read(tmp_path, [payload(i, places=gps5(i)) for i in range(SECONDS)], by_course=False)
    assert flight.camera is None and flight.craft is None
    assert any("where north is" in line for line in flight.remarks.lacks)


def test_an_orientation_that_disagrees_with_itself_is_not_used(tmp_path: Path) -> None:
    flight = read(tmp_path, [payload(i, places=gps5(i), spoil=0.5) for i in range(SECONDS)])
    assert flight.camera is None
    assert any("gravity wanders" in line for line in flight.remarks.lacks)


@pytest.mark.parametrize("kind", ["GPS5", "GPS9"])
def test_places_and_utc_are_as_the_receiver_says(tmp_path: Path, kind: str) -> None:
    make = gps5 if kind == "GPS5" else gps9
    flight = read(tmp_path, [payload(i, places=make(i), with_orientation=False) for i in range(SECONDS)])
    positions, fixes = flight.positions, flight.fixes
    assert positions is not None and fixes is not None and isinstance(flight.frames, Film)
    told = place(positions.time_s)
    assert len(positions.time_s) == GPS_HZ * SECONDS
    assert positions.lat_deg == pytest.approx(told[:, 0], abs=2e-7)
    heights = (
        positions.alt_msl_m if kind == "GPS5" else positions.alt_ellipsoid_m
    )  # without a word it is the ellipsoid's
    assert heights == pytest.approx(told[:, 2], abs=0.002)
    assert fixes.fix_type.tolist() == [3] * len(fixes.time_s)
    assert fixes.h_acc_m == pytest.approx(7.5)
    assert flight.epoch_s == pytest.approx(1_784_021_400.5, abs=0.02)  # 2026-07-14T09:30:00.5Z
    assert flight.frames_tied


def test_places_without_a_fix_are_counted_and_left_out(tmp_path: Path) -> None:
    flight = read(tmp_path, [payload(i, places=gps5(i, fix=0 if i < 3 else 3)) for i in range(SECONDS)])
    assert flight.positions is not None and flight.positions.time_s[0] == pytest.approx(3.0, abs=0.01)
    assert flight.remarks.dropped["position: no fix"] == 3 * GPS_HZ


def test_a_film_without_places_says_so_and_is_tied_to_nothing(tmp_path: Path) -> None:
    flight = read(tmp_path, [payload(i) for i in range(SECONDS)])
    assert (flight.positions, flight.camera, flight.epoch_s) == (None, None, None)
    assert not flight.frames_tied
    assert any("receiver was off" in line for line in flight.remarks.lacks)


def test_telemetry_of_nothing_known_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ImportRefusedError, match="has none of"):
        read(tmp_path, [device("x", stream("ABCD", np.zeros((3, 1)), 1.0))] * SECONDS)


def test_a_recording_of_it_replays(tmp_path: Path) -> None:
    path, out, played = tmp_path / "film.mp4", tmp_path / "recording", tmp_path / "played"
    write_film(path, PICTURES, [payload(i, places=gps5(i)) for i in range(SECONDS)], FPS)
    assert reader_of(path).name == "a GoPro's film (GPMF)"
    refused = CliRunner().invoke(app, ["import", str(path), "--out", str(out), "--hfov", "80"])
    assert refused.exit_code != 0 and "--by-course" in str(refused.exception)
    said = CliRunner().invoke(app, ["import", str(path), "--out", str(out), "--hfov", "80", "--by-course"])
    assert said.exit_code == 0, said.output
    assert "stream CORI of HERO11 Black: 200, 25.0 a second" in said.output
    replayed = CliRunner().invoke(app, ["replay", str(out), "--out", str(played)])
    assert replayed.exit_code == 0, replayed.output
    used = re.search(r"(\d+) of 200 frames used", replayed.output)
    assert used and int(used[1]) > 140, replayed.output
    assert json.loads((played / "targets.geojson").read_text(encoding="utf-8"))["features"] == []
