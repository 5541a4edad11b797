"""Pictures of each maker give the places, heights and angles that were written into them."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given as for_all
from hypothesis import settings
from hypothesis import strategies as st

from distloc.geometry.rotations import matrix_from_euler, matrix_from_quaternion
from service.recordings.importers.flight import Given, ImportedFlight, ImportRefusedError, Stills
from service.recordings.importers.stills.makers import level_from_nadir
from service.recordings.importers.stills.stills import read_stills
from tests.support.drone_pictures import MAKERS, dji, exif_of, packet, parrot, write_picture
from tests.support.srt_lines import Moment

NOTHING = Given()
CENTIMETRE_DEG = 1e-7


def moment(number: int) -> Moment:
    return Moment(
        lat_deg=-36.891878 + 1e-4 * number,
        lon_deg=174.703095 - 2e-4 * number,
        above_home_m=80.25 + number,
        msl_m=112.5 + number,
        yaw_deg=-170.0 + 21.3 * number,
        pitch_deg=-12.5 - number,
        roll_deg=0.5,
        craft_yaw_deg=30.0 + number,
    )


def clock(number: int) -> str:
    return f"2024:06:01 14:30:{2 * number:02d}"


def flight_of(folder: Path, maker: str, count: int = 6, **extra: object) -> ImportedFlight:
    make, xmp = MAKERS[maker]
    for number in range(count):
        at = moment(number)
        write_picture(folder / f"P_{number:04d}.JPG", exif_of(make, at, clock(number), **extra), xmp(at))
    return read_stills(folder, NOTHING)


@pytest.mark.parametrize("maker", MAKERS)
def test_each_makers_names_give_the_poses(maker: str, tmp_path: Path) -> None:
    flight = flight_of(tmp_path, maker)
    positions, camera = flight.positions, flight.camera
    assert positions is not None and camera is not None
    assert (flight.craft is not None) == (maker in ("DJI", "Parrot"))
    assert isinstance(flight.frames, Stills) and len(flight.frames.paths) == 6
    np.testing.assert_array_equal(flight.frames.time_s, [0.0, 2.0, 4.0, 6.0, 8.0, 10.0])
    np.testing.assert_array_equal(positions.time_s, flight.frames.time_s)
    np.testing.assert_array_equal(camera.time_s, flight.frames.time_s)
    for number in range(6):
        at = moment(number)
        assert positions.lat_deg[number] == pytest.approx(at.lat_deg, abs=CENTIMETRE_DEG)
        assert positions.lon_deg[number] == pytest.approx(at.lon_deg, abs=CENTIMETRE_DEG)
        if maker != "Parrot":
            assert positions.above_home_m[number] == pytest.approx(at.above_home_m, abs=0.001)
        told, other = positions.alt_msl_m[number], positions.alt_ellipsoid_m[number]
        if maker.startswith("Skydio"):
            told, other = other, told
        assert told == pytest.approx(at.msl_m, abs=0.001) and math.isnan(other)
        expected = matrix_from_euler(*np.radians([at.yaw_deg, at.pitch_deg, at.roll_deg]))
        np.testing.assert_allclose(matrix_from_quaternion(camera.q_ned_from_body[number]), expected, atol=2e-4)


def test_a_pitch_of_90_below_looks_down_and_north_is_up(tmp_path: Path) -> None:
    at = replace(moment(0), yaw_deg=0.0, pitch_deg=-90.0, roll_deg=0.0)
    write_picture(tmp_path / "a.jpg", exif_of("DJI", at, clock(0)), dji(at))
    camera = read_stills(tmp_path, NOTHING).camera
    assert camera is not None
    R = matrix_from_quaternion(camera.q_ned_from_body[0])
    np.testing.assert_allclose(R @ [1.0, 0.0, 0.0], [0.0, 0.0, 1.0], atol=1e-9)  # the line of sight
    np.testing.assert_allclose(R @ [0.0, 0.0, -1.0], [1.0, 0.0, 0.0], atol=1e-9)  # the picture's top
    np.testing.assert_allclose(R @ [0.0, 1.0, 0.0], [0.0, 1.0, 0.0], atol=1e-9)  # its right


@pytest.mark.parametrize(
    ("pix4d", "level"),
    [
        ((0.0, 90.0, 0.0), (0.0, 0.0, 0.0)),  # the horizon in the north
        ((90.0, 70.0, 0.0), (90.0, -20.0, 0.0)),
        ((-30.0, 0.0, 0.0), (-30.0, -90.0, 0.0)),  # straight down
        ((10.0, 45.0, 0.0), (10.0, -45.0, 0.0)),
    ],
)
def test_pix4ds_pitch_counts_from_straight_down(
    pix4d: tuple[float, float, float], level: tuple[float, float, float]
) -> None:
    np.testing.assert_allclose(level_from_nadir(np.array(pix4d)), level, atol=1e-6)


@pytest.mark.parametrize("roll_deg", [-10.0, 0.0, 25.0])
def test_pix4ds_axes_are_top_right_and_line_of_sight(roll_deg: float) -> None:
    """Rz(yaw) Ry(pitch) Rx(roll) of axes that are the picture's top, its right and the line of sight."""
    angles = np.array([40.0, 65.0, roll_deg])
    R_ned_from_pix4d = matrix_from_euler(*np.radians(angles))
    R_ned_from_frd = matrix_from_euler(*np.radians(level_from_nadir(angles)))
    np.testing.assert_allclose(R_ned_from_frd @ [1, 0, 0], R_ned_from_pix4d @ [0, 0, 1], atol=1e-9)
    np.testing.assert_allclose(R_ned_from_frd @ [0, 1, 0], R_ned_from_pix4d @ [0, 1, 0], atol=1e-9)
    np.testing.assert_allclose(R_ned_from_frd @ [0, 0, -1], R_ned_from_pix4d @ [1, 0, 0], atol=1e-9)


