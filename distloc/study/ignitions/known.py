"""A fire whose place of ignition is known, with who saw it, and by how much each looked beside that place."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from distloc.batch.sighting import Sighting
from distloc.geometry.geodesy import LocalFrame
from distloc.types import FloatArray

_MAD = 1.4826  # of a normal distribution, one standard deviation by the median distance from the median
_EDGE = 3.0**0.5  # half the width of what is marked, by one standard deviation of anywhere within it
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


def smoke_offset_m(groups: Sequence[Sequence[Sighting]], ranges_m: Sequence[float], least_m: float) -> float:
    """How far from its fire the smoke is that was seen, one standard deviation, by the sightings themselves.

    Of each platform's sightings (`groups`) with its range: a plume that leans stands at the edge of what is marked, and
    azimuths scatter over time as it grows and the wind turns. Each sees of the offset what lies across its line of
    sight, so the mean of the squares is its variance on each axis.
    """
    squares = []
    for own, range_m in zip(groups, ranges_m, strict=True):
        edge_rad = _EDGE * float(np.median([one.sigma_rad[0] for one in own]))
        squares.append((range_m * math.hypot(edge_rad, _scatter_rad([one.azimuth_rad for one in own]))) ** 2)
    return max(least_m, math.sqrt(float(np.mean(squares)))) if squares else least_m


def _scatter_rad(azimuths_rad: Sequence[float]) -> float:
    """One standard deviation of angles about their middle, of which up to half may be of something else."""
    angles = np.asarray(azimuths_rad)
    middle = float(np.angle(np.exp(1j * angles).mean()))
    beside: FloatArray = (angles - middle + np.pi) % (2.0 * np.pi) - np.pi
    return _MAD * float(np.median(np.abs(beside - np.median(beside))))


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
