"""What GDAL reads of a file or a server: an independent reader of KML, GeoJSON and OGC API - Features."""

import json
import struct
import sys
from dataclasses import dataclass, field

import numpy as np
from pyogrio import list_layers
from pyogrio.raw import read

Ring = np.ndarray
_KINDS = {1: "Point", 3: "Polygon", 6: "MultiPolygon", 7: "GeometryCollection"}


@dataclass
class Read:
    """One feature: its fields, and its geometry as rings or as a point (lon, lat)."""

    fields: dict[str, object]
    kind: str
    rings: list[Ring]
    point: tuple[float, float] | None


def layers(source: str) -> list[str]:
    return [str(name) for name, _ in list_layers(source)]


def features(source: str, layer: str | None = None) -> list[Read]:
    meta, _, geometries, columns = read(source, layer=layer)
    found = []
    for i, wkb in enumerate(geometries):
        values = {str(name): columns[j][i] for j, name in enumerate(meta["fields"])}
        shape = _Shape() if wkb is None else _shape(bytes(wkb))
        found.append(Read(values, shape.kind, shape.rings, shape.point))
    return found


@dataclass
class _Shape:
    kind: str = ""
    rings: list[Ring] = field(default_factory=list)
    point: tuple[float, float] | None = None
    end: int = 0


def _shape(wkb: bytes, at: int = 0) -> _Shape:
    """Of well-known binary, GDAL's dialect of it for heights too: points, polygons and collections of these."""
    (code,) = struct.unpack_from("<I", wkb, at + 1)
    has_height, at = bool(code & 0x8000_0000) or code >= 1_000, at + 5
    size = 3 if has_height else 2
    made = _Shape(_KINDS[(code & 0xFFFF) % 1_000])
    if made.kind == "Point":
        made.point = struct.unpack_from("<2d", wkb, at)
        made.end = at + 8 * size
        return made
    (count,) = struct.unpack_from("<I", wkb, at)
    at += 4
    for _ in range(count):
        if made.kind == "Polygon":
            (points,) = struct.unpack_from("<I", wkb, at)
            made.rings.append(np.frombuffer(wkb, "<f8", points * size, at + 4).reshape(points, size)[:, :2])
            at += 4 + points * size * 8
        else:
            part = _shape(wkb, at)
            made.rings += part.rings
            at = part.end
    made.end = at
    return made


if (
    __name__ == "__main__"
):  # in a process of its own: GDAL holds up all threads of its process while it waits for a server
    source = sys.argv[1]
    print(
        json.dumps(
            {
                name: [[one.fields, [ring.tolist() for ring in one.rings]] for one in features(source, name)]
                for name in layers(source)
            },
            default=str,
        )
    )
