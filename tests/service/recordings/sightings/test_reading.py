"""Tables as spreadsheets and people write them: each row by itself, and what is wrong of it in one line."""

from pathlib import Path

import pytest

from service.recordings.sightings.reading import SightingsError, read_table
from service.recordings.sightings.rows import Sightings, sightings_of

HEADER = "platform,lat,lon,alt_msl_m,azimuth_deg"
ROWS = [f"p{i},47.{i},8.1,500,{10 * i}" for i in range(6)]


def read(tmp_path: Path, *lines: str) -> Sightings:
    path = tmp_path / "x.csv"
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return sightings_of([read_table(path)], None, None, None)


def test_a_quote_that_is_not_closed_spoils_its_row_only(tmp_path: Path) -> None:
    found = read(tmp_path, HEADER, *ROWS[:2], '"p2,47.2,8.1,500,20', *ROWS[3:])
    assert found.where == [f"x.csv row {number}" for number in (2, 3, 5, 6, 7)]
    assert found.faults == ["x.csv row 4: has a quote that is not closed (unexpected end of data)"]


def test_a_cell_may_have_line_breaks(tmp_path: Path) -> None:
    found = read(tmp_path, HEADER, '"a\ntower",47.2,8.1,500,20', *ROWS)
    assert found.faults == [] and found.where[:2] == ["x.csv row 2", "x.csv row 4"]
    assert found.sightings[0].platform == "a\ntower"


def test_a_spreadsheet_s_line_on_its_separator_is_no_header(tmp_path: Path) -> None:
    found = read(tmp_path, "sep=;", HEADER.replace(",", ";"), *(row.replace(",", ";") for row in ROWS))
    assert len(found.sightings) == 6 and found.where[0] == "x.csv row 3"


def test_longitudes_may_go_all_the_way_round(tmp_path: Path) -> None:
    (one,) = read(tmp_path, HEADER, "a,47,352.5,500,20").sightings
    assert one.lon_deg == pytest.approx(-7.5)


def test_places_in_radians_are_suspected_and_read_where_they_say_so(tmp_path: Path) -> None:
    rows = [f"a,0.82{i},0.14,500,20" for i in range(3)]
    assert "radians go into lat_rad and lon_rad" in read(tmp_path, HEADER, *rows).notes[0]
    found = read(tmp_path, HEADER.replace(",lat,lon", ",lat_rad,lon_rad"), *rows)
    assert found.notes == [] and found.sightings[0].lat_deg == pytest.approx(46.98, abs=0.01)


def test_decimal_commas_between_commas_are_told_what_would_be_right(tmp_path: Path) -> None:
    with pytest.raises(SightingsError, match="'47,2': must be a number; decimal commas need another separator"):
        read(tmp_path, HEADER, 'a,"47,2",8,500,20')


def test_what_has_no_elevation_needs_no_altitude(tmp_path: Path) -> None:
    found = read(tmp_path, "platform,lat,lon,azimuth_deg", "a,47,8,20", "b,47,8.2,340")
    assert len(found.sightings) == 2
    assert found.notes == ["2 bearings without an altitude: taken as from the sea's level, which tells no range"]
