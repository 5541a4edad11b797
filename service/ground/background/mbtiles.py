"""Raster tiles of an MBTiles file (an SQLite database, rows counted from the south)."""

import sqlite3
from pathlib import Path

from service.common.shown import shown
from service.ground.background.tile import IMAGES, MOST_TILE_BYTES, MOST_ZOOM, Tile, Told, is_tile
from service.ground.faults import GroundError


class MBTiles:
    """Opens it for reading alone; GroundError where it is none, or holds no images."""

    def __init__(self, path: Path) -> None:
        database: sqlite3.Connection | None = None
        try:
            uri = f"{path.resolve().as_uri()}?mode=ro&immutable=1"
            database = sqlite3.connect(uri, uri=True, check_same_thread=False)
            named = {str(name): str(value) for name, value in database.execute("SELECT name, value FROM metadata")}
            zooms = database.execute("SELECT min(zoom_level), max(zoom_level) FROM tiles").fetchone()
            kind = named.get("format", "png").lower()
            if kind not in IMAGES:
                raise GroundError(f"--tiles {path}: holds {shown(kind)} tiles: give images, {', '.join(IMAGES)}")
            if not all(isinstance(one, int) for one in zooms):
                raise GroundError(f"--tiles {path}: holds no tile")
        except (sqlite3.Error, GroundError) as error:
            if database is not None:
                database.close()
            if isinstance(error, GroundError):
                raise
            raise GroundError(f"--tiles {path}: is no MBTiles file: {error}") from error
        self._database = database
        self._kind = IMAGES[kind]
        self.told = Told(
            min_zoom=max(zooms[0], 0),
            max_zoom=min(zooms[1], MOST_ZOOM),
            attribution=shown(named.get("attribution", ""), most=200),
        )

    def tile(self, zoom: int, x: int, y: int) -> Tile | None:
        """One image, rows counted from the north; None where there is none."""
        if not is_tile(zoom, x, y):
            return None
        query = "SELECT tile_data FROM tiles WHERE zoom_level=? AND tile_column=? AND tile_row=?"
        try:
            found = self._database.execute(query, (zoom, x, (1 << zoom) - 1 - y)).fetchone()
        except sqlite3.Error:
            return None
        if found is None or not isinstance(found[0], bytes) or len(found[0]) > MOST_TILE_BYTES:
            return None
        return Tile(found[0], self._kind)

    def close(self) -> None:
        """Close the file."""
        self._database.close()
