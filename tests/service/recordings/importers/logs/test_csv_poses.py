"""Tables of poses to recordings: their columns, times and frames, and what is said of poor ones."""

from pathlib import Path

import numpy as np
import pytest

from service.recordings.importers.flight import Given, ImportRefusedError
from service.recordings.importers.logs.csv_poses import read_csv_poses
from service.recordings.importers.readers import reader_of
from tests.support.films import write_film
from tests.support.flown import (
    EPOCH_S,
    HOME_ALT_M,
    PICTURES_S,
    UNDULATION_M,
    Flown,
    imported,
    replayed,
    write_pictures,
)

CAMERA = ("--hfov", 60)
COLUMNS = ("time", "lat", "lon", "alt_msl_m", "craft_yaw_deg", "craft_pitch_deg", "craft_roll_deg")


def rows_of(flown: Flown, rate_hz: float, shift_s: float = 0.0) -> list[list[str]]:
    t_s = flown.times_s(rate_hz)
    table = np.vstack([EPOCH_S + t_s + shift_s, flown.place(t_s), flown.angles_deg(t_s)])
    formats = (".3f", ".8f", ".8f", ".3f", ".4f", ".4f", ".4f")
    return [[f"{cell:{form}}" for cell, form in zip(row, formats, strict=True)] for row in table.T]


def written(path: Path, rows: list[list[str]], columns: tuple[str, ...] = COLUMNS, separator: str = ",") -> Path:
    lines = [separator.join(row) for row in ([*columns], *rows)]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def test_poses_of_the_recording_are_the_tables(tmp_path: Path) -> None:
    table = written(tmp_path / "poses.csv", rows_of(Flown(), 20.0))
    code, said = imported(table, write_pictures(tmp_path / "p"), "--out", tmp_path / "out", *CAMERA)
    assert code == 0, said
    assert "the receiver's fix: it is taken for a 3D fix" in said and "speeds by the places" in said
    errors = replayed(tmp_path / "out")
    assert errors.frames == len(PICTURES_S)
    assert 0.0 < errors.attitude_deg < 0.01 and 0.0 < errors.position_m < 0.05


def test_one_row_a_second_is_filled_in_and_the_errors_told_are_larger(tmp_path: Path) -> None:
    table = written(tmp_path / "poses.csv", rows_of(Flown(), 1.0))
    code, said = imported(table, write_pictures(tmp_path / "p"), "--out", tmp_path / "out", *CAMERA)
    assert code == 0, said
    assert "attitudes between those told, at 10 a second" in said and "the errors told are larger" in said
    errors = replayed(tmp_path / "out")
    assert errors.frames == len(PICTURES_S)
    config = (tmp_path / "out" / "config.toml").read_text()
    told_deg = float(config.split("attitude_white_deg = ")[1].split()[0])
    told_m = float(config.split("position_m = ")[1].split()[0])
    assert 0.1 < errors.attitude_deg < 3.0 * told_deg < 10.0
    assert 0.0 < errors.position_m < 3.0 * told_m < 10.0


def test_gaps_of_seconds_stay_gaps(tmp_path: Path) -> None:
    rows = [row for row in rows_of(Flown(), 10.0) if not 8.0 < float(row[0]) - EPOCH_S < 13.0]
    table = written(tmp_path / "poses.csv", rows)
    code, said = imported(table, write_pictures(tmp_path / "p"), "--out", tmp_path / "out", *CAMERA)
    assert code == 0 and "in 1 gaps too long to fill" in said
    hidden = ((PICTURES_S > 8.0) & (PICTURES_S < 13.0)).sum()
    assert replayed(tmp_path / "out").frames == len(PICTURES_S) - hidden


def test_a_cameras_attitude_needs_no_craft(tmp_path: Path) -> None:
    columns = tuple(name.removeprefix("craft_") for name in COLUMNS)
    table = written(tmp_path / "poses.csv", rows_of(Flown(), 20.0), columns)
    code, said = imported(table, write_pictures(tmp_path / "p"), "--out", tmp_path / "out", *CAMERA)
    assert code == 0 and "the camera's attitude stands for the craft's" in said
    assert replayed(tmp_path / "out").attitude_deg < 0.01


