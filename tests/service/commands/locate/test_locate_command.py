"""`distloc locate` from file to files, and what it says of tables that are wrong."""

import csv
import json
import math
from collections.abc import Sequence
from datetime import datetime, timezone
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from typer.testing import CliRunner

from distloc.batch.sighting import Sighting
from service.commands.cli import app
from service.commands.locate.run import run_locate
from service.recordings.sightings.reading import SightingsError, read_table
from service.recordings.sightings.rows import Sightings, sightings_of
from service.recordings.sightings.wanted import Wanted
from tests.support.sightings import FRAME, of_towers
from tests.support.towers import FIRE_ENU_M, Towers

HEADER = "time,platform,lat,lon,alt_msl_m,azimuth_deg,elevation_deg,azimuth_sigma_deg,heading_bias_deg"


def row(one: Sighting) -> list[str]:
    stamp = datetime.fromtimestamp(1.78e9 + (one.stamp_s or 0.0), timezone.utc).isoformat()
    angles = (math.degrees(one.azimuth_rad), math.degrees(one.elevation_rad))
    place = (one.lat_deg, one.lon_deg, one.height_m)
    return [stamp, one.platform, *(f"{value:.7f}" for value in (*place, *angles)), "0.1", "3"]


def rows() -> list[list[str]]:
    """Four towers', five looks each: file rows 2 to 21."""
    rng = np.random.default_rng(4)
    return [row(one) for one in of_towers(Towers.drawn(rng, 4), rng)]


def written(path: Path, lines: Sequence[Sequence[str]], header: str = HEADER, separator: str = ",") -> Path:
    text = [header.replace(",", separator), *(separator.join(cells) for cells in lines)]
    path.write_text("\n".join(text) + "\n", encoding="utf-8")
    return path


def read(path: Path, home: tuple[float, float] | None = None, geoid_m: float | None = None) -> Sightings:
    return sightings_of([read_table(path)], None, geoid_m, home)


def ran(path: Path, **wanted: object) -> tuple[list[str], list[str]]:
    """What is said on stdout and on stderr."""
    said: list[str] = []
    warned: list[str] = []
    run_locate([path], Wanted(**wanted), said.append, warned.append)  # type: ignore[arg-type]
    return said, warned


def test_towers_from_a_table_to_the_map(tmp_path: Path) -> None:
    path = written(tmp_path / "towers.csv", rows())
    said, warned = ran(path, out=tmp_path / "out")
    assert warned == []
    assert said[1].startswith("1 ") and "°" in said[1] and "'N" in said[1] and "20 of 4 platforms" in said[1]
    assert "towers.csv rows 2-21" in said[2]
    assert "surer with a sighting from the" in said[3]

    content = json.loads((tmp_path / "out" / "places.geojson").read_bytes())
    place, outline = content["features"]
    assert place["properties"]["schema"] == "distloc/place/1" and place["properties"]["state"] == "located"
    lon, lat = place["geometry"]["coordinates"]
    east_m, north_m, _ = FRAME.enu_from_geodetic(lat, lon, 700.0) - FIRE_ENU_M
    assert math.hypot(east_m, north_m) < 3000.0
    ring = outline["geometry"]["coordinates"][0]
    assert outline["properties"]["kind"] == "ellipse95" and ring[0] == ring[-1] and len(ring) == 73

    (line,) = csv.DictReader((tmp_path / "out" / "places.csv").read_text(encoding="utf-8").splitlines())
    assert float(line["lat"]) == pytest.approx(lat) and line["sightings"] == "20"
    kml = ElementTree.parse(tmp_path / "out" / "places.kml").getroot()
    assert len(kml.findall(".//{*}Placemark")) == 2 + 4
    assert (tmp_path / "out" / "map.png").read_bytes()[:4] == b"\x89PNG"


def test_one_bearing_is_a_sector_and_no_point(tmp_path: Path) -> None:
    path = written(tmp_path / "one.csv", rows()[:1])
    said, _ = ran(path, out=tmp_path / "out")
    assert "bearing" in said[1] and "over " in said[1]
    assert "only a bearing" in said[3] and "--dem" in said[3]
    place, sector = json.loads((tmp_path / "out" / "places.geojson").read_bytes())["features"]
    assert place["geometry"] is None and place["properties"]["range95_m"][1] is None
    assert sector["properties"]["kind"] == "sector"


