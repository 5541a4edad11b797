"""Image tiles, whatever file they come from: `MBTiles`, `PMTiles` and `HillShade` are `TileSource`s."""

from typing import NamedTuple, Protocol

import msgspec

MOST_ZOOM = 24
MOST_TILE_BYTES = 4_000_000
IMAGES = {"png": "image/png", "jpg": "image/jpeg", "jpeg": "image/jpeg", "webp": "image/webp"}


class Tile(NamedTuple):
    """An image's bytes and its type."""

    image: bytes
    kind: str


class Told(msgspec.Struct, frozen=True, kw_only=True):
    """What the page is told of tiles: where to ask, which zooms there are, and whom to name."""

    url: str = "tiles/{z}/{x}/{y}"
    min_zoom: int = 0
    max_zoom: int = MOST_ZOOM
    attribution: str = ""
    is_shade: bool = False


class TileSource(Protocol):
    """Called from one thread at a time."""

    told: Told

    def tile(self, zoom: int, x: int, y: int) -> Tile | None:
        """One image, rows counted from the north as maps in the browser do; None where there is none."""

    def close(self) -> None:
        """No tile is asked for afterwards."""


def is_tile(zoom: int, x: int, y: int) -> bool:
    """Whether there is such a tile in the world."""
    return 0 <= zoom <= MOST_ZOOM and 0 <= x < 1 << zoom and 0 <= y < 1 << zoom
