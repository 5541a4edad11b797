"""How far from its fire the smoke is that was marked, and places widened by it; `locate` and `study fires` use it."""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from distloc.batch.place import Bearing, Place
from distloc.batch.sighting import Sighting
from distloc.filter.uncertainty import blurred
from distloc.geometry.geodesy import LocalFrame
from distloc.types import FloatArray

_MAD = 1.4826  # of a normal distribution, one standard deviation by the median distance from the median
_EDGE = 3.0**0.5  # half the width of what is marked, by one standard deviation of anywhere within it
_Z95 = 1.96


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


def widened(place: Place, sightings: Sequence[Sighting]) -> Place:
    """The place with its regions and intervals widened by how far smoke is from its fire, where smoke was marked.

    Its height is left: that of the smoke's foot. `sightings` are all that `place.used` numbers.
    """
    used = [sightings[i] for i in place.used]
    least_m = max((one.smoke_offset_m for one in used), default=0.0)
    if least_m <= 0.0:
        return place
    smoke_m = _found_m(place, used, least_m)
    level_m2 = smoke_m**2 * np.eye(2)
    wide = replace(place, smoke_offset_m=smoke_m, bearing=_wide_bearing(place.bearing, smoke_m))
    if place.ellipse95 is None or place.covariance_enu_m2 is None:
        return wide
    covariance = place.covariance_enu_m2.copy()
    covariance[:2, :2] += level_m2
    further = place.further and replace(place.further, ellipse95=blurred(place.further.ellipse95, level_m2))
    return replace(wide, covariance_enu_m2=covariance, ellipse95=blurred(place.ellipse95, level_m2), further=further)


def _found_m(place: Place, used: Sequence[Sighting], least_m: float) -> float:
    if place.lat_deg is None or place.lon_deg is None:
        return least_m
    groups: dict[str, list[Sighting]] = {}
    for one in used:
        groups.setdefault(one.platform, []).append(one)
    ranges_m = []
    for own in groups.values():
        frame = LocalFrame(own[0].lat_deg, own[0].lon_deg, own[0].height_m)
        ranges_m.append(float(np.hypot(*frame.enu_from_geodetic(place.lat_deg, place.lon_deg, own[0].height_m)[:2])))
    return smoke_offset_m(list(groups.values()), ranges_m, least_m)


def _wide_bearing(bearing: Bearing, smoke_m: float) -> Bearing:
    """By the smoke's angle where it may be nearest, and its length along the line of sight."""
    near_m = max(bearing.range95_m[0], 1.0)
    azimuth95_rad = min(math.hypot(bearing.azimuth95_rad, math.atan(_Z95 * smoke_m / near_m)), math.pi)
    parts: list[tuple[float, float]] = []
    for low_m, high_m in sorted(_wide_interval(part, smoke_m) for part in bearing.parts95_m):
        if parts and low_m <= parts[-1][1]:
            parts[-1] = parts[-1][0], max(parts[-1][1], high_m)
        else:
            parts.append((low_m, high_m))
    return replace(
        bearing,
        azimuth95_rad=azimuth95_rad,
        range95_m=_wide_interval(bearing.range95_m, smoke_m),
        parts95_m=tuple(parts),
    )


def _wide_interval(ends_m: tuple[float, float], smoke_m: float) -> tuple[float, float]:
    low_m, high_m = ends_m
    if math.isinf(high_m):
        return max(low_m - _Z95 * smoke_m, 1.0), high_m
    more_m = math.hypot(0.5 * (high_m - low_m), _Z95 * smoke_m) - 0.5 * (high_m - low_m)
    return max(low_m - more_m, min(low_m, 1.0)), high_m + more_m


def _scatter_rad(azimuths_rad: Sequence[float]) -> float:
    """One standard deviation of angles about their middle, of which up to half may be of something else."""
    angles: FloatArray = np.asarray(azimuths_rad)
    middle = float(np.angle(np.exp(1j * angles).mean()))
    beside: FloatArray = (angles - middle + np.pi) % (2.0 * np.pi) - np.pi
    return _MAD * float(np.median(np.abs(beside - np.median(beside))))
