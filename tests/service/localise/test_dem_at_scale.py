"""Many and large DEM files: only what the map needs is read; what is broken in one of a hundred is named."""

import struct
import tracemalloc
import zlib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tifffile
from numpy.typing import NDArray

from distloc.geometry.geodesy import LocalFrame
from service.commands.check.dem import check_dem
from service.config.sections import GroundConfig
from service.localise.terrain.blocks import Blocks
from service.localise.terrain.dem import DemError, ground_from_dem, open_dem
from service.localise.terrain.hgt import open_hgt
from service.localise.terrain.tile import sample
from tests.service.localise.test_dem import at, write_hgt
from tests.support.dem import glo30_name, glo30_pixels, write_glo30

FRAME = LocalFrame(47.5, 8.5, 400.0)


def bytes_read() -> int:
    """By this process so far, as the kernel counts them."""
    return int(Path("/proc/self/io").read_text(encoding="ascii").split()[1])


def hills(lat_deg: Any, lon_deg: Any) -> NDArray[Any]:
    """Half a kilometre from crest to crest, and a hum that does not compress."""
    waves = 40.0 * np.sin(1400.0 * lat_deg) * np.cos(1000.0 * lon_deg)
    hum = np.random.default_rng(0).normal(0.0, 0.3, (len(lat_deg), len(lon_deg)))
    return np.asarray(500.0 + waves + hum, np.float32)


def first_page(path: Path) -> Any:
    with tifffile.TiffFile(path) as file:
        return file.pages[0]


def moved(path: Path, lat: int, lon: int) -> Path:
    """A copy of a tile elsewhere: its tie point, two doubles, says so."""
    content = path.read_bytes()
    found = first_page(path).tags[33922]
    place = found.valueoffset + 24
    west, north = struct.unpack("<2d", content[place : place + 16])
    old_lat, old_lon = int(path.name[23:25]), int(path.name[30:33])
    there = struct.pack("<2d", west + lon - old_lon, north + lat - old_lat)
    copy = path.with_name(glo30_name(lat, lon))
    copy.write_bytes(content[:place] + there + content[place + 16 :])
    return copy


