"""What lies under the fires: raster tiles of an MBTiles file, and places of a GeoJSON file; both are the operator's."""

import sqlite3
from pathlib import Path
from typing import Any, Literal, NamedTuple

import msgspec

from service.common.shown import shown
from service.ground.faults import GroundError

_KINDS = {"png": "image/png", "jpg": "image/jpeg", "jpeg": "image/jpeg", "webp": "image/webp"}
_MOST_ZOOM = 24
_MOST_PLACES_BYTES = 20_000_000


class Tile(NamedTuple):
    """An image's bytes and its type."""

    image: bytes
    kind: str


class Background(msgspec.Struct, frozen=True, kw_only=True):
    """What the page is told of it."""

    has_tiles: bool = False
    has_places: bool = False
    min_zoom: int = 0
    max_zoom: int = 0
    attribution: str = ""


class _Places(msgspec.Struct):
    """As much of GeoJSON as is checked."""

    type: Literal["FeatureCollection"]
    features: list[dict[str, Any]]


class Backdrop:
    """Opens both, if given; GroundError where one is no such file."""

    def __init__(self, tiles: Path | None = None, places: Path | None = None) -> None:
        self.places = None if places is None else _places(places)
        self._kind = ""
        self._database = None if tiles is None else _opened(tiles)
        self.told = Background(has_places=self.places is not None)
        if tiles is not None and self._database is not None:
            self._read(tiles, self._database)

    def tile(self, zoom: int, x: int, y: int) -> Tile | None:
        """One image, rows counted from the north as maps in the browser do; None where there is none."""
        if self._database is None or not 0 <= zoom <= _MOST_ZOOM or not (0 <= x < 1 << zoom and 0 <= y < 1 << zoom):
            return None
        query = "SELECT tile_data FROM tiles WHERE zoom_level=? AND tile_column=? AND tile_row=?"
        try:
            found = self._database.execute(query, (zoom, x, (1 << zoom) - 1 - y)).fetchone()
        except sqlite3.Error:
            return None
        return Tile(bytes(found[0]), self._kind) if found and isinstance(found[0], bytes) else None

    def _read(self, path: Path, database: sqlite3.Connection) -> None:
        try:
            named = {str(name): str(value) for name, value in database.execute("SELECT name, value FROM metadata")}
            zooms = database.execute("SELECT min(zoom_level), max(zoom_level) FROM tiles").fetchone()
        except sqlite3.Error as error:
            raise GroundError(f"--tiles {path}: is no MBTiles file: {error}") from error
        kind = named.get("format", "png").lower()
        if kind not in _KINDS:
            raise GroundError(f"--tiles {path}: holds {shown(kind)} tiles: give one with images, {', '.join(_KINDS)}")
        if zooms[0] is None:
            raise GroundError(f"--tiles {path}: holds no tile")
        self._kind = _KINDS[kind]
        self.told = msgspec.structs.replace(
            self.told,
            has_tiles=True,
            min_zoom=int(zooms[0]),
            max_zoom=min(int(zooms[1]), _MOST_ZOOM),
            attribution=shown(named.get("attribution", ""), most=200),
        )


def _opened(path: Path) -> sqlite3.Connection:
    if not path.is_file():
        raise GroundError(f"--tiles {path}: there is no such file")
    try:
        return sqlite3.connect(f"{path.resolve().as_uri()}?mode=ro&immutable=1", uri=True)
    except sqlite3.Error as error:
        raise GroundError(f"--tiles {path}: {error}") from error


def _places(path: Path) -> bytes:
    try:
        data = path.read_bytes() if path.stat().st_size <= _MOST_PLACES_BYTES else None
    except OSError as error:
        raise GroundError(f"--places {path}: {error.strerror}") from error
    if data is None:
        raise GroundError(f"--places {path}: has over {_MOST_PLACES_BYTES // 1_000_000} MB")
    try:
        msgspec.json.decode(data, type=_Places)
    except (msgspec.MsgspecError, RecursionError) as error:
        raise GroundError(f"--places {path}: is no GeoJSON FeatureCollection: {shown(error)}") from error
    return data
