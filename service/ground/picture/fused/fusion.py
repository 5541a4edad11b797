"""The fused layer: drones' fires and towers' bearings that are one fire, made so once a second. Free of I/O."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from distloc.batch.fusion.claims import FusedFire
from distloc.batch.fusion.fuse import SETTLED_S, fuse
from distloc.batch.fusion.names import Names
from distloc.batch.fusion.towers import tightened
from distloc.filter.uncertainty import CHI2_95, circular_error90_m
from distloc.geometry.geodesy import LocalFrame
from distloc.types import FloatArray
from service.ground.picture.coordinates import PlaceTexts, place_texts
from service.ground.picture.fire import Fire
from service.ground.picture.fused.claims import Plane, planes
from service.ground.picture.fused.fronts import front_views
from service.ground.picture.fused.towers import Towers
from service.ground.picture.fused.twins import twins
from service.ground.picture.views import FrontView
from service.publish.parts import EllipseReport

PREFIX = "fused/"
_TOWERS_REACH_M = 60_000.0


@dataclass(frozen=True, slots=True)
class Joined:
    """A fused fire with its place in degrees; `fire.covariance_m2` is in east and north there.

    Other programs know it by `uid`, which stays as long as its id.
    """

    uid: str
    fire: FusedFire
    lat_deg: float
    lon_deg: float
    ellipse95: EllipseReport
    ce90_m: float
    place: PlaceTexts


@dataclass(frozen=True, slots=True)
class Asked:
    """Drones' fires as they were at one time; `before` names the fused fire of each, `fresh` are known for seconds."""

    fires: Mapping[str, Fire]
    age_s: Mapping[str, float]
    by_terrain: frozenset[str]
    fresh: frozenset[str]
    before: Mapping[str, str]
    now_s: float


@dataclass(frozen=True, slots=True)
class Compared:
    """What is one fire by the drones alone, which fires may be one, and how many had no room."""

    asked: Asked
    fused: Sequence[tuple[Plane, FusedFire]]
    twins: Mapping[str, list[str]]
    left_out: int


def compared(asked: Asked) -> Compared:
    """Fuse these: what takes long, in any thread."""
    found, left_out = planes(asked.fires, asked.age_s, asked.by_terrain)
    fused = [
        (plane, one) for plane in found for one in fuse(plane.claims, before=asked.before, fresh=asked.fresh).fires
    ]
    return Compared(asked, fused, twins(asked.fires), left_out)


class Fusion:
    """`asked`, `compared` and `take` are the three steps of looking anew.

    `joined` has the fused fires by id, `fused_of` which of them a drone's fire is part of.
    """

    def __init__(self) -> None:
        self.towers = Towers()
        self.joined: dict[str, Joined] = {}
        self.fused_of: dict[str, str] = {}
        self.outvoted_by: dict[str, str] = {}
        self.fronts: list[FrontView] = []
        self.left_out = 0
        self._names = Names()
        self._twins: dict[str, list[str]] = {}

    def asked(
        self, fires: Mapping[str, Fire], age_s: Mapping[str, float], by_terrain: frozenset[str], now_s: float
    ) -> Asked:
        """What `compared` is to look at: nothing in it changes when the picture does."""
        fresh = frozenset(one for one, fire in fires.items() if now_s - fire.since_s < SETTLED_S)
        return Asked(dict(fires), dict(age_s), by_terrain, fresh, dict(self._names.fire_of), now_s)

    def take(self, found: Compared) -> set[str]:
        """Ids of all, drones' and fused ones, of which something is another now or gone."""
        fires = found.asked.fires
        self.towers.forget(found.asked.now_s)
        self.left_out = found.left_out
        fused, biases = self._with_towers(list(found.fused))
        names = self._names.name([one for _, one in fused], {one: fires[one].first_s for one in _claimed(fused)})
        changed = self._keep(fused, names, fires)
        self._learn(fused, names, biases)
        self.fronts = front_views(fused, [PREFIX + name for name in names], fires, self.joined.keys())
        return changed | self._pair(found.twins)

    def set_clock_on(self, step_s: float) -> None:
        """The ground's own clock was set by so much."""
        self.towers.set_clock_on(step_s)

    def shown(self, one: str) -> str:
        """The id that a drone's fire is shown under."""
        return self.fused_of.get(one, one)

    def twins_of(self, one: str) -> list[str]:
        """Ids of fires that may be the same and are not fused, each as it is shown."""
        members = self.joined[one].fire.used if one in self.joined else (one,)
        others = [self.shown(other) for member in members for other in self._twins.get(member, ())]
        return [other for other in dict.fromkeys(others) if other != self.shown(one)][:8]

    def _with_towers(
        self, fused: list[tuple[Plane, FusedFire]]
    ) -> tuple[list[tuple[Plane, FusedFire]], dict[str, tuple[float, float, int]]]:
        """All of them in one plane where towers are: a mount's error is the same for all that a tower sees."""
        frame = self.towers.frame()
        if frame is None:
            return fused, {}
        bearings = self.towers.bearings(frame)
        moved = [_moved(plane, one, frame) for plane, one in fused]
        outvoted = {word.name for _, one in fused for word in one.outvoted}
        near = [
            index
            for index, one in enumerate(moved)
            if float(np.linalg.norm(one.position_en_m)) < _TOWERS_REACH_M and not outvoted.intersection(one.used)
        ]
        tighter, biases = tightened([moved[index] for index in near], bearings)
        plane = Plane(frame, ())
        for index, one in zip(near, tighter, strict=True):
            if one.bearings:
                fused[index] = plane, one
        return fused, {one.tower: (one.bias_rad, one.sigma_rad, one.fires) for one in biases}

    def _keep(self, fused: list[tuple[Plane, FusedFire]], names: list[str], fires: Mapping[str, Fire]) -> set[str]:
        was, fused_was, outvoted_was = self.joined, self.fused_of, self.outvoted_by
        self.joined, self.fused_of, self.outvoted_by = {}, {}, {}
        for (plane, one), name in zip(fused, names, strict=True):
            if not self._names.is_joined(name):
                continue
            known = was.get(PREFIX + name)
            uid = _uid(name, fires) if known is None else known.uid
            self.joined[PREFIX + name] = _joined(plane, one, uid, known)
            for member in (*one.used, *one.undecided):
                self.fused_of[member] = PREFIX + name
        for fused_id, kept in self.joined.items():
            for word in kept.fire.outvoted:
                self.outvoted_by[word.name] = fused_id
        changed = {one for one in was.keys() | self.joined.keys() if was.get(one) is not self.joined.get(one)}
        for before, after in ((fused_was, self.fused_of), (outvoted_was, self.outvoted_by)):
            changed |= {one for one in before.keys() | after.keys() if before.get(one) != after.get(one)}
        return changed

    def _learn(
        self, fused: list[tuple[Plane, FusedFire]], names: list[str], biases: dict[str, tuple[float, float, int]]
    ) -> None:
        of = {bearing: PREFIX + name for (_, one), name in zip(fused, names, strict=True) for bearing in one.bearings}
        self.towers.learn(biases, of)

    def _pair(self, found: Mapping[str, list[str]]) -> set[str]:
        changed = {one for one in found.keys() | self._twins.keys() if found.get(one) != self._twins.get(one)}
        self._twins = dict(found)
        return changed | {self.shown(one) for one in changed}


