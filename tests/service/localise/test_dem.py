"""DEM files to a grid in the local axes: both SRTM sizes, GeoTIFFs, real tiles, broken files, the fallbacks."""

import sys
import zipfile
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tifffile
from numpy.typing import NDArray
from pymavlink import mavutil
from pyproj import Transformer

from distloc.filter.ground import FlatGround, GridGround, Ground, NoGround
from distloc.geometry.geodesy import LocalFrame
from service.config.load import check
from service.config.sections import Config, ConfigError, GroundConfig
from service.localise.ground_prior import make_ground
from service.localise.terrain.dem import DemError, ground_from_dem, open_dem
from tests.support.places import DATA

needs_data = pytest.mark.skipif(not DATA.is_dir(), reason="no DEM beside the repository")
FRAME = LocalFrame(47.5, 8.5, 400.0)
UTM32 = 32632


def at(ground: Ground, frame: LocalFrame, lat_deg: float, lon_deg: float, guess_m: float) -> float | None:
    """The ground's height above the sea under a place, by way of the frame; None where it is not known."""
    east, north, _ = frame.enu_from_geodetic(lat_deg, lon_deg, guess_m)
    up, known = ground.heights_m(np.array([east]), np.array([north]))
    return frame.geodetic_from_enu(np.array([east, north, up[0]]))[2] if known[0] else None


def plane(lat_deg: Any, lon_deg: Any) -> Any:
    return 500.0 + 300.0 * (lat_deg - 47.5) - 200.0 * (lon_deg - 8.5)


def write_hgt(path: Path, nodes: int, corner: tuple[int, int] = (47, 8)) -> NDArray[Any]:
    lat = np.linspace(corner[0] + 1, corner[0], nodes)[:, None]
    lon = np.linspace(corner[1], corner[1] + 1, nodes)
    heights = np.round(plane(lat, lon)).astype(">i2")
    path.write_bytes(heights.tobytes())
    return heights