def pix4d_folder(folder: Path, pitch: float) -> ImportedFlight:
    xmp = packet("Camera", "http://pix4d.com/camera/1.0/", {"Yaw": "10", "Pitch": f"{pitch}", "Roll": "0"})
    write_picture(folder / "a.jpg", exif_of("Autel Robotics", moment(0), clock(0)), xmp)
    return read_stills(folder, NOTHING)


def test_pix4ds_names_are_read_with_their_own_zero_and_that_is_said(tmp_path: Path) -> None:
    flight = pix4d_folder(tmp_path, 75.0)
    assert flight.camera is not None and any("Pix4D" in line for line in flight.remarks.assumed)
    R = matrix_from_quaternion(flight.camera.q_ned_from_body[0])
    np.testing.assert_allclose(R, matrix_from_euler(math.radians(10.0), math.radians(-15.0), 0.0), atol=1e-9)


def test_a_pitch_that_pix4ds_zero_does_not_explain_is_not_used(tmp_path: Path) -> None:
    flight = pix4d_folder(tmp_path, -35.0)
    assert flight.camera is None and any("Camera:Pitch" in reason for reason in flight.remarks.dropped)


def test_a_flirs_own_angles_are_the_crafts_nose(tmp_path: Path) -> None:
    """A FLIR in a craft writes Camera:Yaw from the nose and FLIR:MAVYaw from north."""
    both = packet(
        "FLIR", "http://ns.flir.com/xmp/1.0/", {"MAVYaw": "9000/100", "MAVPitch": "200/100", "MAVRoll": "0/1"}
    )
    both = both.replace(b'MAVRoll="0/1"', b'MAVRoll="0/1" Camera:Yaw="0/100" Camera:Pitch="0/100" Camera:Roll="0/100"')
    write_picture(tmp_path / "a.jpg", exif_of("FLIR", moment(0), clock(0)), both)
    flight = read_stills(tmp_path, NOTHING)
    assert flight.camera is None and flight.craft is not None
    R = matrix_from_quaternion(flight.craft.q_ned_from_body[0])
    np.testing.assert_allclose(R, matrix_from_euler(math.radians(90.0), math.radians(2.0), 0.0), atol=1e-9)


def test_exif_alone_gives_places_and_what_lacks_is_said(tmp_path: Path) -> None:
    below_sea = replace(moment(0), msl_m=-400.0, lat_deg=31.5, lon_deg=-35.5)
    write_picture(tmp_path / "a.jpg", exif_of("Phone", below_sea, clock(0)))
    flight = read_stills(tmp_path, NOTHING)
    assert flight.positions is not None and flight.camera is None
    assert flight.positions.lat_deg[0] == pytest.approx(31.5) and flight.positions.lon_deg[0] == pytest.approx(-35.5)
    assert flight.positions.alt_msl_m[0] == -400.0
    assert any("attitude" in line for line in flight.remarks.lacks)


def test_a_tiff_is_read_as_well(tmp_path: Path) -> None:
    at = moment(0)
    write_picture(tmp_path / "a.tif", exif_of("Parrot", at, clock(0)), parrot(at))
    flight = read_stills(tmp_path, NOTHING)
    assert flight.camera is not None and flight.positions is not None


def test_an_rtks_height_is_the_ellipsoids_and_its_sigma_the_receivers(tmp_path: Path) -> None:
    at = moment(0)
    xmp = dji(at).replace(
        b"drone-dji:AbsoluteAltitude",
        b'drone-dji:RtkFlag="50" drone-dji:RtkStdLon="0.012" drone-dji:RtkStdLat="0.016" drone-dji:AbsoluteAltitude',
    )
    write_picture(tmp_path / "a.jpg", exif_of("DJI", at, clock(0)), xmp)
    flight = read_stills(tmp_path, NOTHING)
    assert flight.positions is not None and flight.fixes is not None
    assert flight.positions.alt_ellipsoid_m[0] == pytest.approx(at.msl_m)
    assert math.isnan(flight.positions.alt_msl_m[0])
    assert flight.fixes.fix_type[0] == 6 and flight.fixes.h_acc_m[0] == pytest.approx(0.02)