def test_without_matplotlib_the_rest_is_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import sys

    monkeypatch.setitem(sys.modules, "matplotlib", None)
    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)
    said, _ = ran(written(tmp_path / "towers.csv", rows()), out=tmp_path / "out")
    assert said[-2] == "no map.png: matplotlib is not installed: pip install '.[study]'"
    assert said[-1].endswith("places.geojson, places.csv, places.kml")


def test_spreadsheets_of_any_country(tmp_path: Path) -> None:
    """A byte order mark, semicolons, decimal commas, empty lines: the same sightings."""
    plain = read(written(tmp_path / "plain.csv", rows()))
    lines = [[cell.replace(".", ",") if i > 1 else cell for i, cell in enumerate(cells)] for cells in rows()]
    odd = written(tmp_path / "odd.csv", lines, HEADER.upper(), ";")
    odd.write_bytes(b"\xef\xbb\xbf" + odd.read_bytes().replace(b"\n", b"\r\n") + b"\r\n;;;;\r\n")
    found = read(odd)
    assert found.faults == [] and found.notes == []
    for one, other in zip(plain.sightings, found.sightings, strict=True):
        assert one.direction_enu == pytest.approx(other.direction_enu) and one.lat_deg == other.lat_deg


def test_geojson_points_are_sightings(tmp_path: Path) -> None:
    features = []
    for cells in rows():
        properties = dict(zip(HEADER.split(","), cells, strict=True))
        lon, lat = float(properties.pop("lon")), float(properties.pop("lat"))
        geometry = {"type": "Point", "coordinates": [lon, lat]}
        features.append({"type": "Feature", "geometry": geometry, "properties": properties})
    path = tmp_path / "x.geojson"
    path.write_text(json.dumps({"type": "FeatureCollection", "features": features}))
    found = read(path)
    assert len(found.sightings) == 20 and found.where[4] == "x.geojson feature 5"
    # a third coordinate is a height over the ellipsoid, as the format has it
    for feature in features:
        feature["geometry"]["coordinates"].append(float(feature["properties"].pop("alt_msl_m")))
    path.write_text(json.dumps({"type": "FeatureCollection", "features": features}))
    assert read(path).is_ellipsoidal
    assert not read(path, geoid_m=47.0).is_ellipsoidal
    assert read(path, geoid_m=47.0).sightings[0].height_m == pytest.approx(found.sightings[0].height_m - 47.0)


def test_a_camera_s_attitude_and_a_pixel_are_a_direction(tmp_path: Path) -> None:
    header = "lat,lon,alt_msl_m,yaw_deg,pitch_deg,roll_deg,u_px,v_px,width,height,hfov_deg"
    right_deg = math.degrees(math.atan(959.5 / 959.5 * math.tan(math.radians(45.0))))
    cells = ["47", "8", "500", "20", "0", "0", "1919", "539.5", "1920", "1080", "90"]
    (one,) = read(written(tmp_path / "x.csv", [cells], header)).sightings
    assert math.degrees(one.azimuth_rad) == pytest.approx(20.0 + right_deg, abs=0.05)
    assert math.degrees(one.elevation_rad) == pytest.approx(0.0, abs=1e-6)
    cells[3:6] = ["-160", "-30", "0"]
    cells[6:8] = ["", ""]
    (one,) = read(written(tmp_path / "x.csv", [cells], header)).sightings
    assert math.degrees(one.azimuth_rad) == pytest.approx(200.0)
    assert math.degrees(one.elevation_rad) == pytest.approx(-30.0)


