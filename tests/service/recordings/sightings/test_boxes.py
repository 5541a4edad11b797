"""A detector's box, however its edges are named, is one sighting of the smoke's foot."""

import math
from pathlib import Path

import pytest

from service.recordings.sightings.boxes import box_of
from service.recordings.sightings.columns import RowError
from service.recordings.sightings.reading import read_table
from service.recordings.sightings.rows import Sightings, sightings_of

LENS = "lat,lon,alt_msl_m,yaw_deg,pitch_deg,fov,image_width,image_height"
CAMERA = "33.1,-116.8,1200,90,-2,60,3072,2048"


def read(tmp_path: Path, header: str, *rows: str) -> Sightings:
    path = tmp_path / "x.csv"
    path.write_text("\n".join([header, *rows]) + "\n", encoding="utf-8")
    return sightings_of([read_table(path)], None, None, None)


@pytest.mark.parametrize(
    ("names", "cells"),
    [
        ("x_min,y_min,x_max,y_max", "1000,900,1200,1010"),
        ("xmin,ymin,xmax,ymax", "1000,900,1200,1010"),
        ("x0,y0,x1,y1", "1000,900,1200,1010"),
        ("x1,y1,x2,y2", "1000,900,1200,1010"),
        ("left,top,right,bottom", "1000,900,1200,1010"),
        ("x,y,w,h", "1000,900,200,110"),
        ("x,y,width,height", "1000,900,200,110"),
        ("cx,cy,w,h", "1100,955,200,110"),
        ("bbox", '"[1000, 900, 1200, 1010]"'),
        ("bboxes", '"[(5, 5, 9, 9, 0.2), (1000, 900, 1200, 1010, 0.8)]"'),
        ("xmin,ymin,xmax,ymax", f"{1000.5 / 3072},{900.5 / 2048},{1200.5 / 3072},{1010.5 / 2048}"),
    ],
)
def test_the_foot_of_the_box_is_where_it_looks(tmp_path: Path, names: str, cells: str) -> None:
    found = read(tmp_path, f"{LENS},{names}", f"{CAMERA},{cells}")
    assert found.faults == []
    (one,) = found.sightings
    f = 1536.0 / math.tan(math.radians(30.0))
    assert math.degrees(one.azimuth_rad) == pytest.approx(90.0 + math.degrees(math.atan((1100 - 1535.5) / f)), abs=0.02)
    below_deg = math.degrees(math.atan2((1010 - 1023.5) / f, math.hypot(1.0, (1100 - 1535.5) / f)))
    assert math.degrees(one.elevation_rad) == pytest.approx(-2.0 - below_deg, abs=0.05)
    assert one.sigma_rad[0] == pytest.approx(math.hypot(200.0 / math.sqrt(12.0), 3.0) / f, rel=0.01)


def test_a_box_of_shares_and_a_camera_s_azimuth_are_a_bearing(tmp_path: Path) -> None:
    """As towers' detectors report: no size of the picture, no pitch, no altitude."""
    found = read(tmp_path, "camera,lat,lon,azimuth,fov,x0,y0,x1,y1", "c1,33.1,-116.8,180,90,0.70,0.4,0.80,0.5")
    (one,) = found.sightings
    expected_deg = 180.0 + math.degrees(math.atan(0.5 * math.tan(math.radians(45.0))))
    assert math.degrees(one.azimuth_rad) == pytest.approx(expected_deg, abs=0.02)
    assert one.sigma_rad[1] == pytest.approx(math.radians(10.0))
    assert any("azimuth beside a box: taken as the camera's" in line for line in found.notes)
    assert any("bearings without an altitude" in line for line in found.notes)


def test_a_bearing_beside_a_box_is_the_smoke_s(tmp_path: Path) -> None:
    found = read(tmp_path, "lat,lon,alt,azimuth,bearing,fov,x0,y0,x1,y1", "33,-116,9,180,200,90,0.7,0.4,0.8,0.5")
    assert math.degrees(found.sightings[0].azimuth_rad) == pytest.approx(200.0)


def test_a_fisheye_looks_elsewhere_at_its_edge(tmp_path: Path) -> None:
    row = "33.1,-116.8,1200,90,-2,110,3072,2048,3000,900,3060,1010,{}"
    header = f"{LENS},x0,y0,x1,y1,lens"
    flat, round_ = (read(tmp_path, header, row.format(lens)).sightings[0] for lens in ("rectilinear", "fisheye"))
    beside_deg = 110.0 * (3030.0 - 1535.5) / 3072.0
    assert math.degrees(round_.azimuth_rad) == pytest.approx(90.0 + beside_deg, abs=0.3)
    assert abs(flat.azimuth_rad - round_.azimuth_rad) < math.radians(1.0)  # the same at the very edge and in the middle
    assert "must be rectilinear or fisheye" in str(_fault(tmp_path, header, row.format("wide")))


def test_a_pitch_that_nobody_measured_tells_no_elevation(tmp_path: Path) -> None:
    rows = [f"33.1,-116.8,1200,{yaw},0,60,3072,2048,1000,900,1200,1010" for yaw in (0, 90, 180)]
    found = read(tmp_path, f"{LENS},x0,y0,x1,y1", *rows)
    assert any("pitch_deg is 0 in all rows with boxes" in line for line in found.notes)
    assert all(one.sigma_rad[1] == pytest.approx(math.radians(10.0)) for one in found.sightings)


def _fault(tmp_path: Path, header: str, row: str) -> Exception:
    with pytest.raises(Exception, match="none of 1 rows") as caught:
        read(tmp_path, header, row)
    return caught.value


@pytest.mark.parametrize(
    ("numbers", "text", "says"),
    [
        ({"x0": 10.0, "y0": 10.0, "x1": 5.0, "y1": 20.0}, None, "must be beyond the others"),
        ({"w": 10.0, "h": 10.0}, None, "not its upper left corner"),
        ({}, "1,2,3", "must be x_min, y_min, x_max, y_max"),
        ({}, "9" * 20_000, "must be x_min"),
        ({}, "", "must be x_min"),
    ],
)
def test_what_is_no_box_is_refused(numbers: dict[str, float], text: str | None, says: str) -> None:
    with pytest.raises(RowError, match=says):
        box_of(numbers, text)


def test_a_box_outside_its_picture_is_named(tmp_path: Path) -> None:
    error = _fault(tmp_path, f"{LENS},x0,y0,x1,y1", f"{CAMERA},4000,900,4200,1010")
    assert "the box's foot 4100, 1010: must lie in the picture of 3072 x 2048" in str(error)
