"""A fire whose place of ignition is known, with who saw it, and by how much each looked beside that place."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from distloc.batch.sighting import Sighting
from distloc.batch.smoke import smoke_offset_m
from distloc.geometry.geodesy import LocalFrame
from distloc.types import FloatArray

_STAYS_M = 50.0  # a mount's places in several fires' tables


@dataclass(frozen=True, slots=True)
class Ignition:
    """Where a fire began, and one standard deviation of how well that is known, on each axis."""

    lat_deg: float
    lon_deg: float
    sigma_m: float = 0.0


@dataclass(frozen=True, slots=True)
class KnownFire:
    """A fire with its sightings; `ignition` is None where nobody knows it."""

    name: str
    sightings: tuple[Sighting, ...]
    ignition: Ignition | None


@dataclass(frozen=True, slots=True)
class Look:
    """All that one platform saw of one fire, in one number.

    `beside_rad` is the median of how far to the right of the ignition it looked, `range_m` how far that is, `smoke_m`
    how far the smoke that it saw may be from it, one standard deviation, `stamp_s` about when, 0 where no time is told.
    """

    platform: str
    fire: str
    beside_rad: float
    range_m: float
    smoke_m: float
    stamp_s: float


def looks_of(fires: Sequence[KnownFire], least_smoke_m: float) -> list[Look]:
    """One for each fire of known ignition and each fixed mount that saw it; a craft errs otherwise each day."""
    fixed = _fixed(fires)
    looks = []
    for fire in fires:
        if fire.ignition is None:
            continue
        for platform in sorted({one.platform for one in fire.sightings} & fixed):
            own = [one for one in fire.sightings if one.platform == platform]
            azimuth_rad, range_m = _towards(own[0], fire.ignition)
            beside = np.array([one.azimuth_rad for one in own]) - azimuth_rad
            beside = (beside + np.pi) % (2.0 * np.pi) - np.pi
            stamps = [one.stamp_s for one in own if one.stamp_s is not None]
            smoke_m = smoke_offset_m([own], [range_m], least_smoke_m)
            stamp_s = float(np.median(stamps)) if stamps else 0.0
            looks.append(Look(platform, fire.name, float(np.median(beside)), range_m, smoke_m, stamp_s))
    return looks


def _towards(one: Sighting, ignition: Ignition) -> tuple[float, float]:
    """The azimuth of the ignition and how far it is."""
    frame = LocalFrame(one.lat_deg, one.lon_deg, one.height_m)
    east_m, north_m, _ = frame.enu_from_geodetic(ignition.lat_deg, ignition.lon_deg, one.height_m)
    return math.atan2(east_m, north_m), math.hypot(east_m, north_m)


def _fixed(fires: Sequence[KnownFire]) -> set[str]:
    """Platforms whose sightings of all fires have one place."""
    places: dict[str, list[tuple[float, float]]] = {}
    for fire in fires:
        for one in fire.sightings:
            places.setdefault(one.platform, []).append((one.lat_deg, one.lon_deg))
    return {name for name, at in places.items() if _spread_m(np.array(at)) < _STAYS_M}


def _spread_m(places: FloatArray) -> float:
    lat_deg, lon_deg = np.ptp(places, axis=0)
    return 111_320.0 * math.hypot(lat_deg, lon_deg * math.cos(math.radians(float(places[0, 0]))))
