"""What a DEM's numbers mean, what is passed over, and when a DEM is not believed."""

import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from distloc.filter.ground import FlatGround, GridGround, Ground
from distloc.geometry.geodesy import LocalFrame
from service.autopilot.autopilot import Autopilot
from service.commands.check.dem import check_dem, check_dem_there
from service.config.sections import GroundConfig, MavlinkConfig, MountConfig
from service.localise.ground_prior import GroundKeeper, Told, known_of, make_ground
from service.localise.terrain.belief import Known
from service.localise.terrain.dem import DemError, GeoidUnknownError, ground_from_dem, open_dem
from service.mavlink.framer import Framer
from tests.service.localise.test_dem import SCALE, TIE, UTM32, at, doubles, geokeys, nodata, write_hgt, write_tif

FRAME = LocalFrame(47.5, 8.5, 520.0)
WGS84 = geokeys(2, 4326)


def gdal(*items: tuple[str, str]) -> tuple[int, str, int, str, bool]:
    lines = "".join(f'<Item name="{key.upper()}" sample="0" role="{key}">{value}</Item>' for key, value in items)
    return (42112, "s", 0, f"<GDALMetadata>{lines}</GDALMetadata>", True)


def level(number: float, kind: Any = np.float32) -> NDArray[Any]:
    return np.full((100, 100), number, kind)


def height_m(path: Path, undulation_m: float | None = None) -> float | None:
    ground = ground_from_dem(path, FRAME, 15.0, nodes=101, undulation_m=undulation_m)
    return at(ground, FRAME, 47.51, 8.51, 500.0)


@pytest.mark.parametrize(
    ("number", "kind", "tags"),
    [
        (5000, np.int16, (WGS84, gdal(("scale", "0.1")))),
        (100, np.uint8, (WGS84, gdal(("scale", "2.5"), ("offset", "250")))),
        (4000, np.uint16, (WGS84, gdal(("offset", "-3500")))),
        (500 / 0.3048, np.float32, (WGS84, gdal(("unittype", "ft")))),
        (500 / 0.3048, np.float32, (geokeys(2, 4326, 1, 4099, 0, 1, 9002),)),
        (500 * 3937 / 1200, np.float32, (geokeys(2, 4326, 1, 4099, 0, 1, 9003),)),
        (500 * 3937 / 1200, np.float32, (geokeys(2, 4326, 1, 4096, 0, 1, 6360),)),
        (500, np.float32, (geokeys(2, 4326, 1, 4096, 0, 1, 5773),)),
        (500, np.float32, (WGS84, gdal(("description", "band 1")))),
    ],
)
def test_numbers_are_turned_to_metres(tmp_path: Path, number: float, kind: Any, tags: tuple[Any, ...]) -> None:
    path = write_tif(tmp_path / "dem.tif", level(number, kind), SCALE, TIE, *tags)
    assert height_m(path) == pytest.approx(500.0, abs=0.05)


@pytest.mark.parametrize(("void", "tags"), [(1000, (nodata("1000"),)), (-32768, ())])
def test_a_void_is_a_number_before_the_scale(void: int, tags: tuple[Any, ...], tmp_path: Path) -> None:
    """Also one that no tag tells: scaled, it would be land below the sea."""
    heights = level(5000, np.int16)
    heights[40:60, 40:60] = void
    path = write_tif(tmp_path / "dem.tif", heights, WGS84, SCALE, TIE, gdal(("scale", "0.01")), *tags)
    assert height_m(path) is None


def test_what_gdal_keeps_beside_the_file_is_read(tmp_path: Path) -> None:
    path = write_tif(tmp_path / "dem.tif", level(5000, np.int16), WGS84, SCALE, TIE)
    band = '<PAMRasterBand band="1"><Offset>0</Offset><Scale>0.1</Scale></PAMRasterBand>'
    (tmp_path / "dem.tif.aux.xml").write_text(f"<PAMDataset>{band}</PAMDataset>")
    assert height_m(tmp_path) == height_m(path) == pytest.approx(500.0, abs=0.05)