def test_a_named_picture_in_which_nothing_is_marked_is_no_sighting(tmp_path: Path) -> None:
    header = "picture,lat,lon,alt_msl_m,yaw_deg,pitch_deg,u_px,v_px,width,height,hfov_deg"
    cells = [["P_1.JPG", "47", "8", "500", "20", "0", "", "", "1920", "1080", "90"]]
    cells.append(["P_2.JPG", *cells[0][1:6], "700", "500", *cells[0][8:]])
    found = read(written(tmp_path / "x.csv", cells, header))
    assert found.where == ["x.csv row 3"] and found.notes[0].startswith("x.csv: 1 pictures with nothing marked")
    with pytest.raises(SightingsError, match="nothing is marked in any of 1 pictures"):
        read(written(tmp_path / "x.csv", cells[:1], header))


def changed(cells: list[str], column: str, value: str) -> list[str]:
    i = HEADER.split(",").index(column)
    return [*cells[:i], value, *cells[i + 1 :]]


@pytest.mark.parametrize(
    ("column", "value", "says"),
    [
        ("lat", "nan", "lat 'nan': must be a number that is finite"),
        ("lat", "forty", "lat 'forty': must be a number"),
        ("lat", "147.1", "lat 147.1: must be -90 to 90; lat and lon may be swapped"),
        ("lat", "", "lacks lat"),
        ("alt_msl_m", "", "lacks an altitude"),
        ("alt_msl_m", "60000", "alt_msl_m 60000: must be -500 to 30000; feet go into a column that ends in _ft"),
        ("azimuth_deg", "777", "azimuth_deg 777: must be -360 to 360"),
        ("azimuth_deg", "", "lacks a direction"),
        ("time", "yesterday", "time 'yesterday': must be ISO 8601"),
        ("heading_bias_deg", "-1", "heading_bias_deg -1: must be 0.001 to 90"),
    ],
)
def test_a_bad_row_is_named_and_the_others_are_used(tmp_path: Path, column: str, value: str, says: str) -> None:
    table = rows()
    table[5] = changed(table[5], column, value)
    found = read(written(tmp_path / "x.csv", table))
    (line,) = found.faults
    assert line.startswith("x.csv row 7: ") and says in line
    assert len(found.sightings) == 19
    said, warned = ran(tmp_path / "x.csv")
    assert warned[0] == f"not used: {line}" and "19 of 4 platforms" in said[1]


def test_swapped_coordinates_are_known_by_the_other_rows(tmp_path: Path) -> None:
    table = rows()
    lat, lon = table[5][2:4]
    table[5][2:4] = [lon, lat]
    (line,) = read(written(tmp_path / "x.csv", table)).faults
    assert line.startswith(f"x.csv row 7: lat {float(lon):g}") and "are swapped: the other rows are near 47." in line
    # all of them are: only home tells
    for cells in table:
        cells[2:4] = ["8.1", "47.2"]
    path = written(tmp_path / "all.csv", table)
    assert read(path).faults == []
    with pytest.raises(SightingsError, match=r"none of 20 rows can be used: all.csv row 2: lat 8.1, lon 47.2"):
        read(path, home=(47.0, 8.0))


def test_radians_in_a_column_of_degrees_are_suspected(tmp_path: Path) -> None:
    table = [changed(cells, "azimuth_deg", str(math.radians(float(cells[5])))) for cells in rows()]
    (note,) = read(written(tmp_path / "x.csv", table)).notes
    assert "radians go into azimuth_rad" in note
    good = read(written(tmp_path / "y.csv", table, HEADER.replace("azimuth_deg", "azimuth_rad")))
    assert good.notes == []
    wrong = written(tmp_path / "z.csv", rows(), HEADER.replace("azimuth_deg", "azimuth_rad"))
    with pytest.raises(SightingsError, match="degrees go into azimuth_deg"):
        read(wrong)


def test_what_is_taken_for_granted_is_said(tmp_path: Path) -> None:
    table = [changed(cells, "time", cells[0].removesuffix("+00:00")) for cells in rows()]
    header = HEADER.replace("alt_msl_m", "alt").replace("azimuth_sigma_deg", "colour")
    notes = read(written(tmp_path / "x.csv", table, header)).notes
    assert notes == [
        "x.csv: columns not used: colour",
        "20 altitudes that don't say of what: taken as metres over the sea (alt_msl_m)",
        "20 times without a zone: taken as UTC",
    ]


