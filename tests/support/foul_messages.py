"""Every message of a drone or another ground, once for each of its strings, with that one foul; by the schema."""

import copy
from collections.abc import Iterator
from typing import Any, NamedTuple

import msgspec
from msgspec import inspect

from service.ground.picture.marks import Mark
from service.publish.parts import AdviceReport
from service.publish.wire import (
    ExplainReport,
    Report,
    SceneryReport,
    StatusReport,
    TrackReport,
    VehicleReport,
    utc_text,
)
from tests.support.ground_samples import NOW_S, report, vehicle_bytes

FOUL = "\x1b[2J</td><img src=x onerror=alert(1)><b>&\u202e\n"
TARGET = 3
_EACH = "*"  # of a list, or a key of a map


class Foul(NamedTuple):
    """Which field it is, the key and the payload."""

    field: str
    key: str
    payload: bytes


def foul_messages(vehicle: str = "drone1") -> list[Foul]:
    """All of them, none of which is a toy: each is a whole message but for the one string."""
    advice = AdviceReport(kind="leg", heading_deg=40.0, length_m=400.0, seconds=50.0, half_length_m=80.0)
    track = TrackReport(target=TARGET, state="confirmed", sightings=9, range95_m=[], lacks=["a"], says="seen")
    status = StatusReport(
        vehicle=vehicle,
        time_utc=utc_text(NOW_S),
        state="degraded",
        degraded=["compass"],
        counters={"a": 1},
        scenery=SceneryReport(state="off", reasons={"a": 1}, landmarks={"mast": "used"}),
        explain=ExplainReport(tracks=[track]),
    )
    samples: list[tuple[Any, type, str]] = [
        (report(TARGET, vehicle, degraded=["compass"], advice=advice), Report, f"targets/{TARGET}"),
        (status, StatusReport, "status"),
        (msgspec.json.decode(vehicle_bytes(vehicle), type=VehicleReport), VehicleReport, "vehicle"),
        (Mark(vehicle=vehicle, target=TARGET, time_s=NOW_S, name="Mill"), Mark, f"marks/{TARGET}"),
    ]
    return [
        Foul(f"{kind.__name__}.{'.'.join(path)}", f"distloc/{vehicle}/{rest}", msgspec.json.encode(_fouled(one, path)))
        for one, kind, rest in samples
        for path in _strings(inspect.type_info(kind))
    ]


def _strings(kind: inspect.Type) -> Iterator[tuple[str, ...]]:
    """Where a type has strings."""
    if isinstance(kind, inspect.StrType) or (
        isinstance(kind, inspect.LiteralType) and all(isinstance(one, str) for one in kind.values)
    ):
        yield ()
    elif isinstance(kind, inspect.StructType):
        for field in kind.fields:
            yield from ((field.encode_name, *path) for path in _strings(field.type))
        if kind.tag_field is not None:
            yield (kind.tag_field,)
    elif isinstance(kind, inspect.UnionType):
        for one in kind.types:
            yield from _strings(one)
    elif isinstance(kind, inspect.ListType):
        yield from ((_EACH, *path) for path in _strings(kind.item_type))
    elif isinstance(kind, inspect.DictType):
        yield (_EACH,)
        yield from (("a", *path) for path in _strings(kind.value_type))


def _fouled(one: Any, path: tuple[str, ...]) -> Any:
    whole = copy.deepcopy(msgspec.to_builtins(one))
    at = whole
    for step in path[:-1]:
        at = at[0] if step == _EACH and isinstance(at, list) else at[step]
    if path[-1] != _EACH:
        at[path[-1]] = FOUL
    elif isinstance(at, list):
        at[:] = [FOUL]
    else:
        at[FOUL] = next(iter(at.values()))
    return whole