@pytest.mark.parametrize("keys", [geokeys(2, 4979), geokeys(2, 4937), geokeys(2, 4326, 1, 4096, 0, 1, 5030)])
def test_heights_over_the_ellipsoid_want_the_geoid(tmp_path: Path, keys: Any) -> None:
    path = write_tif(tmp_path / "dem.tif", level(547.0), keys, SCALE, TIE)
    assert height_m(path, undulation_m=47.0) == pytest.approx(500.0, abs=0.05)
    with pytest.raises(GeoidUnknownError, match=r"dem.tif: heights over the ellipsoid: the autopilot must tell"):
        height_m(path)


@pytest.mark.parametrize("code", [4326, 4258, 4979])
def test_longitudes_from_0_to_360_of_any_datum(tmp_path: Path, code: int) -> None:
    tie = doubles(33922, 0, 0, 0, 350.0, 48.0, 0.0)
    path = write_tif(tmp_path / "dem.tif", level(44.0), geokeys(2, code), SCALE, tie)
    frame = LocalFrame(47.5, -9.5, 0.0)
    ground = ground_from_dem(path, frame, 15.0, nodes=101, undulation_m=0.0)
    assert at(ground, frame, 47.6, -9.7, 44.0) == pytest.approx(44.0, abs=0.1)


@pytest.mark.parametrize(
    ("heights", "tags", "says"),
    [
        (level(180, np.uint8), (WGS84,), "is uint8, a picture (a hillshade?) and no heights"),
        (np.zeros((8, 8, 3), np.uint8), (WGS84,), "one band of numbers"),
        (np.zeros((8, 8, 4), np.uint16), (WGS84,), "one band of numbers"),
        (level(1), (WGS84, gdal(("scale", "lots"))), "GDAL's SCALE is 'lots': a number is needed"),
        (level(1), (WGS84, gdal(("scale", "0"))), "GDAL's SCALE is 0"),
        (level(1), (WGS84, gdal(("unittype", "fathom"))), "heights in unit 'fathom': metres or feet"),
        (level(1), (geokeys(2, 4326, 1, 4099, 0, 1, 9001), gdal(("unittype", "ft"))), "one of them is wrong"),
        (level(1), (geokeys(2, 4326, 1, 4096, 0, 1, 5715),), "'MSL depth' counts depths"),
        (level(1), (geokeys(2, 4326, 1, 4096, 0, 1, 9),), "its vertical CRS is EPSG:9, which is not known"),
    ],
)
def test_what_are_no_heights_is_refused_by_name(
    tmp_path: Path, heights: NDArray[Any], tags: tuple[Any, ...], says: str
) -> None:
    path = write_tif(tmp_path / "dem.tif", heights, SCALE, TIE, *tags)
    with pytest.raises(DemError) as caught:
        open_dem(path)
    assert says in str(caught.value) and str(path) in str(caught.value) and "\n" not in str(caught.value)


def _cut(path: Path) -> None:
    noise = np.random.default_rng(1).integers(400, 600, (100, 100)).astype(np.int16)
    write_tif(path, noise, WGS84, SCALE, TIE, compression="deflate")
    path.write_bytes(path.read_bytes()[:-3000])


def _codec(path: Path) -> None:
    write_tif(path, level(500.0), WGS84, SCALE, TIE)
    content = bytearray(path.read_bytes())
    at_tag = content.find((259).to_bytes(2, "little") + (3).to_bytes(2, "little"))
    content[at_tag + 8 : at_tag + 10] = (65000).to_bytes(2, "little")
    path.write_bytes(content)


@pytest.mark.parametrize("spoil", [_cut, _codec])
def test_what_cannot_be_read_through_is_said_before_the_flight(tmp_path: Path, spoil: Callable[[Path], None]) -> None:
    spoil(tmp_path / "dem.tif")
    (finding,) = check_dem(GroundConfig(kind="dem", path=str(tmp_path / "dem.tif")))
    assert finding.level == "fail" and "dem.tif: its heights can't be read" in finding.said


def test_a_file_that_is_broken_inside_is_said_by_the_doctor(tmp_path: Path) -> None:
    with zipfile.ZipFile(tmp_path / "N12E008.hgt.zip", "w") as archive:
        archive.writestr("N12E008.hgt", bytes(2 * 1201**2))
    content = bytearray((tmp_path / "N12E008.hgt.zip").read_bytes())
    content[1000] ^= 1
    (tmp_path / "N12E008.hgt.zip").write_bytes(content)
    (finding,) = check_dem(GroundConfig(kind="dem", path=str(tmp_path / "N12E008.hgt.zip")))
    assert finding.level == "fail" and "its heights can't be read" in finding.said