def _claimed(fused: list[tuple[Plane, FusedFire]]) -> list[str]:
    return [name for _, one in fused for name in (*one.used, *one.undecided)]


def _moved(plane: Plane, one: FusedFire, frame: LocalFrame) -> FusedFire:
    """In another plane; the axes of two that are within 100 km of each other are all but parallel."""
    lat_deg, lon_deg = plane.degrees(one.position_en_m)
    return replace(one, position_en_m=frame.enu_from_geodetic(lat_deg, lon_deg, 0.0)[:2])


def _joined(plane: Plane, one: FusedFire, uid: str, before: Joined | None) -> Joined:
    lat_deg, lon_deg = (round(value, 7) for value in plane.degrees(one.position_en_m))
    if before is not None and (before.lat_deg, before.lon_deg) == (lat_deg, lon_deg):
        place = before.place
    else:
        place = place_texts(lat_deg, lon_deg)
    ce90_m = round(circular_error90_m(one.covariance_m2), 1)
    found = Joined(uid, one, lat_deg, lon_deg, ellipse95(one.covariance_m2), ce90_m, place)
    return before if before is not None and _is_as(before, found) else found


def _uid(name: str, fires: Mapping[str, Fire]) -> str:
    """By the fire that it is named after and when that was first seen: the same at each ground, and after a restart."""
    first = fires.get(name.rstrip("+"))
    more = name[len(name.rstrip("+")) :]
    named = name.replace("/", ".") if first is None else first.uid.removeprefix("distloc.") + more
    return f"distloc.fused.{named}"


def _is_as(one: Joined, other: Joined) -> bool:
    """But for numbers that are shown to nobody."""
    names = ((o.fire.used, o.fire.undecided, o.fire.bearings, [w.name for w in o.fire.outvoted]) for o in (one, other))
    first, second = names
    return (one.place, one.ellipse95, first) == (other.place, other.ellipse95, second)


def ellipse95(covariance_m2: FloatArray) -> EllipseReport:
    """The 95 % ellipse of a covariance (2, 2), to a decimetre."""
    values, vectors = np.linalg.eigh(covariance_m2)
    minor, major = np.sqrt(CHI2_95 * np.maximum(values, 1e-6))
    azimuth_deg = math.degrees(math.atan2(vectors[0, 1], vectors[1, 1])) % 180.0
    return EllipseReport(
        semi_major_m=round(float(major), 1), semi_minor_m=round(float(minor), 1), azimuth_deg=round(azimuth_deg, 1)
    )
