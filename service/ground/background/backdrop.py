"""What lies under the fires, as the command line says it: tiles of a file or a server, else hill shade; and places."""

import re
import threading
from pathlib import Path
from typing import Self
from urllib.parse import urlsplit

import msgspec

from service.common.shown import shown
from service.ground.background.mbtiles import MBTiles
from service.ground.background.places import read_places
from service.ground.background.pmtiles import PMTiles
from service.ground.background.tile import Tile, TileSource, Told
from service.ground.faults import GroundError

_ORIGIN = re.compile(r"https?://([A-Za-z0-9.-]+|\[[0-9A-Fa-f:.]+\])(:[0-9]{1,5})?")
_PATH = re.compile(r"[!-~]*")  # printable ASCII without a blank
_SERVER_MAX_ZOOM = 19


class Background(msgspec.Struct, frozen=True, kw_only=True):
    """What the page is told of it."""

    tiles: Told | None = None
    has_places: bool = False


class Backdrop:
    """Opens what is given; GroundError where one is no such file. `origin` is a tile server's, else empty."""

    def __init__(
        self, tiles: str | None = None, dem: Path | None = None, places: Path | None = None, attribution: str = ""
    ) -> None:
        self.places = None if places is None else read_places(places)
        self.origin = ""
        self._lock = threading.Lock()
        self._source: TileSource | None = None
        told = None
        if tiles is not None and "://" in tiles:
            self.origin = _origin(tiles)
            told = Told(url=tiles, max_zoom=_SERVER_MAX_ZOOM)
        elif tiles is not None:
            self._source = _opened(Path(tiles))
        elif dem is not None:
            from service.ground.background.hill_shade import HillShade  # the DEM's reader: only who gives one pays

            self._source = HillShade(dem)
        told = self._source.told if self._source is not None else told
        if told is not None and attribution:
            told = msgspec.structs.replace(told, attribution=shown(attribution, most=200))
        self.told = Background(tiles=told, has_places=self.places is not None)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_exception: object) -> None:
        with self._lock:
            if self._source is not None:
                self._source.close()
            self._source = None

    def tile(self, zoom: int, x: int, y: int) -> Tile | None:
        """One image, rows counted from the north; None where there is none. From any thread; it may take its time."""
        with self._lock:
            return None if self._source is None else self._source.tile(zoom, x, y)


def _opened(path: Path) -> TileSource:
    try:
        with path.open("rb") as file:
            begin = file.read(16)
    except OSError as error:
        raise GroundError(f"--tiles {path}: {error.strerror}") from error
    if begin.startswith(b"PMTiles"):
        return PMTiles(path)
    if begin.startswith(b"SQLite format 3"):
        return MBTiles(path)
    raise GroundError(
        f"--tiles {path}: is neither an MBTiles nor a PMTiles file, nor a URL with {{z}}, {{x}} and {{y}}"
    )


def _origin(url: str) -> str:
    """The server's, as a Content-Security-Policy names it."""
    try:
        parts = urlsplit(url)
        origin = f"{parts.scheme}://{parts.netloc}"
    except ValueError:  # an address of IPv6 that is none
        origin = ""
    if not _ORIGIN.fullmatch(origin) or not _PATH.fullmatch(url):
        raise GroundError(f"--tiles {shown(url)}: is no http or https address of a tile server")
    if sorted(re.findall(r"\{[^}]*\}?", url)) != ["{x}", "{y}", "{z}"]:
        raise GroundError(f"--tiles {shown(url)}: must have {{z}}, {{x}} and {{y}}, once each, and no other braces")
    return origin
