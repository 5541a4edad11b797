"""Tiles side by side answer as one raster does: seams, a change of spacing, finer patches, tiles that lack."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from service.localise.terrain.blocks import Blocks
from service.localise.terrain.dem import open_dem
from service.localise.terrain.mosaic import heights_at
from tests.support.dem import write_glo30

SIDE = 120  # pixels a degree
RNG = np.random.default_rng(4)
NOISE = RNG.uniform(100.0, 900.0, (2 * SIDE, 2 * SIDE)).astype(
    np.float32
)  # 48 to 46 N, 8 to 10 E: no pixel as its next


def one_raster(lat: NDArray[Any], lon: NDArray[Any]) -> NDArray[Any]:
    """Bilinear between the pixels of all four tiles, whose middles are on whole 120ths of a degree."""
    row, col = (48.0 - lat) * SIDE, (lon - 8.0) * SIDE
    i, j = np.floor(row).astype(int), np.floor(col).astype(int)
    down, right = row - i, col - j
    north = NOISE[i, j] * (1 - right) + NOISE[i, j + 1] * right
    south = NOISE[i + 1, j] * (1 - right) + NOISE[i + 1, j + 1] * right
    return np.asarray(north * (1 - down) + south * down)


def four_tiles(folder: Path) -> None:
    for lat in (46, 47):
        for lon in (8, 9):
            part = NOISE[(47 - lat) * SIDE :, (lon - 8) * SIDE :][:SIDE, :SIDE]
            write_glo30(folder, lat, lon, part, rows=SIDE, cols=SIDE, block=64, overviews=1)


def heights(folder: Path, lat: NDArray[Any], lon: NDArray[Any]) -> NDArray[Any]:
    return heights_at(open_dem(folder), np.stack([lon, lat]), Blocks(10**7))


def test_four_tiles_that_share_no_pixel_are_one_raster(tmp_path: Path) -> None:
    four_tiles(tmp_path)
    rng = np.random.default_rng(0)
    gap = 1.0 / SIDE
    lat, lon = rng.uniform(46.2, 47.8, 3000), rng.uniform(8.2, 9.8, 3000)
    lat[:1000] = (
        47.0 + rng.uniform(-0.1, 1.1, 1000) * gap
    )  # between the northern tile's last row and the next one's first
    lon[500:1500] = 9.0 - rng.uniform(-0.1, 1.1, 1000) * gap
    assert heights(tmp_path, lat, lon) == pytest.approx(one_raster(lat, lon), abs=0.01)


def test_beyond_tiles_that_lack_nothing_is_known(tmp_path: Path) -> None:
    four_tiles(tmp_path)
    next(tmp_path.glob("*N46*E009*")).unlink()  # the sea: Copernicus has no tile there
    half = 0.5 / SIDE
    lat, lon = np.array([46.5, 46.5, 46.5, 46.5]), 9.0 - np.array([-0.3, -0.01 * half, 1.02 * half, 2.0 * half])
    found = heights(tmp_path, lat, lon)
    assert np.isnan(found).tolist() == [True, True, False, False]
    assert found[2] == pytest.approx(NOISE[180, 119], abs=0.01)  # the last pixel's own, to its edge
    assert np.isfinite(heights(tmp_path, np.array([47.5, 46.5]), np.array([9.3, 8.3]))).all()


def test_at_50_degrees_north_the_longitudes_spacing_changes_and_the_seam_holds(tmp_path: Path) -> None:
    fine, coarse = RNG.uniform(0.0, 500.0, (SIDE, SIDE)), RNG.uniform(0.0, 500.0, (SIDE, 80))
    write_glo30(tmp_path, 49, 8, fine, rows=SIDE, cols=SIDE, block=64, overviews=0)
    write_glo30(tmp_path, 50, 8, coarse, rows=SIDE, cols=80, block=64, overviews=0)
    rng = np.random.default_rng(1)
    share, lon = rng.uniform(0.0, 1.0, 500), rng.uniform(8.05, 8.9, 500)
    upper = np.interp(lon, 8.0 + np.arange(80) / 80, coarse[-1])  # at 50 1/120
    lower = np.interp(lon, 8.0 + np.arange(SIDE) / SIDE, fine[0])  # at 50
    found = heights(tmp_path, 50.0 + share / SIDE, lon)
    assert found == pytest.approx(share * upper + (1.0 - share) * lower, abs=0.01)


def test_the_finer_of_two_is_taken_and_the_coarser_fills_round_it(tmp_path: Path) -> None:
    (tmp_path / "N47E008.hgt").write_bytes(np.full((1201, 1201), 200, ">i2").tobytes())
    heights_m = np.full((2400, 2400), 300.0, np.float32)
    heights_m[:1200] = np.nan  # of the northern half it knows nothing
    write_glo30(tmp_path, 47, 8, heights_m, rows=2400, cols=2400, block=256, overviews=0)
    lat, lon = np.array([47.25, 47.75, 47.0006, 47.9]), np.array([8.5, 8.5, 8.5, 8.1])
    assert heights(tmp_path, lat, lon) == pytest.approx([300.0, 200.0, 300.0, 200.0], abs=0.1)
    seam = np.linspace(47.49, 47.51, 100)
    found = heights(tmp_path, seam, np.full(100, 8.5))
    assert np.isfinite(found).all() and found.min() >= 200.0 and found.max() <= 300.0


@pytest.mark.parametrize("lat", [-1, 0, -34])
def test_south_of_the_equator_and_across_it(tmp_path: Path, lat: int) -> None:
    for one in (lat, lat - 1):
        write_glo30(
            tmp_path, one, -71, lambda north, east: 500.0 + 3.0 * north + 2.0 * east, rows=SIDE, cols=SIDE, block=64
        )
    places = np.array([lat + 0.3, lat - 0.4, lat + 0.2 / SIDE]), np.array([-70.5, -70.2, -70.9])
    assert heights(tmp_path, *places) == pytest.approx(500.0 + 3.0 * places[0] + 2.0 * places[1], abs=0.02)
