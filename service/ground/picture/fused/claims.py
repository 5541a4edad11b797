"""Drones' reports as `distloc.batch.fusion` takes them, in planes about the places where fires of several may meet."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from distloc.batch.fusion.claims import Claim
from distloc.batch.fusion.shared import aim_sigma_m, shared_part
from distloc.filter.uncertainty import CHI2_95
from distloc.geometry.geodesy import LocalFrame
from distloc.types import FloatArray
from service.ground.picture.fire import Fire
from service.ground.picture.fused.twins import Shapes

MOST_TOGETHER = 32  # claims that are compared with each other: more take seconds
_REACH = 3.0  # times the ellipses' sizes: a confidently wrong drone is near enough to be named
_EARTH_M = 6_371_000.0
_LIVE = frozenset({"confirmed", "coasting", "tentative"})


@dataclass(frozen=True, slots=True)
class Plane:
    """A plane about one place, and what drones claim in it."""

    frame: LocalFrame
    claims: tuple[Claim, ...]

    def degrees(self, position_en_m: FloatArray) -> tuple[float, float]:
        """Latitude and longitude."""
        fallen_m = float(position_en_m @ position_en_m) / (2.0 * _EARTH_M)  # the sea's level lies under the plane
        lat_deg, lon_deg, _ = self.frame.geodetic_from_enu(np.array([*position_en_m, -fallen_m]))
        return float(lat_deg), float(lon_deg)


def is_claim(fire: Fire) -> bool:
    """Whether a report can be fused: a fire that stands still, with a range that is bounded."""
    said, geometry = fire.report.properties, fire.report.geometry
    if said.state not in _LIVE or said.motion == "moving" or geometry is None or said.bearing_deg is None:
        return False
    if said.range_m is None or not 1.0 <= said.range_m <= 200_000.0 or abs(said.bearing_deg) > 360.0:
        return False
    major_m = said.ellipse95.semi_major_m
    is_place = said.motion == "fixed" and major_m is not None and major_m <= said.range_m
    return major_m is not None and (said.state != "tentative" or is_place)


def planes(
    fires: Mapping[str, Fire], age_s: Mapping[str, float], by_terrain: frozenset[str]
) -> tuple[list[Plane], int]:
    """A plane for each place where fires of several drones may meet, each fire in one; and how many had no room.

    `age_s` says how long ago each was seen, `by_terrain` which drones have their ranges from the terrain.
    """
    usable = {one: fire for one, fire in sorted(fires.items()) if is_claim(fire)}
    shapes = Shapes.of(usable)
    found, left_out = [], 0
    first, second = shapes.near(_REACH)
    for rows in _components(len(shapes.ids), first.tolist(), second.tolist()):
        surest = sorted(rows, key=lambda i: (shapes.values[i, 2] * shapes.values[i, 3], shapes.ids[i]))
        is_shared = len({usable[shapes.ids[i]].vehicle for i in rows}) > 1
        together = surest[:MOST_TOGETHER] if is_shared else []
        alone = [[i] for i in surest[len(together) :]]
        left_out += len(alone) if is_shared else 0
        for part in ([together] if together else []) + alone:
            frame = LocalFrame(float(shapes.values[part[0], 0]), float(shapes.values[part[0], 1]), 0.0)
            own = (shapes.ids[i] for i in part)
            claims = tuple(_claim(one, usable[one], frame, age_s.get(one, 0.0), by_terrain) for one in own)
            found.append(Plane(frame, claims))
    return found, left_out


def _claim(name: str, fire: Fire, frame: LocalFrame, age_s: float, by_terrain: frozenset[str]) -> Claim:
    said, geometry = fire.report.properties, fire.report.geometry
    assert geometry is not None and said.bearing_deg is not None and said.range_m is not None
    one = said.ellipse95
    assert one.semi_major_m is not None and one.semi_minor_m is not None and one.azimuth_deg is not None
    lon_deg, lat_deg = geometry.coordinates[:2]
    covariance = _matrix(one.azimuth_deg, one.semi_major_m**2, one.semi_minor_m**2) / CHI2_95
    bearing_rad = math.radians(said.bearing_deg)
    lean_deg = None if said.plume is None else said.plume.lean_deg
    aim_m = aim_sigma_m(None if lean_deg is None else math.radians(lean_deg))
    terrain_rad = bearing_rad if fire.vehicle in by_terrain else None
    return Claim(
        name=name,
        vehicle=fire.vehicle,
        position_en_m=frame.enu_from_geodetic(lat_deg, lon_deg, 0.0)[:2],
        covariance_m2=covariance,
        shared_m2=shared_part(covariance, aim_m, terrain_rad=terrain_rad),
        bearing_rad=bearing_rad,
        range_m=said.range_m,
        age_s=max(age_s, 0.0),
        span_s=fire.seen_for_s,
    )


def _matrix(azimuth_deg: float, major: float, minor: float) -> FloatArray:
    along = np.array([math.sin(math.radians(azimuth_deg)), math.cos(math.radians(azimuth_deg))])
    return minor * np.eye(2) + (major - minor) * np.outer(along, along)


def _components(count: int, first: Sequence[int], second: Sequence[int]) -> Iterator[list[int]]:
    """What hangs together by pairs, each in order."""
    root = list(range(count))

    def top(i: int) -> int:
        while root[i] != i:
            root[i] = root[root[i]]
            i = root[i]
        return i

    for i, j in zip(first, second, strict=True):
        a, b = top(int(i)), top(int(j))
        root[max(a, b)] = min(a, b)
    parts: dict[int, list[int]] = {}
    for i in range(count):
        parts.setdefault(top(i), []).append(i)
    yield from parts.values()