def test_feet_are_metres_in_their_own_column(tmp_path: Path) -> None:
    table = [changed(cells, "alt_msl_m", str(float(cells[4]) / 0.3048)) for cells in rows()]
    found = read(written(tmp_path / "x.csv", table, HEADER.replace("alt_msl_m", "alt_msl_ft")))
    plain = read(written(tmp_path / "y.csv", rows()))
    assert found.sightings[3].height_m == pytest.approx(plain.sightings[3].height_m, abs=1e-3)


@pytest.mark.parametrize(
    ("content", "says"),
    [
        (b"", "is empty"),
        (b"lat,lon\n", "holds no sightings"),
        (b"\x00\x01\x02", "is no text"),
        (b"lat,lat\n1,2\n", "two columns 'lat'"),
        (b'{"type": "Point"}', "no GeoJSON FeatureCollection"),
        (b"{", "is no JSON"),
        (b"\xff\xfa\xfb", "UTF-"),
        (b"a,b\n1,2\n", "lacks lat and lon"),
    ],
)
def test_a_file_that_is_no_table_is_one_line(tmp_path: Path, content: bytes, says: str) -> None:
    path = tmp_path / "x.csv"
    path.write_bytes(content)
    with pytest.raises(SightingsError, match=says) as caught:
        read(path)
    assert "\n" not in str(caught.value) and "x.csv" in str(caught.value)


def hgt(folder: Path, name: str, height_m: int) -> Path:
    """A tile of SRTM's three seconds that is level."""
    path = folder / name
    path.write_bytes(np.full((1201, 1201), height_m, ">i2").tobytes())
    return path


def test_a_dem_bounds_one_sighting_s_range(tmp_path: Path) -> None:
    header = "lat,lon,alt_msl_m,azimuth_deg,elevation_deg,tilt_bias_deg"
    one = written(tmp_path / "one.csv", [["47.5", "8.5", "700", "90", "-6", "0.1"]], header)
    said, warned = ran(one, dem=hgt(tmp_path, "N47E008.hgt", 400))
    assert warned == [] and "MSL" in said[1] and " km to " in said[1]
    # 300 m down at 6 degrees is 2.85 km away, the DEM's 15 m and the tilt's 0.1 degrees are 5 % and 2 % of that
    low_km, high_km = (float(part.split()[0]) for part in said[1].split("  ")[-2].strip().split(" to "))
    assert 2.4 < low_km < 2.8 and 2.9 < high_km < 3.4


def test_a_dem_of_elsewhere_or_over_the_camera_is_said(tmp_path: Path) -> None:
    one = written(tmp_path / "one.csv", rows()[:1])
    said, warned = ran(one, dem=hgt(tmp_path, "N10E010.hgt", 400))
    assert "has no height at any camera" in warned[0] and "bearing" in said[1]
    table = [["47.5", "8.5", "700", "90", "-6"]]
    high = written(tmp_path / "high.csv", table, "lat,lon,alt_msl_m,azimuth_deg,elevation_deg")
    _, warned = ran(high, dem=hgt(tmp_path, "N47E008.hgt", 1500))
    assert "the DEM has the camera 800 m under the ground" in warned[0]
    table = [["47.5", "8.5", "1312", "90", "-6"]]
    feet = written(tmp_path / "feet.csv", table, "lat,lon,alt_msl_m,azimuth_deg,elevation_deg")
    _, warned = ran(feet, dem=hgt(tmp_path, "N47E008.hgt", 390))
    assert "agree with the DEM if they are feet" in warned[0]


def test_where_nothing_is_located_the_end_says_why(tmp_path: Path) -> None:
    header = "platform,time,lat,lon,alt_msl_m,azimuth_deg"
    crossing = [
        [name, "2026-07-01T10:00:00Z", "47.0", lon, "500", azimuth]
        for name, lon, azimuths in (("a", "8.0", ("30", "50")), ("b", "8.2", ("330", "310")))
        for azimuth in azimuths
    ]
    with pytest.raises(SightingsError, match="no place: lines of sight to several things cross"):
        ran(written(tmp_path / "x.csv", crossing, header))


