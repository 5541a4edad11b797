"""Each dialect of a drone's subtitles gives the flight that it was written from."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given as for_all
from hypothesis import settings
from hypothesis import strategies as st

from distloc.geometry.rotations import matrix_from_euler, matrix_from_quaternion
from service.recordings.importers.dji.srt import read_srt
from service.recordings.importers.flight import Given, ImportedFlight, ImportRefusedError
from tests.support.srt_lines import BEGAN, DIALECTS, Dialect, Moment, srt_of

NOTHING = Given()


def moment_at(t_s: float, lat_deg: float = -20.2532, lon_deg: float = 149.0251) -> Moment:
    """10 m/s to the north-east, slowly turning its camera."""
    return Moment(
        lat_deg=lat_deg + 7.07 * t_s / 111_195.0,
        lon_deg=lon_deg + 7.07 * t_s / 111_195.0 / math.cos(math.radians(lat_deg)),
        above_home_m=60.0 + 0.5 * t_s,
        msl_m=112.0 + 0.5 * t_s,
        yaw_deg=-100.0 + 3.0 * t_s,
        pitch_deg=-12.3 - 0.1 * t_s,
        roll_deg=0.4,
        craft_yaw_deg=45.0 + t_s,
    )


def read(tmp_path: Path, text: str, given: Given = NOTHING, name: str = "DJI_0001.SRT") -> ImportedFlight:
    path = tmp_path / name
    path.write_bytes(text.encode("utf-8"))
    return read_srt(path, given)


def moments(dialect: Dialect, count: int = 40, **where: float) -> list[Moment]:
    return [moment_at(number * dialect.cue_s, **where) for number in range(count)]


@pytest.mark.parametrize("name", DIALECTS)
def test_places_heights_and_angles_are_those_written(name: str, tmp_path: Path) -> None:
    dialect = DIALECTS[name]
    flight = read(tmp_path, srt_of(dialect, moments(dialect)))
    assert flight.positions is not None
    true = [moment_at(t) for t in flight.positions.time_s]
    assert len(true) >= 10
    step = dialect.place_deg * 0.5000001 + 7.1 * 0.001 / 111_195.0  # a cue's start is cut to its millisecond
    assert np.abs(flight.positions.lat_deg - [one.lat_deg for one in true]).max() <= step
    assert np.abs(flight.positions.lon_deg - [one.lon_deg for one in true]).max() <= step * 1.1
    above_m = np.array([one.above_home_m for one in true])
    assert np.abs(flight.positions.above_home_m - above_m).max() <= dialect.above_home_m * 0.51 + 0.001
    if dialect.has_msl:
        assert np.abs(flight.positions.alt_msl_m - [one.msl_m for one in true]).max() <= 0.002
    else:
        assert np.isnan(flight.positions.alt_msl_m).all()
    if not dialect.angle_deg:
        assert flight.camera is None
        return
    assert flight.camera is not None and len(flight.camera.time_s) == 40
    assert (flight.craft is None) == (name in ("Mavic 3", "decimal commas"))
    for t, q in zip(flight.camera.time_s, flight.camera.q_ned_from_body, strict=True):
        at = moment_at(t)
        expected = matrix_from_euler(*np.radians([at.yaw_deg, at.pitch_deg, at.roll_deg]))
        off = expected.T @ matrix_from_quaternion(q)
        assert math.degrees(math.acos(min(1.0, (np.trace(off) - 1.0) / 2.0))) <= 1.8 * 0.5 * dialect.angle_deg + 0.01


@pytest.mark.parametrize("name", ["Mini 3", "Mavic 2", "Mavic Pro", "Autel"])
def test_the_flight_began_at_its_date_in_the_zone_that_is_told(name: str, tmp_path: Path) -> None:
    dialect = DIALECTS[name]
    text = srt_of(dialect, moments(dialect))
    utc_s = (BEGAN - BEGAN.replace(year=1970, month=1, day=1, hour=0, minute=0)).total_seconds()
    as_utc = read(tmp_path, text)
    assert as_utc.epoch_s == pytest.approx(utc_s, abs=0.01)
    assert "local time" in " ".join(as_utc.remarks.assumed)
    in_zone = read(tmp_path, text, Given(utc_offset_s=7200.0))
    assert in_zone.epoch_s == pytest.approx(utc_s - 7200.0, abs=0.01)
    assert "local time" not in " ".join(in_zone.remarks.assumed)


@pytest.mark.parametrize(
    "spoil",
    [
        lambda text: text.replace("\n", "\r\n"),
        lambda text: "\ufeff" + text,
        lambda text: "\n\n\n" + text + "\n\n",
        lambda text: text.replace("<font", "<FONT color='white'").replace("</font>", ""),
    ],
)
def test_line_ends_marks_and_tags_change_nothing(spoil, tmp_path: Path) -> None:  # type: ignore[no-untyped-def]
    dialect = DIALECTS["Mavic 3"]
    text = srt_of(dialect, moments(dialect))
    plain, spoilt = read(tmp_path, text), read(tmp_path, spoil(text))
    assert plain.positions is not None and spoilt.positions is not None
    np.testing.assert_array_equal(plain.positions.lat_deg, spoilt.positions.lat_deg)
    assert plain.camera is not None and spoilt.camera is not None
    np.testing.assert_array_equal(plain.camera.q_ned_from_body, spoilt.camera.q_ned_from_body)


def test_utf_16_is_read(tmp_path: Path) -> None:
    dialect = DIALECTS["Mini 3"]
    path = tmp_path / "A.SRT"
    path.write_bytes(srt_of(dialect, moments(dialect)).encode("utf-16"))
    assert read_srt(path, NOTHING).positions is not None


def test_a_place_that_came_once_a_second_makes_no_steps(tmp_path: Path) -> None:
    """The cues of a second repeat its place: between two of them the craft flew on."""
    dialect = DIALECTS["Mini 3"]
    held = [moment_at(math.floor(number * dialect.cue_s)) for number in range(300)]
    positions = read(tmp_path, srt_of(dialect, held)).positions
    assert positions is not None
    asked_s = np.linspace(0.0, 9.0, 91)
    lat = np.interp(asked_s, positions.time_s, positions.lat_deg)
    assert np.abs(lat - [moment_at(t).lat_deg for t in asked_s]).max() * 111_195.0 < 0.3  # steps: up to 7 m


def test_a_craft_that_hovers_stays_where_it_is_until_it_moves(tmp_path: Path) -> None:
    dialect = DIALECTS["Mini 3"]
    times_s = np.arange(600) * dialect.cue_s
    flown = [moment_at(max(0.0, math.floor((t - 10.0) * 10) / 10)) for t in times_s]
    positions = read(tmp_path, srt_of(dialect, flown)).positions
    assert positions is not None and np.diff(positions.time_s).max() < 0.5
    for t in (0.5, 5.0, 9.5):
        assert np.interp(t, positions.time_s, positions.lat_deg) == pytest.approx(moment_at(0).lat_deg, abs=1e-6)
    assert np.interp(15.0, positions.time_s, positions.lat_deg) == pytest.approx(moment_at(5.0).lat_deg, abs=1e-5)


def test_heights_of_which_nothing_is_said_are_above_home_unless_none_flies_so_high(tmp_path: Path) -> None:
    dialect = DIALECTS["Mavic 2"]
    low = read(tmp_path, srt_of(dialect, moments(dialect)))
    assert low.positions is not None and np.isfinite(low.positions.above_home_m).all()
    assert any("above home" in line for line in low.remarks.assumed)
    high = [replace(one, above_home_m=one.above_home_m + 1400.0) for one in moments(dialect)]
    flight = read(tmp_path, srt_of(dialect, high))
    assert flight.positions is not None and np.isfinite(flight.positions.alt_msl_m).all()
    assert np.isnan(flight.positions.above_home_m).all()
    assert any("above the sea" in line for line in flight.remarks.assumed)


def test_places_in_radians_are_turned_into_degrees_and_that_is_said(tmp_path: Path) -> None:
    dialect = DIALECTS["Mavic 2"]
    true = moments(dialect)
    told = [replace(one, lat_deg=math.radians(one.lat_deg), lon_deg=math.radians(one.lon_deg)) for one in true]
    flight = read(tmp_path, srt_of(dialect, told))
    assert flight.positions is not None
    assert flight.positions.lat_deg[0] == pytest.approx(true[0].lat_deg, abs=math.degrees(1e-6))
    assert any("radians" in line for line in flight.remarks.assumed)
    assert flight.fixes is not None and flight.fixes.h_acc_m[0] > 3.0  # a digit is 6 m then


def test_before_a_fix_there_is_no_place(tmp_path: Path) -> None:
    dialect = DIALECTS["Mavic 3"]
    true = moments(dialect)
    told = [replace(one, lat_deg=0.0, lon_deg=0.0) for one in true[:15]] + true[15:]
    flight = read(tmp_path, srt_of(dialect, told))
    assert flight.positions is not None
    assert flight.positions.time_s[0] == pytest.approx(0.5, abs=0.01)
    assert sum(flight.remarks.dropped.values()) >= 1
    with pytest.raises(ImportRefusedError, match="0, 0"):
        read(tmp_path, srt_of(DIALECTS["Mini 3"], [replace(true[0], lat_deg=0.0, lon_deg=0.0)] * 9))


def test_a_craft_without_gimbal_angles_gives_its_heading_alone(tmp_path: Path) -> None:
    dialect = DIALECTS["Mavic 2 Enterprise"]
    flight = read(tmp_path, srt_of(dialect, moments(dialect)))
    assert flight.camera is None and flight.craft is not None
    R = matrix_from_quaternion(flight.craft.q_ned_from_body[0])
    np.testing.assert_allclose(R, matrix_from_euler(math.radians(45.0), 0.0, 0.0), atol=1e-9)
    assert flight.needs_mount and any("--mount" in line for line in flight.remarks.lacks)


def test_whole_angles_that_may_be_degrees_or_tenths_are_not_used(tmp_path: Path) -> None:
    dialect = DIALECTS["tenths of a degree"]
    told = [replace(one, yaw_deg=12.0, pitch_deg=-9.0, roll_deg=0.0) for one in moments(dialect)]
    flight = read(tmp_path, srt_of(dialect, told))
    assert flight.camera is None
    assert any("tenths" in line for line in flight.remarks.lacks)


def test_a_flipped_gimbal_looks_where_it_looked(tmp_path: Path) -> None:
    """At the nadir a roll of 180 degrees cancels a yaw that turned; elsewhere pictures are stored upright."""
    dialect = DIALECTS["Mavic 3"]
    at = moment_at(0.0)

    def matrix(yaw: float, pitch: float, roll: float) -> np.ndarray:  # type: ignore[type-arg]
        told = replace(at, yaw_deg=yaw, pitch_deg=pitch, roll_deg=roll)
        camera = read(tmp_path, srt_of(dialect, [told] * 3)).camera
        assert camera is not None
        return matrix_from_quaternion(camera.q_ned_from_body[0])

    np.testing.assert_allclose(matrix(-170.0, -90.0, 180.0), matrix(10.0, -90.0, 0.0), atol=1e-9)
    np.testing.assert_allclose(matrix(10.0, -20.0, 180.0), matrix(10.0, -20.0, 0.0), atol=1e-9)
    assert matrix(0.0, -90.0, 0.0) @ [1.0, 0.0, 0.0] == pytest.approx([0.0, 0.0, 1.0])  # looks down


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ("", "no cue of a flight"),
        ("1\n00:00:00,000 --> 00:00:01,000\n- Where is the fire?\n", "no cue of a flight"),
        ("\x00\xff" * 5000, "no cue of a flight"),
        ("1\n00:00:00,000 --> 00:00:01,000\nGPS(12.5, 41.9, 7)\n", "which one is the latitude"),
        ("1\n00:00:00,000 --> 00:00:01,000\nGPS(112.5, 141.9, 7) BAROMETER:3.0\n", "-90 to 90"),
        (
            "1\n00:00:00,000 --> 00:00:01,000\n[latitude: 4711.0] [longitude: 8.0] [rel_alt: 3.0]\n",
            "latitude 4711: must be",
        ),
        ("1\n00:00:00,000 --> 00:00:01,000\n[latitude: 47.0] [longitude: 8.0]\n", "no height"),
    ],
)
def test_what_cannot_be_used_is_refused_in_one_line(text: str, line: str, tmp_path: Path) -> None:
    with pytest.raises(ImportRefusedError) as refused:
        read(tmp_path, text)
    assert line in str(refused.value) and "\n" not in str(refused.value)


@settings(max_examples=300, deadline=None)
@for_all(
    st.lists(
        st.sampled_from(
            [
                "1\n",
                "00:00:00,000 --> 00:00:00,033\n",
                "00:00:99,5 --> 00:00:00\n",
                "[latitude: 47.1]",
                "[longtitude: ",
                "8.6]",
                "[rel_alt: 1.0 abs_alt: -1e400]",
                "GPS(",
                "47.1,8.6,",
                "3M)",
                "HOME (1, 2, 3m)",
                "G.PRY (1,2,3)",
                "°",
                "\ufffd",
                "[Drone: Yaw:",
                "999999999999]",
                "[focal_len: 0]",
                "[dzoom_ratio: 0]",
                "2024-02-31 25:61:00",
                "nan",
                "D 1m, H 9m",
                "2024-02-31 23:01:00.5",
                "<font>",
                "[[[",
                ")))",
                "-",
                "\n\n",
                ",",
                "SrtCnt : 99999999999",
                "SrtCnt : 2 ",
            ]
        ),
        max_size=60,
    )
)
def test_no_text_gives_more_than_one_line(parts: list[str]) -> None:
    from tempfile import TemporaryDirectory

    with TemporaryDirectory() as folder:
        try:
            read(Path(folder), "".join(parts))
        except ImportRefusedError as refused:
            assert "\n" not in str(refused)


@settings(max_examples=100, deadline=None)
@for_all(st.data())
def test_a_spoilt_file_is_read_or_refused(data: st.DataObject) -> None:
    from tempfile import TemporaryDirectory

    dialect = DIALECTS[data.draw(st.sampled_from(sorted(DIALECTS)))]
    content = bytearray(srt_of(dialect, moments(dialect, 8)).encode())
    for _ in range(data.draw(st.integers(1, 12))):
        at = data.draw(st.integers(0, len(content) - 1))
        content[at : at + data.draw(st.integers(0, 5))] = data.draw(st.binary(max_size=5))
    with TemporaryDirectory() as folder:
        path = Path(folder) / "a.srt"
        path.write_bytes(bytes(content))
        try:
            flight = read_srt(path, NOTHING)
        except ImportRefusedError:
            return
        assert flight.positions is None or np.isfinite(flight.positions.lat_deg).all()