@pytest.mark.parametrize("separator", [",", ";", "\t"])
def test_separators_marks_and_decimal_commas(tmp_path: Path, separator: str) -> None:
    rows = rows_of(Flown(), 5.0)
    if separator == ";":
        rows = [[cell.replace(".", ",") for cell in row] for row in rows]
    table = written(tmp_path / "poses.csv", rows, separator=separator)
    table.write_bytes(b"\xef\xbb\xbf" + table.read_bytes())
    assert reader_of(table).name == "a table of poses (CSV)"
    flight = read_csv_poses(table, Given())
    assert flight.positions is not None and len(flight.positions.time_s) == 100
    assert flight.positions.lat_deg[0] == pytest.approx(47.4275)


def test_times_with_a_zone_without_one_and_of_another_one(tmp_path: Path) -> None:
    def table(time: str) -> Path:
        return written(tmp_path / "t.csv", [[time, "47.1", "8.1", "500", "0", "0", "0"]] * 1)

    zoned = read_csv_poses(table("2026-07-14T05:33:20+02:00"), Given())
    assert zoned.epoch_s == 1_784_000_000.0
    bare = read_csv_poses(table("2026-07-14T05:33:20"), Given())
    assert bare.epoch_s == 1_784_007_200.0 and "--utc-offset mends that" in bare.remarks.assumed[0]
    local = read_csv_poses(table("2026-07-14T05:33:20"), Given(utc_offset_s=7200.0))
    assert local.epoch_s == 1_784_000_000.0 and not [one for one in local.remarks.assumed if "zone" in one]


def test_a_wrong_zone_is_named_with_its_mend(tmp_path: Path) -> None:
    table = written(tmp_path / "poses.csv", rows_of(Flown(), 10.0, shift_s=7200.0))
    code, said = imported(table, write_pictures(tmp_path / "p"), "--out", tmp_path / "out", *CAMERA)
    assert code == 1 and "2.00 h before the first pose: is a local time taken for UTC? --utc-offset HOURS" in said
    assert not (tmp_path / "out").exists()


def test_heights_over_the_ellipsoid_and_over_home(tmp_path: Path) -> None:
    def heights(column: str, value: float, *options: object) -> tuple[str, float]:
        rows = [[*row[:3], str(value), *row[4:]] for row in rows_of(Flown(), 10.0)]
        table = written(tmp_path / "poses.csv", rows, (*COLUMNS[:3], column, *COLUMNS[4:]))
        out = tmp_path / f"{column}{len(options)}"
        code, said = imported(table, "--out", out, *options)
        assert code == 0, said
        from service.recordings.importers.logs.tlog_poses import read_tlog_poses

        flight = read_tlog_poses(out / "telemetry.tlog", Given())
        assert flight.positions is not None
        return said, float(np.median(flight.positions.alt_msl_m))

    said, alt_m = heights("alt_ellipsoidal_m", 540.0)
    assert "taken as over the sea: --geoid" in said and alt_m == pytest.approx(540.0)
    said, alt_m = heights("alt_ellipsoidal_m", 540.0, "--geoid", UNDULATION_M)
    assert "--geoid" not in said and alt_m == pytest.approx(540.0 - UNDULATION_M)
    said, alt_m = heights("above_home_m", 110.0)
    assert "--home-alt mends that" in said and alt_m == pytest.approx(110.0)
    said, alt_m = heights("above_home_m", 110.0, "--home-alt", HOME_ALT_M)
    assert "mends" not in said and alt_m == pytest.approx(540.0)


