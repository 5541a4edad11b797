"""Hill shade: dark where a slope turns from the light, clear on level ground and where nothing is known."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from service.ground.background.hill_shade import HillShade
from service.ground.background.shade import TILE_PX, shade, tile_places
from service.ground.faults import GroundError

ZOOM, X, Y = 10, 536, 359  # over 47.4 N 8.6 E


def test_a_tiles_places_are_mercators() -> None:
    lon_deg, lat_deg = tile_places(1, 1, 0)  # the north-eastern quarter of the world
    assert lon_deg[0, 0] == pytest.approx(-90.0 / TILE_PX) and lon_deg[0, -2] == pytest.approx(180.0 - 90.0 / TILE_PX)
    assert lat_deg[1, 0] == pytest.approx(85.0511, abs=0.05) and lat_deg[-2, 0] == pytest.approx(0.35, abs=0.01)


@pytest.mark.parametrize(
    ("east", "north", "colour"),
    [(0.0, 0.0, None), (0.3, 0.0, 255), (-0.3, 0.0, 0), (0.0, -0.3, 255), (0.0, 0.3, 0), (0.3, 0.3, None)],
)
def test_slopes_towards_the_north_west_are_bright(east: float, north: float, colour: int | None) -> None:
    """A plane that rises so many metres a metre; by Lambert's law."""
    lon_deg, lat_deg = tile_places(ZOOM, X, Y)
    lon_deg = lon_deg - lon_deg[TILE_PX // 2, TILE_PX // 2]
    heights = 111_319.5 * (east * np.cos(np.radians(lat_deg)) * lon_deg + north * lat_deg)
    middle = shade(heights, lat_deg, ZOOM)[TILE_PX // 2, TILE_PX // 2]
    if colour is None:
        slope = 1.6 * np.hypot(east, north)
        level = np.sqrt(0.5)
        assert middle[3] == pytest.approx(255 * 0.5 * (level - level / np.hypot(1.0, slope)) / level, abs=2.0)
    else:
        normal = np.array([-1.6 * east, -1.6 * north, 1.0]) / np.hypot(1.0, 1.6 * 0.3)
        light = float(normal @ [-0.5, 0.5, np.sqrt(0.5)])
        more = light - np.sqrt(0.5)
        expected = 0.4 * more / (1 - np.sqrt(0.5)) if more > 0 else -0.5 * more / np.sqrt(0.5)
        assert middle[0] == colour and middle[3] == pytest.approx(255 * expected, abs=2.0)


def srtm(folder: Path, heights: np.ndarray) -> Path:  # type: ignore[type-arg]
    (folder / "N47E008.hgt").write_bytes(heights.astype(">i2").tobytes())
    return folder


def test_a_ridge_of_a_dem_is_drawn_where_it_is_and_nothing_beside_the_dem(tmp_path: Path) -> None:
    column = np.arange(1201)
    ridge = np.maximum(0, 450 - 30 * np.abs(column - 720))  # 8.6 E; its western side is in the light
    shading = HillShade(srtm(tmp_path, np.broadcast_to(ridge, (1201, 1201))))
    found = shading.tile(ZOOM, X, Y)
    assert found is not None and found.kind == "image/png" and shading.tile(ZOOM, X, Y) is found
    picture = cv2.imdecode(np.frombuffer(found.image, np.uint8), cv2.IMREAD_UNCHANGED)
    lon_deg = tile_places(ZOOM, X, Y)[0][1:-1, 1:-1]
    west, east = (picture[np.abs(lon_deg - at) < 0.003] for at in (8.594, 8.606))
    assert (west[:, 0] == 255).all() and (west[:, 3] > 20).all()
    assert (east[:, 0] == 0).all() and (east[:, 3] > 20).all()
    for place in ((ZOOM, X + 50, Y), (9, X >> 1, Y >> 1), (11, 2 * X, 2 * Y), (ZOOM, -1, 0)):
        assert shading.tile(*place) is None


def test_what_is_no_dem_is_one_line_and_a_file_that_breaks_later_has_no_heights(tmp_path: Path) -> None:
    for path, words in ((tmp_path / "none", "no such file"), (tmp_path, "holds no DEM")):
        with pytest.raises(GroundError, match=words):
            HillShade(path)
    shading = HillShade(srtm(tmp_path, np.zeros((1201, 1201))))
    (tmp_path / "N47E008.hgt").unlink()
    assert shading.tile(ZOOM, X, Y) is None