@pytest.mark.parametrize(
    ("extra", "focal_px"),
    [
        ({"tag_A405": 24}, 24.0 * 80.0 / math.hypot(36.0, 24.0)),  # 35 mm equivalent, by the diagonal of 64 x 48
        ({"tag_A405": 24, "tag_A404": 2.0}, 48.0 * 80.0 / math.hypot(36.0, 24.0)),
        ({"tag_920A": 12.3, "tag_A20E": 64 / 17.3, "tag_A210": 4}, 12.3 * 64 / 17.3),
        ({"tag_920A": 12.3, "tag_A20E": 640 / 17.3, "tag_A210": 4, "tag_A405": 24}, 24.0 * 80.0 / 43.2666),
    ],
)
def test_the_lens_by_what_exif_has(extra: dict[str, float], focal_px: float, tmp_path: Path) -> None:
    flight = flight_of(tmp_path, "DJI", 2, **extra)
    assert flight.lens is not None and flight.lens.fx == pytest.approx(focal_px, rel=1e-3)
    assert (flight.lens.width, flight.lens.height) == (64, 48)


@pytest.mark.parametrize(("calibrated_px", "is_used"), [("45.5", True), ("3666.666504", False)])
def test_a_makers_calibration_counts_where_it_is_this_pictures(
    calibrated_px: str, is_used: bool, tmp_path: Path
) -> None:
    at = moment(0)
    xmp = dji(at).replace(
        b"drone-dji:AbsoluteAltitude",
        f'drone-dji:CalibratedFocalLength="{calibrated_px}" drone-dji:AbsoluteAltitude'.encode(),
    )
    write_picture(tmp_path / "a.jpg", exif_of("DJI", at, clock(0), tag_A405=24), xmp)
    lens = read_stills(tmp_path, NOTHING).lens
    assert lens is not None and lens.fx == pytest.approx(45.5 if is_used else 44.376, abs=0.001)


def test_pictures_of_another_camera_are_left_out_and_counted(tmp_path: Path) -> None:
    flight_of(tmp_path, "DJI", 4, tag_A405=24)
    for number, focal in ((4, 24), (5, 162)):
        image = np.zeros((96, 128, 3), np.uint8) if number == 4 else None
        exif = exif_of("DJI", moment(number), clock(number), tag_A405=focal)
        write_picture(tmp_path / f"P_{number}.JPG", exif, dji(moment(number)), image)
    flight = read_stills(tmp_path, NOTHING)
    assert isinstance(flight.frames, Stills) and len(flight.frames.paths) == 4
    assert flight.remarks.dropped == {"picture: of another camera, size or zoom than most": 2}


def test_what_is_no_picture_or_has_no_time_is_counted(tmp_path: Path) -> None:
    flight_of(tmp_path, "DJI", 3)
    (tmp_path / "broken.jpg").write_bytes(b"\xff\xd8\xff\xe1" + b"\xff" * 500)
    (tmp_path / "empty.png").write_bytes(b"")
    (tmp_path / "note.txt").write_text("no picture")
    write_picture(tmp_path / "z.jpg", exif_of("DJI", moment(0), ""), dji(moment(0)))
    turned = exif_of("DJI", moment(0), clock(9))
    turned[0x0112] = 6
    write_picture(tmp_path / "y.jpg", turned, dji(moment(0)))
    flight = read_stills(tmp_path, NOTHING)
    assert isinstance(flight.frames, Stills) and len(flight.frames.paths) == 3
    assert sum(flight.remarks.dropped.values()) == 4
    assert any("turned by its EXIF" in reason for reason in flight.remarks.dropped)


def test_a_folder_without_a_usable_picture_is_refused_in_one_line(tmp_path: Path) -> None:
    (tmp_path / "broken.jpg").write_bytes(b"\xff\xd8\xff\xe1" + b"\xff" * 500)
    with pytest.raises(ImportRefusedError, match="no picture that tells when it was taken"):
        read_stills(tmp_path, NOTHING)


@settings(max_examples=120, deadline=None)
@for_all(st.data())
def test_a_spoilt_picture_is_read_or_counted(data: st.DataObject) -> None:
    from tempfile import TemporaryDirectory

    with TemporaryDirectory() as folder:
        maker = data.draw(st.sampled_from(sorted(MAKERS)))
        make, xmp = MAKERS[maker]
        path = Path(folder) / ("a.jpg" if data.draw(st.booleans()) else "a.tif")
        write_picture(path, exif_of(make, moment(0), clock(0), tag_A405=24), xmp(moment(0)))
        content = bytearray(path.read_bytes())
        for _ in range(data.draw(st.integers(1, 20))):
            at = data.draw(st.integers(0, min(len(content) - 1, 2500)))
            content[at : at + data.draw(st.integers(0, 4))] = data.draw(st.binary(max_size=4))
        path.write_bytes(bytes(content))
        try:
            flight = read_stills(Path(folder), NOTHING)
        except ImportRefusedError as refused:
            assert "\n" not in str(refused)
            return
        assert flight.positions is None or np.isfinite(flight.positions.lat_deg).all()