def test_a_column_counts_a_films_frames(tmp_path: Path) -> None:
    film = tmp_path / "film.mp4"
    times_s = write_film(film)
    rows = [[str(n), *row[1:]] for n, row in enumerate(rows_of(Flown(), 3.0))]
    table = written(tmp_path / "poses.csv", rows, ("frame", *COLUMNS[1:]))
    flight = read_csv_poses(table, Given(films=(film,)))
    assert flight.positions is not None and flight.frames is not None and flight.frames_tied
    assert flight.positions.time_s == pytest.approx(times_s, abs=1e-6)  # of variable rate
    code, said = imported(table, film, "--out", tmp_path / "out", *CAMERA)
    assert code == 0 and "film of variable rate: 60 frames, 160 x 120" in said
    stamps = [int(line.split(",")[0]) for line in (tmp_path / "out" / "frames.csv").read_text().split()[1:]]
    assert np.diff(stamps) * 1e-6 == pytest.approx(np.diff(times_s), abs=1e-5)
    with pytest.raises(ImportRefusedError, match="give the one film that it counts"):
        read_csv_poses(table, Given())


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (lambda row: [*row[:4], str(np.radians(float(row[4]))), *row[5:]], "craft_yaw_rad"),
        (lambda row: [row[0], "nan", *row[2:]], "no row of 40 can be read: 40 x row: lat cannot be read"),
        (lambda row: [row[0], "95.0", *row[2:]], "lat cannot be read"),
        (lambda row: ["yesterday", *row[1:]], "40 x row: time cannot be read"),
        (lambda row: ["", *row[1:]], "40 x row: time cannot be read"),
    ],
)
def test_a_table_of_which_nothing_can_be_used(tmp_path: Path, change: object, says: str) -> None:
    rows = [change(row) for row in rows_of(Flown(), 2.0)]  # type: ignore[operator]
    columns = COLUMNS
    if says == "craft_yaw_rad":
        columns = (*COLUMNS[:4], "craft_yaw_rad", *COLUMNS[5:])
        rows = [[*row[:4], "12.0", *row[5:]] for row in rows]
    code, said = imported(written(tmp_path / "poses.csv", rows, columns), "--out", tmp_path / "out")
    assert (code, says in said, said.strip().count("\n")) == (1, True, 0), said


def test_bad_rows_cost_themselves_and_are_counted(tmp_path: Path) -> None:
    rows = rows_of(Flown(), 10.0)
    rows[20] = [*rows[20][:1], "ninety", *rows[20][2:]]
    rows[30] = ["not a time", *rows[30][1:]]
    rows[40] = [f"{EPOCH_S + 9e8:.3f}", *rows[40][1:]]  # years from now
    rows[50][0] = rows[10][0]  # backwards
    rows[60] = [*rows[60][:1], "0.0", "0.0", *rows[60][3:]]
    flight = read_csv_poses(written(tmp_path / "poses.csv", rows), Given())
    assert flight.positions is not None and len(flight.positions.time_s) == 195
    assert flight.remarks.dropped == {
        "row: lat cannot be read": 1,
        "row: time cannot be read": 1,
        "attitude: time repeated": 1,
        "attitude: a time days from the others'": 1,
        "position: 0, 0, as before a fix": 1,
        "position: time repeated": 1,
        "position: a time days from the others'": 1,
    }


@pytest.mark.parametrize("content", [b"", b"\x00\x01\x02" * 100, b"a,b\n1,2\n", b"lat,lon\n"])
def test_what_is_no_table_of_poses_is_refused_in_one_line(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "x.csv"
    path.write_bytes(content)
    code, said = imported(path, "--out", tmp_path / "out")
    assert (code, str(path) in said, said.strip().count("\n")) == (1, True, 0), said
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(("turn", "says"), [(0.35, "it is in radians, name it craft_yaw_rad"), (0.05, None)])
def test_radians_under_a_name_of_degrees(turn: float, says: str | None, tmp_path: Path) -> None:
    rows = rows_of(Flown(), 20.0)
    for number, row in enumerate(rows):
        row[4] = f"{turn * number % (2.0 * np.pi) if says else turn * min(number, 100):.4f}"
    table = written(tmp_path / "poses.csv", rows)
    if says is not None:
        with pytest.raises(ImportRefusedError, match=says):
            read_csv_poses(table, Given())
    else:
        assert read_csv_poses(table, Given()).remarks.doubt == [
            "craft_yaw_deg is never over 6.28: if it is in radians, name it craft_yaw_rad"
        ]
