"""Places, roads and parcels of a GeoJSON file, checked here so that none breaks the page; names are text there."""

from pathlib import Path
from typing import Annotated, Any, Literal

import msgspec

from service.common.shown import shown
from service.ground.faults import GroundError

MOST_BYTES = 20_000_000

_Position = Annotated[list[float], msgspec.Meta(min_length=2)]
_Line = list[_Position]


class _Geometry(msgspec.Struct, tag_field="type"):
    pass


class _Point(_Geometry, tag="Point"):
    coordinates: _Position


class _MultiPoint(_Geometry, tag="MultiPoint"):
    coordinates: _Line


class _LineString(_Geometry, tag="LineString"):
    coordinates: _Line


class _MultiLineString(_Geometry, tag="MultiLineString"):
    coordinates: list[_Line]


class _Polygon(_Geometry, tag="Polygon"):
    coordinates: list[_Line]


class _MultiPolygon(_Geometry, tag="MultiPolygon"):
    coordinates: list[list[_Line]]


_Shape = _Point | _MultiPoint | _LineString | _MultiLineString | _Polygon | _MultiPolygon


class _Feature(msgspec.Struct):
    type: Literal["Feature"]
    geometry: _Shape | None
    properties: dict[str, Any] | None = None


class _Places(msgspec.Struct):
    type: Literal["FeatureCollection"]
    features: list[_Feature]


def read_places(path: Path) -> bytes:
    """The file's bytes; GroundError where it is no such file."""
    try:
        data = path.read_bytes() if path.stat().st_size <= MOST_BYTES else None
    except OSError as error:
        raise GroundError(f"--places {path}: {error.strerror}") from error
    if data is None:
        raise GroundError(f"--places {path}: has over {MOST_BYTES // 1_000_000} MB: cut it to the area, or simplify it")
    try:
        msgspec.json.decode(data, type=_Places)
    except (msgspec.MsgspecError, RecursionError) as error:
        raise GroundError(f"--places {path}: is no GeoJSON FeatureCollection: {shown(error)}") from error
    return data