def test_the_command_line(tmp_path: Path) -> None:
    path = written(tmp_path / "x.csv", rows())
    done = CliRunner().invoke(app, ["locate", str(path), "--ground", "200", "--dem", str(tmp_path)])
    assert done.exit_code == 2
    done = CliRunner().invoke(app, ["locate", str(path), "--ground", "700", "--ground-sigma", "50"])
    assert done.exit_code == 0 and "20 of 4 platforms" in done.stdout


def test_boxes_are_smoke_and_that_is_said(tmp_path: Path) -> None:
    header = "camera,target,lat,lon,azimuth,fov,x0,y0,x1,y1"
    lines = [["c1", "a", "47.0", "8.0", "45", "60", "0.49", "0.4", "0.51", "0.5"]]
    lines += [["c2", "a", "47.0", "8.2", "315", "60", "0.49", "0.4", "0.51", "0.5"]]
    path = written(tmp_path / "boxes.csv", lines, header)
    said, warned = ran(path, out=tmp_path / "out")
    assert any("boxes are taken as about smoke" in line and "--smoke-offset 0" in line for line in warned)
    assert any("smoke is taken to be " in line for line in said)
    (wide,) = json.loads((tmp_path / "out" / "places.geojson").read_bytes())["features"][:1]
    assert wide["properties"]["smoke_offset_m"] >= 200.0
    said, warned = ran(path, out=tmp_path / "marks", smoke_offset_m=0.0)
    assert not any("about smoke" in line or "smoke is taken" in line for line in [*said, *warned])
    told = {
        one: json.loads((tmp_path / one / "places.geojson").read_bytes())["features"][0] for one in ("out", "marks")
    }
    axes = {one: value["properties"]["ellipse95"]["semi_minor_m"] for one, value in told.items()}
    assert axes["out"] > axes["marks"] + 50.0
    said, warned = ran(written(tmp_path / "bearings.csv", rows()), smoke_offset_m=300.0)
    assert any("smoke is taken to be " in line for line in said)


def test_two_towers_against_one_are_disputed_aloud(tmp_path: Path) -> None:
    header = "platform,target,lat,lon,bearing_deg,heading_bias_deg"
    lines = [["a", "oak", "47.0", "8.0", "45", "0.5"], ["b", "oak", "47.0", "8.2", "315", "0.5"]]
    path = written(tmp_path / "three.csv", [*lines, ["c", "oak", "47.15", "8.0", "100", "0.5"]], header)
    said, _ = ran(path, out=tmp_path / "out")
    assert any(line.startswith("oak DISPUTED") for line in said)
    assert any("a and b agree, c looks elsewhere" in line for line in said)
    features = json.loads((tmp_path / "out" / "places.geojson").read_bytes())["features"]
    places = [one["properties"] for one in features if one["properties"]["kind"] == "place"]
    assert len(places) > 1 and all(one["state"] == "disputed" and one["against"] for one in places)
    assert b"fire oak DISPUTED" in (tmp_path / "out" / "places.kml").read_bytes()
    said, _ = ran(written(tmp_path / "two.csv", lines, header))
    assert not any("DISPUTED" in line for line in said)


def test_processes_change_nothing(tmp_path: Path) -> None:
    """From 1,500 sightings of 8 targets on the work is shared."""
    lines = [[*row(one)[:-2], "0.1", "3", f"t{number}"] for number in range(8) for one in looks(number)]
    path = written(tmp_path / "many.csv", lines, f"{HEADER},target")
    said: dict[int, list[str]] = {1: [], 2: []}
    for jobs, told in said.items():
        run_locate([path], Wanted(out=tmp_path / str(jobs)), told.append, lambda line: None, jobs)
    files = [(tmp_path / str(jobs) / "places.geojson").read_bytes() for jobs in said]
    assert len(lines) >= 1500 and files[0] == files[1]
    assert said[1][:-1] == said[2][:-1]


def looks(number: int) -> list[Sighting]:
    rng = np.random.default_rng([8, number])
    return of_towers(Towers.drawn(rng, 4), rng, 47)