def geokeys(model: int, code: int, raster: int = 1, *more: int) -> tuple[int, str, int, tuple[int, ...], bool]:
    name = 3072 if model == 1 else 2048
    keys = (1024, 0, 1, model, 1025, 0, 1, raster, name, 0, 1, code, *more)
    return (34735, "H", 4 + len(keys), (1, 1, 0, len(keys) // 4, *keys), True)


def doubles(number: int, *values: float) -> tuple[int, str, int, tuple[float, ...], bool]:
    return (number, "d", len(values), values, True)


def nodata(text: str) -> tuple[int, str, int, str, bool]:
    return (42113, "s", 0, text, True)


SCALE, TIE = doubles(33550, 0.01, 0.01, 0.0), doubles(33922, 0, 0, 0, 8.0, 48.0, 0.0)


def write_tif(path: Path, heights: NDArray[Any], *tags: Any, **options: Any) -> Path:
    kind = "minisblack" if heights.ndim == 2 else "rgb"
    tifffile.imwrite(path, heights, photometric=kind, metadata=None, extratags=list(tags), **options)
    return path


def degree_of_pixels(half: float) -> NDArray[Any]:
    """The plane on 100 x 100 pixels of 0.01 degrees; their centres are `half` a pixel from the tie point (48, 8)."""
    lat, lon = 48.0 - 0.01 * (np.arange(100)[:, None] + half), 8.0 + 0.01 * (np.arange(100) + half)
    return np.asarray(plane(lat, lon), np.float32)


@pytest.mark.parametrize("nodes", [1201, 3601])
def test_hgt_of_both_sizes(tmp_path: Path, nodes: int) -> None:
    write_hgt(tmp_path / "N47E008.hgt", nodes)
    ground = ground_from_dem(tmp_path / "N47E008.hgt", FRAME, 15.0)
    assert ground.sigma_m == 15.0 and ground.up_m.shape == (1201, 1201)
    for lat, lon in ((47.5, 8.5), (47.6, 8.7), (47.35, 8.2)):
        assert at(ground, FRAME, lat, lon, 500.0) == pytest.approx(plane(lat, lon), abs=0.6)  # whole metres


def test_hgt_starts_in_the_north_west_and_its_name_says_the_south_west(tmp_path: Path) -> None:
    heights = np.full((1201, 1201), 100, ">i2")
    heights[:600] = 200  # the northern half
    heights[:, :600] += 7  # the western half
    (tmp_path / "s36w070.hgt").write_bytes(heights.tobytes())
    frame = LocalFrame(-35.5, -69.5, 100.0)
    ground = ground_from_dem(tmp_path / "s36w070.hgt", frame, 15.0, nodes=301)
    for lat, lon, height in ((-35.4, -69.6, 207), (-35.4, -69.4, 200), (-35.6, -69.6, 107), (-35.6, -69.4, 100)):
        assert at(ground, frame, lat, lon, height) == pytest.approx(height, abs=0.05)


def test_voids_are_not_known_and_neighbours_join(tmp_path: Path) -> None:
    for corner in ((47, 8), (46, 8)):
        heights = write_hgt(tmp_path / f"N{corner[0]}E008.hgt", 1201, corner)
        if corner == (47, 8):
            heights[500:700, 500:700] = -32768  # 47.42 to 47.58
            (tmp_path / "N47E008.hgt").write_bytes(heights.tobytes())
    frame = LocalFrame(47.2, 8.5, 400.0)
    ground = ground_from_dem(tmp_path, frame, 15.0)
    assert at(ground, frame, 47.43, 8.5, 500.0) is None
    for lat in (46.95, 47.0, 47.0004, 47.4):
        assert at(ground, frame, lat, 8.5, 500.0) == pytest.approx(plane(lat, 8.5), abs=0.6)


def test_level_land_falls_away_as_the_earth_curves(tmp_path: Path) -> None:
    for lat in (46, 47):
        (tmp_path / f"N{lat}E008.hgt").write_bytes(np.full((1201, 1201), 400, ">i2").tobytes())
    ground = ground_from_dem(tmp_path, LocalFrame(47.3, 8.5, 400.0), 15.0)
    up, known = ground.heights_m(np.array([0.0, 10_000.0, 0.0, 0.0]), np.array([0.0, 0.0, 30_000.0, -30_000.0]))
    assert known.all() and up == pytest.approx([0.0, -7.83, -70.7, -70.7], abs=0.1)


def test_a_zipped_tile_as_srtm_hands_it_out(tmp_path: Path) -> None:
    write_hgt(tmp_path / "N47E008.hgt", 1201)
    with zipfile.ZipFile(tmp_path / "N47E008.SRTMGL3.hgt.zip", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.write(tmp_path / "N47E008.hgt", "N47E008.hgt")
    (tmp_path / "N47E008.hgt").unlink()
    assert at(ground_from_dem(tmp_path, FRAME, 15.0), FRAME, 47.5, 8.5, 500.0) == pytest.approx(500.0, abs=0.6)


@pytest.mark.parametrize(
    ("half", "raster", "georeference"),
    [
        (0.5, 1, (SCALE, TIE)),
        (0.0, 2, (SCALE, TIE)),
        (0.5, 1, (SCALE, doubles(33922, 10, 20, 0, 8.1, 47.8, 0))),
        (0.5, 1, (doubles(34264, 0.01, 0, 0, 8.0, 0, -0.01, 0, 48.0, *[0] * 7, 1),)),
    ],
    ids=["area", "point", "inner tie point", "matrix"],
)
def test_geographic_geotiff(tmp_path: Path, half: float, raster: int, georeference: tuple[Any, ...]) -> None:
    path = write_tif(tmp_path / "dem.tif", degree_of_pixels(half), geokeys(2, 4326, raster), *georeference)
    ground = ground_from_dem(path, FRAME, 15.0)
    for lat, lon in ((47.5, 8.5), (47.6, 8.7), (47.35, 8.2)):
        assert at(ground, FRAME, lat, lon, 500.0) == pytest.approx(plane(lat, lon), abs=0.02)


@pytest.mark.parametrize("options", [{}, {"compression": "deflate"}, {"compression": "lzw", "tile": (64, 64)}])
def test_utm_geotiff(tmp_path: Path, options: dict[str, Any]) -> None:
    west, north, step = 440_000.0, 5_300_000.0, 500.0
    x, y = west + step * (np.arange(160) + 0.5), north - step * (np.arange(160)[:, None] + 0.5)
    lon, lat = Transformer.from_crs(UTM32, 4326, always_xy=True).transform(*np.broadcast_arrays(x, y))
    tags = geokeys(1, UTM32), doubles(33550, step, step, 0), doubles(33922, 0, 0, 0, west, north, 0)
    path = write_tif(tmp_path / "dem.tiff", np.asarray(plane(lat, lon), np.float32), *tags, **options)
    ground = ground_from_dem(path, FRAME, 15.0)
    for lat_deg, lon_deg in ((47.5, 8.5), (47.6, 8.7), (47.35, 8.4)):
        assert at(ground, FRAME, lat_deg, lon_deg, 500.0) == pytest.approx(plane(lat_deg, lon_deg), abs=0.05)


@pytest.mark.parametrize("void", [-9999.0, 0.0, float("nan"), -3.4028234663852886e38])
def test_nodata_is_not_known(tmp_path: Path, void: float) -> None:
    heights = degree_of_pixels(0.5)
    heights[40:60, 40:60] = void  # 47.4 to 47.6, 8.4 to 8.6
    path = write_tif(tmp_path / "dem.tif", heights, geokeys(2, 4326), SCALE, TIE, nodata(str(void)))
    ground = ground_from_dem(path, FRAME, 15.0)
    assert at(ground, FRAME, 47.5, 8.5, 500.0) is None
    assert at(ground, FRAME, 47.58, 8.58, 500.0) is None
    assert at(ground, FRAME, 47.65, 8.5, 500.0) == pytest.approx(plane(47.65, 8.5), abs=0.02)


def test_tiles_that_abut_leave_no_gap(tmp_path: Path) -> None:
    heights = degree_of_pixels(0.5)
    east = doubles(33922, 0, 0, 0, 8.5, 48.0, 0.0)
    write_tif(tmp_path / "a.tif", heights[:, :50].copy(), geokeys(2, 4326), SCALE, TIE)
    write_tif(tmp_path / "b.tif", heights[:, 50:].copy(), geokeys(2, 4326), SCALE, east)
    ground = ground_from_dem(tmp_path, FRAME, 15.0, half_width_m=20_000.0)
    assert np.isfinite(ground.up_m).all()
    assert at(ground, FRAME, 47.5, 8.4995, 500.0) == pytest.approx(500.0, abs=1.1)  # half a pixel is 1 m


def test_across_the_date_line(tmp_path: Path) -> None:
    for name in ("N10W180.hgt", "N10E179.hgt"):
        (tmp_path / name).write_bytes(np.full((1201, 1201), 33, ">i2").tobytes())
    frame = LocalFrame(10.5, 179.95, 0.0)
    ground = ground_from_dem(tmp_path, frame, 15.0, nodes=301)
    assert np.isfinite(ground.up_m).all()
    assert at(ground, frame, 10.5, -179.95, 33.0) == pytest.approx(33.0, abs=0.05)


def test_longitudes_from_0_to_360(tmp_path: Path) -> None:
    heights, tie = np.full((100, 100), 44, np.int16), doubles(33922, 0, 0, 0, 350.0, 48.0, 0.0)
    frame = LocalFrame(47.5, -9.5, 0.0)
    ground = ground_from_dem(write_tif(tmp_path / "dem.tif", heights, geokeys(2, 4326), SCALE, tie), frame, 15.0)
    assert at(ground, frame, 47.6, -9.7, 44.0) == pytest.approx(44.0, abs=0.05)


def _truncated_hgt(folder: Path) -> Path:
    path = folder / "N47E008.hgt"
    path.write_bytes(bytes(2 * 1201**2 - 1))
    return path


def _named(name: str, content: bytes = b"this is no DEM\n" * 9) -> Callable[[Path], Path]:
    def write(folder: Path) -> Path:
        (folder / name).write_bytes(content)
        return folder / name

    return write


def _tif(*tags: Any, heights: NDArray[Any] | None = None) -> Callable[[Path], Path]:
    content = np.zeros((4, 4), np.float32) if heights is None else heights
    return lambda folder: write_tif(folder / "dem.tif", content, *tags)


def _cut_tif(folder: Path) -> Path:
    path = write_tif(
        folder / "dem.tif", degree_of_pixels(0.5), geokeys(2, 4326), SCALE, TIE, compression="deflate", rowsperstrip=10
    )
    path.write_bytes(path.read_bytes()[:2000])
    return path


@pytest.mark.parametrize(
    ("make", "says"),
    [
        (lambda folder: folder / "gone.tif", "gone.tif: no such file or folder"),
        (lambda folder: folder, "holds no DEM: .hgt, .hgt.zip, .tif, .tiff files are read"),
        (_named("dem.txt"), "not a DEM by its name"),
        (_named("N47E008.hgt"), "holds 135 bytes: an .hgt file has 2884802 or 25934402"),
        (_truncated_hgt, "holds 2884801 bytes"),
        (_named("zurich.hgt"), "must say its south-western corner, as N47E008.hgt does"),
        (_named("N47E008.hgt.zip"), "not a .zip file"),
        (_named("dem.tif"), "not a TIFF file"),
        (_named("dem.tif", b""), "not a TIFF file"),
        (_tif(), "has no georeference"),
        (_tif(geokeys(2, 4326)), "has no georeference"),
        (_tif(geokeys(2, 4326), SCALE, doubles(33922, *[0.0] * 12)), "has no georeference"),
        (_tif(geokeys(2, 4326), doubles(34264, 1, 0.2, 0, 8, 0.2, -1, 0, 48, *[0] * 8)), "has no georeference"),
        (_tif(geokeys(2, 4326), doubles(33550, 0.01, -0.01, 0), TIE), "step 0.01 east and -0.01 south"),
        (_tif(SCALE, TIE), "its CRS has no EPSG number"),
        (_tif(geokeys(1, 32767), SCALE, TIE), "its CRS has no EPSG number"),
        (_tif(geokeys(1, 4326), SCALE, TIE), "its CRS has no EPSG number"),
        (_tif(geokeys(2, 1), SCALE, TIE), "its CRS has no EPSG number"),
        (_tif(geokeys(2, 4326, 1, 4099, 0, 1, 9036), SCALE, TIE), "heights in unit EPSG:9036"),
        (_tif(geokeys(2, 4326), SCALE, TIE, nodata("none")), "its nodata tag is 'none'"),
        (_tif(geokeys(2, 4326), SCALE, TIE, heights=np.zeros((4, 4, 3), np.uint8)), "one band of numbers"),
        (_cut_tif, "dem.tif: its heights can't be read"),
    ],
)
def test_one_line_says_what_is_wrong_with_a_file(tmp_path: Path, make: Callable[[Path], Path], says: str) -> None:
    path = make(tmp_path)
    with pytest.raises(DemError) as caught:
        ground_from_dem(path, FRAME, 15.0, nodes=101)
    assert says in str(caught.value) and str(path) in str(caught.value)
    assert "\n" not in str(caught.value) and len(str(caught.value)) < 200 + len(str(path))


def test_a_tile_elsewhere_is_not_read(tmp_path: Path) -> None:
    write_hgt(tmp_path / "N47E008.hgt", 1201)
    with zipfile.ZipFile(tmp_path / "N12E008.hgt.zip", "w") as archive:
        archive.writestr("N12E008.hgt", bytes(2 * 1201**2))
    content = bytearray((tmp_path / "N12E008.hgt.zip").read_bytes())
    content[1000] ^= 1  # its checksum is wrong now
    (tmp_path / "N12E008.hgt.zip").write_bytes(content)
    assert at(ground_from_dem(tmp_path, FRAME, 15.0, nodes=101), FRAME, 47.5, 8.5, 500.0) is not None
    with pytest.raises(DemError, match="its heights can't be read"):
        ground_from_dem(tmp_path, LocalFrame(12.5, 8.5, 0.0), 15.0, nodes=101)


def test_without_the_extra_a_geotiff_says_what_to_install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "tifffile", None)
    with pytest.raises(DemError, match=r"pip install '\.\[dem\]'"):
        open_dem(_tif(geokeys(2, 4326), SCALE, TIE)(tmp_path))


def made(config: GroundConfig, frame: LocalFrame, home_m: float | None) -> tuple[Ground, dict[str, int]]:
    counters: Counter[str] = Counter()
    return make_ground(config, frame, home_m, counters), dict(counters)


def test_off_and_flat() -> None:
    ground, counted = made(GroundConfig(), FRAME, 350.0)
    assert isinstance(ground, NoGround) and counted == {}
    ground, counted = made(GroundConfig(kind="flat"), FRAME, 350.0)
    assert isinstance(ground, FlatGround) and (ground.up_m, ground.sigma_m) == (-50.0, 30.0) and counted == {}
    ground, counted = made(GroundConfig(kind="flat", sigma_m=80.0), FRAME, None)
    assert isinstance(ground, NoGround) and counted == {"no_home_altitude": 1}


def test_a_dem_that_has_the_place_is_taken(tmp_path: Path) -> None:
    write_hgt(tmp_path / "N47E008.hgt", 1201)
    ground, counted = made(GroundConfig(kind="dem", path=str(tmp_path)), FRAME, None)
    assert isinstance(ground, GridGround) and ground.sigma_m == 15.0 and counted == {}


@pytest.mark.parametrize("home_m", [350.0, None])
@pytest.mark.parametrize("why", ["elsewhere", "void", "unreadable"])
def test_a_dem_that_lacks_the_place_falls_back(tmp_path: Path, why: str, home_m: float | None) -> None:
    path = tmp_path / ("N12E008.hgt" if why == "elsewhere" else "N47E008.hgt")
    path.write_bytes(np.full((1201, 1201), -32768, ">i2").tobytes()[: 10 if why == "unreadable" else None])
    ground, counted = made(GroundConfig(kind="dem", path=str(path), sigma_m=5.0), FRAME, home_m)
    reason = "dem_unreadable" if why == "unreadable" else "dem_lacks_place"
    if home_m is None:
        assert isinstance(ground, NoGround) and counted == {reason: 1, "no_home_altitude": 1}
    else:
        assert isinstance(ground, FlatGround) and counted == {reason: 1}
        assert (ground.up_m, ground.sigma_m) == (-50.0, 30.0)  # the DEM's sigma is not the flat world's


@pytest.mark.parametrize("path", ["", "/nowhere/at/all.hgt"])
def test_the_config_names_a_path_that_is_missing(path: str) -> None:
    with pytest.raises(ConfigError) as caught:
        check(Config(ground=GroundConfig(kind="dem", path=path)))
    assert str(caught.value).startswith(f"ground.path is '{path}': ")


def test_the_config_takes_a_path_that_exists(tmp_path: Path) -> None:
    config = Config(ground=GroundConfig(kind="dem", path=str(tmp_path)))
    check(config)  # raises nothing
    assert config.ground.height_sigma_m == 15.0  # the DEM's own, not the flat world's


@needs_data
def test_srtm_agrees_with_what_the_autopilot_said_of_its_terrain() -> None:
    link: Any = mavutil.mavlink_connection(str(DATA / "telemetry" / "dronekit_flight_replay.tlog"))
    reports = []
    while (message := link.recv_match(type="TERRAIN_REPORT")) is not None:
        reports.append((message.lat / 1e7, message.lon / 1e7, message.terrain_height))
    link.close()
    frame = LocalFrame(reports[0][0], reports[0][1], 584.0)
    ground = ground_from_dem(DATA / "dem" / "S36E149.hgt.zip", frame, 15.0)
    differences = [(at(ground, frame, lat, lon, said) or np.nan) - said for lat, lon, said in reports[::5]]
    assert len(differences) > 500
    # shared/data/README.md has -0.63 m, 0.14 m the other way round, by another reading of the tile
    assert np.mean(differences) == pytest.approx(0.63, abs=0.05) and np.std(differences) == pytest.approx(
        0.14, abs=0.03
    )


@needs_data
@pytest.mark.parametrize(
    ("name", "lat_deg", "lon_deg", "low_m", "high_m"),
    [
        ("Rome-30m-DEM.tif", 41.8902, 12.4922, 15.0, 40.0),  # the Colosseum stands at 21 m
        ("skydio-catilina-dem.tiff", 32.5, -110.92, 800.0, 1600.0),
    ],
)
def test_real_geotiffs(name: str, lat_deg: float, lon_deg: float, low_m: float, high_m: float) -> None:
    frame = LocalFrame(lat_deg, lon_deg, low_m)
    height = at(ground_from_dem(DATA / "dem" / name, frame, 15.0), frame, lat_deg, lon_deg, low_m)
    assert height is not None and low_m < height < high_m
    assert len(open_dem(DATA / "dem")) == 3
