"""Tiles and places under the fires: what is read, from where the rows count, and what is refused."""

import json
import sqlite3
from pathlib import Path
from typing import Any

import pytest

from service.ground.background.backdrop import Backdrop
from service.ground.faults import GroundError


def mbtiles(path: Path, kind: str = "png", rows: int = 1) -> Path:
    with sqlite3.connect(path) as database:
        database.execute("CREATE TABLE metadata (name TEXT, value TEXT)")
        database.execute("CREATE TABLE tiles (zoom_level INT, tile_column INT, tile_row INT, tile_data BLOB)")
        database.executemany("INSERT INTO metadata VALUES (?, ?)", [("format", kind), ("attribution", "<b>us</b>")])
        database.executemany("INSERT INTO tiles VALUES (?, ?, ?, ?)", [(2, 1, 0, b"south")] * rows)
    database.close()
    return path


def test_a_tile_is_found_by_its_row_from_the_north(tmp_path: Path) -> None:
    with Backdrop(str(mbtiles(tmp_path / "a.mbtiles"))) as backdrop:
        told = backdrop.told.tiles
        assert told is not None
        assert (told.url, told.min_zoom, told.max_zoom, told.attribution) == ("tiles/{z}/{x}/{y}", 2, 2, "<b>us</b>")
        assert backdrop.tile(2, 1, 3) == (b"south", "image/png")
        for zoom, x, y in ((2, 1, 0), (2, 4, 3), (2, -1, 3), (99, 1, 3), (-1, 0, 0), (2, 1, 10**30)):
            assert backdrop.tile(zoom, x, y) is None
    assert backdrop.tile(2, 1, 3) is None  # it is closed
    assert Backdrop().tile(2, 1, 3) is None and Backdrop().told.tiles is None


def test_a_tile_server_is_named_with_its_origin_and_its_source() -> None:
    url = "https://tiles.example:8443/v1/{z}/{x}/{y}.png?key=a"
    backdrop = Backdrop(url, attribution="the\nsurvey")
    assert backdrop.origin == "https://tiles.example:8443" and backdrop.tile(1, 0, 0) is None
    told = backdrop.told.tiles
    assert told is not None and (told.url, told.attribution) == (url, "the\\nsurvey")
    assert Backdrop("http://[2001:db8::1]:80/{z}/{x}/{y}").origin == "http://[2001:db8::1]:80"
    assert Backdrop().origin == ""


@pytest.mark.parametrize(
    "url",
    [
        "ftp://tiles.example/{z}/{x}/{y}",
        "https://tiles.example/{z}/{x}",
        "https://{s}.tiles.example/{z}/{x}/{y}",
        "https://tiles.example/{z}/{x}/{y}{r}.png",
        "https://tiles.example/{z}/{x}/{y}/{z}",
        "https://user:word@tiles.example/{z}/{x}/{y}",
        "https://tiles.example; script-src */{z}/{x}/{y}",
        "https://tiles.example' /{z}/{x}/{y}",
        "https:///{z}/{x}/{y}",
        "https://*/{z}/{x}/{y}",
        "https://tiles.example/{z}/{x}/{y}\nSet-Cookie: a",
        "https://[2001:db8::1/{z}/{x}/{y}",
        "https://tiles.example:port/{z}/{x}/{y}",
    ],
)
def test_what_is_no_tile_server_is_one_line(url: str) -> None:
    with pytest.raises(GroundError, match="--tiles") as error:
        Backdrop(url)
    assert "\n" not in str(error.value)


def places(path: Path, *geometries: Any, **more: Any) -> Path:
    features = [{"type": "Feature", "geometry": one, "properties": {"name": "Mill"}} for one in geometries]
    path.write_text(json.dumps({"type": "FeatureCollection", "features": features} | more))
    return path


def test_places_are_handed_on_as_they_are(tmp_path: Path) -> None:
    line = [[8.6, 47.4], [8.7, 47.5, 400.0]]
    shapes = [
        {"type": "Point", "coordinates": line[0]},
        {"type": "LineString", "coordinates": line},
        {"type": "MultiPolygon", "coordinates": [[[*line, line[0]]]]},
        None,
    ]
    path = places(tmp_path / "a.geojson", *shapes, name="parcels")
    backdrop = Backdrop(places=path)
    assert backdrop.told.has_places and backdrop.places == path.read_bytes()


def test_what_is_no_such_file_is_one_line(tmp_path: Path) -> None:
    other = tmp_path / "other"
    other.write_text("no database, no JSON")
    broken = tmp_path / "broken.mbtiles"
    broken.write_bytes(b"SQLite format 3\0" + bytes(500))
    for tiles, words in (
        (tmp_path / "none", "No such file"),
        (tmp_path, "Is a directory"),
        (other, "neither an MBTiles nor a PMTiles file"),
        (broken, "no MBTiles file"),
        (mbtiles(tmp_path / "v.mbtiles", "pbf"), "holds pbf tiles: give images"),
        (mbtiles(tmp_path / "e.mbtiles", rows=0), "holds no tile"),
    ):
        with pytest.raises(GroundError, match=words):
            Backdrop(str(tiles))
    for path, words in (
        (other, "no GeoJSON FeatureCollection"),
        (tmp_path, "--places"),
        (places(tmp_path / "1", {"type": "Point", "coordinates": [8.6]}), "length >= 2 - at"),
        (places(tmp_path / "2", {"type": "Circle", "coordinates": [8.6, 47.4]}), "Circle"),
        (places(tmp_path / "3", {"type": "Point", "coordinates": ["a", "b"]}), "Expected `float`"),
        (places(tmp_path / "4", type="Topology"), "Topology"),
    ):
        with pytest.raises(GroundError, match=words):
            Backdrop(places=path)
