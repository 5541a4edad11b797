"""Tiles and places under the fires: what is read, from where the rows count, and what is refused."""

import sqlite3
from pathlib import Path

import pytest

from service.ground.faults import GroundError
from service.ground.web.background import Backdrop


def mbtiles(path: Path, kind: str = "png", rows: int = 1) -> Path:
    with sqlite3.connect(path) as database:
        database.execute("CREATE TABLE metadata (name TEXT, value TEXT)")
        database.execute("CREATE TABLE tiles (zoom_level INT, tile_column INT, tile_row INT, tile_data BLOB)")
        database.executemany("INSERT INTO metadata VALUES (?, ?)", [("format", kind), ("attribution", "<b>us</b>")])
        database.executemany("INSERT INTO tiles VALUES (?, ?, ?, ?)", [(2, 1, 0, b"south")] * rows)
    database.close()
    return path


def test_a_tile_is_found_by_its_row_from_the_north(tmp_path: Path) -> None:
    backdrop = Backdrop(mbtiles(tmp_path / "a.mbtiles"))
    assert (backdrop.told.min_zoom, backdrop.told.max_zoom, backdrop.told.attribution) == (2, 2, "<b>us</b>")
    assert backdrop.tile(2, 1, 3) == (b"south", "image/png")
    for zoom, x, y in ((2, 1, 0), (2, 4, 3), (2, -1, 3), (99, 1, 3), (-1, 0, 0), (2, 1, 10**30)):
        assert backdrop.tile(zoom, x, y) is None
    assert Backdrop().tile(2, 1, 3) is None


def test_what_is_no_such_file_is_one_line(tmp_path: Path) -> None:
    other = tmp_path / "other"
    other.write_text("no database, no JSON")
    for arguments, words in (
        ((tmp_path / "none", None), "no such file"),
        ((other, None), "no MBTiles file"),
        ((mbtiles(tmp_path / "v.mbtiles", "pbf"), None), "holds pbf tiles: give one with images"),
        ((mbtiles(tmp_path / "e.mbtiles", rows=0), None), "holds no tile"),
        ((None, other), "no GeoJSON FeatureCollection"),
        ((None, tmp_path), "--places"),
    ):
        with pytest.raises(GroundError, match=words):
            Backdrop(*arguments)