def test_a_folder_is_read_without_what_is_no_dem(tmp_path: Path) -> None:
    write_tif(tmp_path / "a_hillshade.tif", level(180, np.uint8), WGS84, SCALE, TIE)
    (tmp_path / "._dem.tif").write_bytes(b"\0\5\26\7" * 30)
    _cut(tmp_path / "cut.tif")
    write_tif(tmp_path / "dem.tif", level(500.0), WGS84, SCALE, TIE)
    assert height_m(tmp_path) == pytest.approx(500.0, abs=0.05)
    levels = [
        (one.level, one.said.split(": ")[1]) for one in check_dem(GroundConfig(kind="dem", path=str(tmp_path)))[1:]
    ]
    assert levels == [("warn", str(tmp_path / name)) for name in ("._dem.tif", "a_hillshade.tif", "cut.tif")]
    told = Told()
    config = GroundConfig(kind="dem", path=str(tmp_path))
    assert isinstance(make_ground(config, FRAME, 500.0, told), GridGround)
    assert len(told.files) == 3 and not told.reasons
    (tmp_path / "dem.tif").unlink()
    with pytest.raises(DemError, match="holds no DEM that can be used"):
        open_dem(tmp_path)


def test_a_zip_of_macos_holds_one_tile(tmp_path: Path) -> None:
    write_hgt(tmp_path / "N47E008.hgt", 1201)
    with zipfile.ZipFile(tmp_path / "N47E008.hgt.zip", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.write(tmp_path / "N47E008.hgt", "N47E008.hgt")
        archive.writestr("__MACOSX/._N47E008.hgt", b"\0\5\26\7")
    assert height_m(tmp_path / "N47E008.hgt.zip") is not None


def _believed(heights_m: float, tmp_path: Path, known: Known, frame: LocalFrame = FRAME) -> tuple[Ground, Told]:
    path = write_tif(tmp_path / "dem.tif", level(heights_m), WGS84, SCALE, TIE)
    told = Told()
    return make_ground(GroundConfig(kind="dem", path=str(path)), frame, known.home_alt_msl_m, told, known), told


@pytest.mark.parametrize("home", [(47.5, 8.5), (47.55, 8.6), None])
@pytest.mark.parametrize("off_m", [-4500.0, -300.0, -48.0, 48.0, 300.0, 1640.0])
def test_a_dem_that_is_off_home_is_not_believed(tmp_path: Path, off_m: float, home: tuple[float, float] | None) -> None:
    ground, told = _believed(max(500.0 + off_m, -450.0), tmp_path, Known(500.0, home))
    assert isinstance(ground, FlatGround) and ground.sigma_m == 30.0
    assert dict(told.reasons) == {"dem_not_at_home": 1} and "altitude is 500 m" in told.files[0]


@pytest.mark.parametrize("off_m", [-30.0, 0.0, 30.0])
@pytest.mark.parametrize("home", [(47.5, 8.5), (10.0, 10.0), None])
def test_a_dem_that_agrees_with_home_is_believed(
    tmp_path: Path, off_m: float, home: tuple[float, float] | None
) -> None:
    ground, told = _believed(500.0 + off_m, tmp_path, Known(500.0, home, np.zeros(3)))
    assert isinstance(ground, GridGround) and not told.reasons and not told.files


def test_home_in_the_valley_of_hills_is_believed_from_the_air(tmp_path: Path) -> None:
    heights = level(500.0)
    heights[:, :50] = 1500.0  # the west is high
    path = write_tif(tmp_path / "dem.tif", heights, WGS84, SCALE, TIE)
    frame, told = LocalFrame(47.5, 8.45, 1700.0), Told()
    ground = make_ground(GroundConfig(kind="dem", path=str(path)), frame, 500.0, told, Known(500.0, None, np.zeros(3)))
    assert isinstance(ground, GridGround) and not told.reasons


class Flown:
    """An autopilot that has told a position at 600 m, 100 m over home."""

    def __init__(self) -> None:
        self.autopilot = Autopilot(MavlinkConfig(), MountConfig())
        self.now_ns = 1_000_000_000
        self.hear(mavlink.MAVLink_heartbeat_message(2, 3, 0, 0, 4, 3))
        for _ in range(2):
            self.hear(mavlink.MAVLink_gps_raw_int_message(0, 3, 475000000, 85000000, 600_000, 80, 120, 0, 0, 14))
            place = (self.now_ns // 1_000_000, 475000000, 85000000, 600_000, 100_000)
            self.hear(mavlink.MAVLink_global_position_int_message(*place, 0, 0, 0, 0))

    def hear(self, message: Any) -> None:
        (frame,) = Framer().feed(bytes(message.pack(mavlink.MAVLink(None, 1, 1))))
        self.autopilot.receive(frame, self.now_ns)
        self.now_ns += 50_000_000

    def geoid(self, alt_ellipsoid_mm: int = 647_000) -> None:
        more = {"alt_ellipsoid": alt_ellipsoid_mm}
        self.hear(mavlink.MAVLink_gps_raw_int_message(0, 3, 475000000, 85000000, 600_000, 80, 120, 0, 0, 14, **more))


def test_an_ellipsoidal_dem_is_used_once_the_geoid_is_told(tmp_path: Path) -> None:
    path = write_tif(tmp_path / "dem.tif", level(547.0), geokeys(2, 4979), SCALE, TIE)
    flown, got = Flown(), list[Ground]()
    keeper = GroundKeeper(GroundConfig(kind="dem", path=str(path)), flown.autopilot, got.append)
    for _ in range(2):
        keeper.ask(np.zeros(3))
    assert [type(one) for one in got] == [FlatGround] and dict(keeper.reasons) == {"dem_geoid_unknown": 1}
    flown.geoid()
    for _ in range(2):
        keeper.ask(np.zeros(3))
    assert [type(one) for one in got] == [FlatGround, GridGround]
    assert at(got[1], LocalFrame(47.5, 8.5, 600.0), 47.5, 8.5, 500.0) == pytest.approx(500.0, abs=0.1)


@pytest.mark.parametrize("alt_ellipsoid_mm", [0, 600_000, 1, 6_000_000])
def test_a_receiver_that_knows_no_geoid_tells_none(alt_ellipsoid_mm: int) -> None:
    flown = Flown()
    flown.geoid(alt_ellipsoid_mm)
    assert known_of(flown.autopilot, None).undulation_m is None


def test_a_dem_that_has_the_craft_under_the_ground_is_given_up(tmp_path: Path) -> None:
    heights = level(500.0)
    heights[:, 52:] = 900.0  # a wall that is not there
    path = write_tif(tmp_path / "dem.tif", heights, WGS84, SCALE, TIE)
    flown, got = Flown(), list[Ground]()
    keeper = GroundKeeper(GroundConfig(kind="dem", path=str(path)), flown.autopilot, got.append)
    for east_m in (0.0, 500.0, 4000.0, 5000.0, 0.0):
        keeper.ask(np.array([east_m, 0.0, 0.0]))
    assert [type(one) for one in got] == [GridGround, FlatGround]
    told: dict[str, Any] = keeper.counters()
    assert (told["used"], told["reasons"]) == ("flat", {"dem_above_craft": 1})
    assert told["files"] == [
        f"{path}: has the craft 299 m under the ground: heights in metres above the sea are needed"
    ]


@pytest.mark.parametrize(("height", "word"), [(500.0, "agrees"), (4500.0, "dem_not_at_home")])
def test_the_doctor_holds_the_dem_against_home(tmp_path: Path, height: float, word: str) -> None:
    path = write_tif(tmp_path / "dem.tif", level(height), WGS84, SCALE, TIE)
    (finding,) = check_dem_there(GroundConfig(kind="dem", path=str(path)), Flown().autopilot)
    assert word in finding.said and finding.level == ("ok" if word == "agrees" else "fail")


def test_a_compound_crs_is_read_in_its_plane(tmp_path: Path) -> None:
    tags = geokeys(1, 5555), doubles(33550, 500, 500, 0), doubles(33922, 0, 0, 0, 440_000.0, 5_300_000.0, 0)
    path = write_tif(tmp_path / "dem.tif", level(500.0), *tags)
    assert open_dem(path)[0].epsg == 25832 != UTM32 and height_m(path) == pytest.approx(500.0, abs=0.05)
