"""`distloc study fires` from tables to tables, and what it says of those that are wrong."""

import csv
import json
import math
import re
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from distloc.geometry.geodesy import LocalFrame
from service.commands.cli import app
from service.commands.study.ignitions.run import Nominal, run_fires
from service.recordings.sightings.reading import SightingsError
from service.recordings.sightings.wanted import Wanted
from tests.support.places import ROOT
from tests.support.tower_networks import Season, season

HEADER = "fire,time,camera,lat,lon,alt_msl_m,bearing_deg,bearing_sigma_deg"
IGNITION_HEADER = "fire,lat,lon,sigma_m"


def tables(seed: int = 0, fires: int = 6) -> tuple[list[str], list[str]]:
    """A network's sightings and ignitions as rows."""
    rows, places = [], []
    for fire in season(np.random.default_rng([31, seed]), Season(fires=fires, looks=3)):
        assert fire.ignition is not None
        places.append(f"{fire.name},{fire.ignition.lat_deg:.6f},{fire.ignition.lon_deg:.6f},150")
        for one in fire.sightings:
            at = f"{one.lat_deg:.6f},{one.lon_deg:.6f},{one.height_m:.0f}"
            angles = f"{math.degrees(one.azimuth_rad):.3f},{math.degrees(one.sigma_rad[0]):.3f}"
            rows.append(f"{fire.name},{1.78e9 + (one.stamp_s or 0.0):.0f},{one.platform},{at},{angles}")
    return rows, places


def written(path: Path, header: str, rows: list[str]) -> Path:
    path.write_text("\n".join([header, *rows]) + "\n", encoding="utf-8")
    return path


def ran(sightings: Path, ignitions: Path | None, out: Path, **wanted: object) -> tuple[list[str], list[str]]:
    said: list[str] = []
    warned: list[str] = []
    nominal = Nominal(float(wanted.pop("heading_bias_deg", 3.0)), 1.0, float(wanted.pop("smoke_offset_m", 200.0)))  # type: ignore[arg-type]
    run_fires([sightings], ignitions, Wanted(out=out, **wanted), nominal, said.append, warned.append)  # type: ignore[arg-type]
    return said, warned


def test_fires_are_scored_both_ways_and_written(tmp_path: Path) -> None:
    rows, places = tables()
    sightings, ignitions = (
        written(tmp_path / "s.csv", HEADER, rows),
        written(tmp_path / "i.csv", IGNITION_HEADER, places),
    )
    said, warned = ran(sightings, ignitions, tmp_path / "out")
    assert warned == []
    assert sum(line.startswith("fire") and "located" in line for line in said) >= 4
    assert any(line.startswith("nominal    the 95 % region holds the ignition of ") for line in said)
    assert any(line.startswith("estimated  the 95 % region holds the ignition of ") for line in said)
    lines = list(csv.DictReader((tmp_path / "out/fires.csv").read_text(encoding="utf-8").splitlines()))
    assert len(lines) == 2 * len(places)
    for line in lines:
        if line["answer"] != "located":
            continue
        lat, lon = next(map(float, one.split(",")[1:3]) for one in places if one.startswith(line["fire"] + ","))
        east_m, north_m, _ = LocalFrame(float(line["lat"]), float(line["lon"]), 0.0).enu_from_geodetic(lat, lon, 0.0)
        assert math.hypot(east_m, north_m) == pytest.approx(float(line["error_m"]), abs=15.0)
        area = math.pi * float(line["semi_major_m"]) * float(line["semi_minor_m"]) / 1e6
        assert area == pytest.approx(float(line["area_km2"]), rel=0.01)
    content = json.loads((tmp_path / "out/fires.json").read_bytes())
    assert content["overall"]["nominal"]["fires"] == len(places)
    biases = list(csv.DictReader((tmp_path / "out/biases.csv").read_text(encoding="utf-8").splitlines()))
    assert {one["platform"] for one in biases} == {row.split(",")[2] for row in rows}


def test_the_ignition_may_stand_beside_each_sighting(tmp_path: Path) -> None:
    rows, places = tables()
    of = {place.split(",")[0]: place.split(",", 1)[1] for place in places}
    beside = [f"{row},{of[row.split(',')[0]]}" for row in rows]
    header = f"{HEADER},ignition_lat,ignition_lon,ignition_sigma_m"
    said, warned = ran(written(tmp_path / "s.csv", header, beside), None, tmp_path / "a")
    apart = ran(
        written(tmp_path / "t.csv", HEADER, rows), written(tmp_path / "i.csv", IGNITION_HEADER, places), tmp_path / "b"
    )
    assert warned == [] and said[:-1] == apart[0][:-1]


def test_a_fire_s_own_ignition_never_tells_its_biases(tmp_path: Path) -> None:
    """Moved far away, it changes its own score and not its own place."""
    rows, places = tables()
    sightings = written(tmp_path / "s.csv", HEADER, rows)
    ran(sightings, written(tmp_path / "i.csv", IGNITION_HEADER, places), tmp_path / "a")
    name, lat, lon, sigma = places[0].split(",")
    moved = [f"{name},{float(lat) + 0.3},{lon},{sigma}", *places[1:]]
    ran(sightings, written(tmp_path / "j.csv", IGNITION_HEADER, moved), tmp_path / "b")
    first, second = (
        {
            (row["fire"], row["biases"]): row
            for row in json.loads((tmp_path / folder / "fires.json").read_bytes())["fires"]
        }
        for folder in "ab"
    )
    for way in ("nominal", "estimated"):
        for key in ("lat", "lon", "area_km2"):
            assert first[name, way][key] == second[name, way][key]
        assert second[name, way]["error_m"] > 25e3