def test_of_a_hundred_tiles_only_the_blocks_under_the_map_are_read(tmp_path: Path) -> None:
    level = write_glo30(tmp_path, 43, 4, np.full((1, 1), 500.0))
    for number in range(1, 100):
        moved(level, 43 + number // 10, 4 + number % 10)
    hilly = write_glo30(tmp_path, 47, 8, hills)
    assert hilly.stat().st_size > 20e6 and len(list(tmp_path.iterdir())) == 100
    ground_from_dem(level, LocalFrame(43.5, 4.5, 500.0), 15.0, 2000.0, nodes=11)  # what is imported is read too
    before = bytes_read()
    tiles = open_dem(tmp_path)
    assert len(tiles) == 100 and all([one.raster.cols for one in tile.overviews] == [1800, 900] for tile in tiles)
    assert bytes_read() - before < 100 * 20_000
    before = bytes_read()
    tracemalloc.start()
    ground = ground_from_dem(tmp_path, FRAME, 15.0, half_width_m=20_000.0)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert np.isfinite(ground.up_m).all()
    # 40 km are 0.53 of a degree of longitude and 0.36 of latitude: 4 of 16 blocks, or 6
    assert 0.1 * hilly.stat().st_size < bytes_read() - before < 0.45 * hilly.stat().st_size + 100 * 20_000
    assert peak < 80e6  # whole, the one tile has 52 MB, and all have 5 GB
    assert at(ground, FRAME, 47.5, 8.5, 500.0) == pytest.approx(
        float(hills(*np.array([[[47.5]], [[8.5]]]))[0, 0]), abs=2
    )


def test_a_coarse_grid_reads_overviews_and_tells_what_it_loses(tmp_path: Path) -> None:
    path = write_glo30(tmp_path, 47, 8, hills, rows=1800, cols=1800, block=256)
    (tile,) = open_dem(path)  # 62, 124 and 247 m from row to row
    assert [tile.at_step(step_m).raster.rows for step_m in (10.0, 100.0, 130.0, 200.0, 900.0)] == [
        1800,
        1800,
        900,
        900,
        450,
    ]
    ground = ground_from_dem(path, FRAME, 15.0, half_width_m=30_000.0, nodes=301)  # 200 m apart
    rng = np.random.default_rng(1)
    lat, lon = rng.uniform(47.3, 47.7, 400), rng.uniform(8.3, 8.7, 400)
    lost = []
    for one_lat, one_lon in zip(lat, lon, strict=True):
        east, north, up = FRAME.enu_from_geodetic(
            one_lat, one_lon, 500.0 + 40.0 * np.sin(1400.0 * one_lat) * np.cos(1000.0 * one_lon)
        )
        lost.append(ground.heights_m(np.array([east]), np.array([north]))[0][0] - up)
    loss_m = float(np.std(lost))
    assert loss_m > 5.0
    assert 0.9 * loss_m < np.sqrt(ground.sigma_m**2 - 15.0**2) < 1.7 * loss_m  # the rougher half, between the nodes
    fine = ground_from_dem(path, FRAME, 15.0, half_width_m=4_500.0, nodes=301)
    assert fine.sigma_m == 15.0


def test_a_raster_without_overviews_that_is_too_large_for_the_map_says_what_to_do(tmp_path: Path) -> None:
    tile = open_dem(write_glo30(tmp_path, 47, 8, np.full((1, 1), 9.0), rows=512, cols=512, block=128, overviews=0))[0]
    col, row = np.linspace(0.0, 511.0, 50), np.linspace(0.0, 511.0, 50)
    assert sample(tile, Blocks(0, most_pixels=16 * 128**2), col, row) == pytest.approx(9.0)
    with pytest.raises(DemError, match=r"too many pixels .*gdaladdo"):
        sample(tile, Blocks(0, most_pixels=3 * 128**2), col, row)


def test_blocks_that_are_held_do_not_grow(tmp_path: Path) -> None:
    tile = open_dem(write_glo30(tmp_path, 47, 8, hills, rows=2048, cols=2048, block=128, overviews=0))[0]
    blocks = Blocks(most_bytes=500_000)
    sample(tile, blocks, np.zeros(2), np.zeros(2))
    rng = np.random.default_rng(0)
    tracemalloc.start()
    for _ in range(300):
        sample(tile, blocks, rng.uniform(0, 2047, 4), rng.uniform(0, 2047, 4))
    held = tracemalloc.get_traced_memory()[0]
    tracemalloc.stop()
    assert 300_000 < held < 900_000


@pytest.mark.parametrize("nodes", [3601, 7201])
def test_of_an_hgt_only_some_rows_are_read(tmp_path: Path, nodes: int) -> None:
    write_hgt(tmp_path / "N47E008.hgt", nodes)
    tile = open_hgt(tmp_path / "N47E008.hgt")
    before = bytes_read()
    heights = sample(tile, Blocks(10**7), np.array([10.0, 20.5]), np.array([nodes / 2, nodes / 2 + 9.3]))
    assert np.isfinite(heights).all() and bytes_read() - before < 4 * 64 * nodes


def break_block(path: Path) -> None:
    """Spoil the first blocks' bytes, and so their checksums; the headers stay."""
    page = first_page(path)
    content = bytearray(path.read_bytes())
    for offset in page.dataoffsets[:3]:
        content[offset + 40 : offset + 60] = bytes(20)
    path.write_bytes(content)


def headers(content: bytes) -> bytes:
    """A TIFF whose tag 324, the blocks' places, has four thousand million of them."""
    tags = [(256, 4, 1, 60000), (257, 4, 1, 60000), (258, 3, 1, 32), (322, 4, 1, 16), (323, 4, 1, 16)]
    tags += [(324, 4, 0xFFFFFFF0, 8), (325, 4, 0xFFFFFFF0, 8), (339, 3, 1, 3)]
    entries = b"".join(struct.pack("<HHII", *one) for one in tags)
    return b"II*\0" + struct.pack("<I", 8) + struct.pack("<H", len(tags)) + entries + bytes(4) + content


def test_what_is_broken_in_a_folder_is_named_and_the_rest_is_used(tmp_path: Path) -> None:
    for lat in (46, 47):
        write_glo30(tmp_path, lat, 8, hills, rows=360, cols=360, block=64)
    write_glo30(tmp_path, 45, 8, hills, rows=360, cols=360, block=64)
    break_block(tmp_path / glo30_name(46, 8))
    cut = tmp_path / glo30_name(45, 8)
    cut.write_bytes(cut.read_bytes()[:-3000])
    (tmp_path / "huge.tif").write_bytes(headers(bytes(1000)))
    lines: list[str] = []
    frame = LocalFrame(47.0, 8.3, 400.0)
    tracemalloc.start()
    ground = ground_from_dem(tmp_path, frame, 15.0, 30_000.0, nodes=301, passed_over=lines)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 80e6
    told = "\n".join(lines)
    assert len(lines) == 3 and all("\n" not in line and len(line) < 250 + len(str(tmp_path)) for line in lines)
    assert f"{glo30_name(46, 8)}: its heights can't be read" in told and "it is cut off" in told
    assert "huge.tif: " in told
    assert at(ground, frame, 47.2, 8.3, 500.0) is not None
    assert at(ground, frame, 46.95, 8.1, 500.0) is None  # in a block that is spoilt
    assert at(ground, frame, 46.95, 8.6, 500.0) is not None  # in one that is not
    assert any("its heights can't be read" in str(one) for one in check_dem(GroundConfig("dem", str(tmp_path))))


def test_a_block_that_unpacks_to_more_than_it_may_is_refused(tmp_path: Path) -> None:
    path = write_glo30(tmp_path, 47, 8, hills, rows=360, cols=360, block=64, overviews=0)
    page = first_page(path)
    bomb = zlib.compress(bytes(300_000_000), 9)
    content = bytearray(path.read_bytes())
    for number in range(len(page.dataoffsets)):
        offsets, counts = page.tags[324], page.tags[325]
        struct.pack_into("<I", content, offsets.valueoffset + 4 * number, len(content))
        struct.pack_into("<I", content, counts.valueoffset + 4 * number, len(bomb))
    path.write_bytes(bytes(content) + bomb)
    tracemalloc.start()
    with pytest.raises(DemError, match="its heights can't be read"):
        ground_from_dem(path, FRAME, 15.0, nodes=11)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 20e6


def test_voids_numbers_that_are_none_and_blocks_that_are_left_out_are_not_known(tmp_path: Path) -> None:
    lat, lon = glo30_pixels(47, 8, 360, 360)
    heights = np.full((360, 360), 500.0, np.float32)
    heights[170:180, 170:180] = np.nan
    heights[100:110, 170:180] = -32767.0
    heights[100:110, 100:110] = np.inf
    path = write_glo30(tmp_path, 47, 8, heights, rows=360, cols=360, block=64)
    page = first_page(path)
    content = bytearray(path.read_bytes())
    left_out = 3 * 6 + 4  # rows 192 to 255, columns 256 to 319
    for tag in (324, 325):
        struct.pack_into("<I", content, page.tags[tag].valueoffset + 4 * left_out, 0)
    path.write_bytes(content)
    ground = ground_from_dem(path, FRAME, 15.0)
    for row, col in ((175, 175), (105, 175), (105, 105), (220, 280)):
        assert at(ground, FRAME, float(lat[row, 0]), float(lon[col]), 500.0) is None
    for row, col in ((150, 150), (220, 250), (185, 175)):
        assert at(ground, FRAME, float(lat[row, 0]), float(lon[col]), 500.0) == pytest.approx(500.0, abs=0.05)


def test_one_strip_of_plain_numbers_is_read_by_rows(tmp_path: Path) -> None:
    tags = [
        (33550, "d", 3, (1 / 4000, 1 / 4000, 0.0), True),
        (33922, "d", 6, (0.0, 0.0, 0.0, 8.0, 48.0, 0.0), True),
        (34735, "H", 16, (1, 1, 0, 3, 1024, 0, 1, 2, 1025, 0, 1, 1, 2048, 0, 1, 4326), True),
    ]
    heights = np.arange(4000, dtype=np.int16)[:, None] + np.zeros(4000, np.int16)
    for order in "<>":
        path = tmp_path / f"dem{order == '<'}.tif"
        tifffile.imwrite(path, heights, byteorder=order, photometric="minisblack", rowsperstrip=4000, extratags=tags)
        (tile,) = open_dem(path)
        before = bytes_read()
        assert sample(tile, Blocks(10**7), np.array([7.0]), np.array([2500.25])) == pytest.approx(2500.25)
        assert bytes_read() - before < 1_100_000 < path.stat().st_size / 20