def test_what_is_wrong_is_one_line(tmp_path: Path) -> None:
    rows, places = tables()
    sightings = written(tmp_path / "s.csv", HEADER, [*rows, f",{rows[0].split(',', 1)[1]}"])
    name, lat, lon, sigma = places[0].split(",")
    bad = [
        *places[1:],
        f"{name},{lon},{lat},{sigma}",
        f"{places[1].split(',')[0]},{lat},{lon},{sigma}",
        f"nowhere,{lat},{lon},{sigma}",
        f"x,91,{lon},1",
        f"y,{lat},{lon},-1",
        f",{lat},{lon},1",
        "z,nan,8,1",
    ]
    _, warned = ran(sightings, written(tmp_path / "i.csv", IGNITION_HEADER, bad), tmp_path / "out")
    text = "\n".join(warned)
    assert all("\n" not in line for line in warned)
    for says in (
        "1 sightings without a fire, the first is s.csv row",
        "are swapped: its first camera is near",
        "begins elsewhere than an earlier row says",
        "fire 'nowhere': an ignition and no sightings",
        "row 10: lat 91: must be -90 to 90",
        "ignition_sigma_m '-1': must be metres",
        "has an ignition and no fire's name",
        "lat 'nan': must be a number that is finite",
    ):
        assert says in text, says


def test_without_an_ignition_there_is_nothing_to_score(tmp_path: Path) -> None:
    rows, places = tables()
    sightings = written(tmp_path / "s.csv", HEADER, rows)
    with pytest.raises(SightingsError, match="no fire has a known ignition: give --ignitions"):
        ran(sightings, None, tmp_path / "out")
    other = written(tmp_path / "i.csv", IGNITION_HEADER, [place.replace("fire", "blaze") for place in places])
    with pytest.raises(SightingsError, match="are their names the same"):
        ran(sightings, other, tmp_path / "out")


def test_the_tables_that_the_page_shows_are_taken(tmp_path: Path) -> None:
    page = (ROOT / "docs/study-fires.md").read_text(encoding="utf-8")
    (shown,) = re.findall(r"```\n(fire,time,.*?)```", page, re.DOTALL)
    header, *rows = shown.strip().splitlines()
    ignitions = written(tmp_path / "i.csv", IGNITION_HEADER, ["oak,33.55,-117.14,100"])
    said, warned = ran(written(tmp_path / "s.csv", header, rows), ignitions, tmp_path / "out")
    assert any("azimuth beside a box: taken as the camera's" in line for line in warned)
    assert any(re.match(r"oak +2  located .* yes", line) for line in said), said


def ridge(folder: Path, height_m: int) -> Path:
    """A tile of level land with a ridge from north to south, 3 km east of 8.5 degrees."""
    heights = np.full((1201, 1201), 100, ">i2")
    column = round(1200 * (0.5 + 3000.0 / (111_320.0 * math.cos(math.radians(47.5)))))
    heights[:, column - 2 : column + 3] = height_m
    path = folder / "N47E008.hgt"
    path.write_bytes(heights.tobytes())
    return path


def test_with_a_dem_the_region_reaches_behind_the_crest_that_hides_the_fire(tmp_path: Path) -> None:
    """One tower sees smoke over a crest 3 km away; the fire is behind it, or the crest is not as it was thought."""
    at = LocalFrame(47.5, 8.5, 700.0)
    crest_deg = math.degrees(math.atan2(400.0 - 700.0, 3000.0))
    header = f"{HEADER},elevation_deg,elevation_sigma_deg,heading_bias_deg,tilt_bias_deg"
    rows = [f"f,{1.78e9 + 60 * i:.0f},a,47.5,8.5,700,90,0.1,{crest_deg + 0.05},0.1,0.5,0.2" for i in range(4)]
    sightings = written(tmp_path / "s.csv", header, rows)
    lat, lon, _ = at.geodetic_from_enu(np.array([4500.0, 0.0, -600.0]))
    ignitions = written(tmp_path / "i.csv", IGNITION_HEADER, [f"f,{lat},{lon},0"])
    said, _ = ran(sightings, ignitions, tmp_path / "bare")
    assert any("bearing" in line for line in said) and any("none of 1 fires located" in line for line in said)
    _, warned = ran(sightings, ignitions, tmp_path / "dem", dem=ridge(tmp_path, 400))
    assert warned == []
    (row, _) = json.loads((tmp_path / "dem/fires.json").read_bytes())["fires"]
    assert row["holds"] is True and row["semi_major_m"] > 1000.0
    (tmp_path / "flat").mkdir()
    ran(sightings, ignitions, tmp_path / "level", dem=ridge(tmp_path / "flat", 100))
    (level, _) = json.loads((tmp_path / "level/fires.json").read_bytes())["fires"]
    assert level["lon"] > row["lon"] and level["holds"] is False  # without a crest it is where the line meets the land


def test_the_command_line(tmp_path: Path) -> None:
    rows, places = tables(fires=3)
    sightings, ignitions = (
        written(tmp_path / "s.csv", HEADER, rows),
        written(tmp_path / "i.csv", IGNITION_HEADER, places),
    )
    command = ["study", "fires", str(sightings), "--ignitions", str(ignitions), "--out", str(tmp_path / "out")]
    done = CliRunner().invoke(app, command)
    assert done.exit_code == 0, done.output
    assert "wrote" in done.stdout
    assert CliRunner().invoke(app, [*command, "--heading-bias", "0"]).exit_code == 2
