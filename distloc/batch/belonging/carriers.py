"""Who carried the camera of each sighting, where a name alone does not say it; and sightings that are one twice."""

from collections.abc import Sequence

import numpy as np

from distloc.batch.sighting import Sighting
from distloc.geometry.geodesy import ecef_from_geodetic

_FASTEST_MPS = 340.0  # nothing that carries a camera past a fire is faster
_GRACE_M = 200.0  # positions of one time, of two receivers or rounded


def carriers_of(sightings: Sequence[Sighting]) -> tuple[list[str], list[str]]:
    """A platform's name for each sighting, and a line for each name that was in two places at once.

    Such a name is taken as that of several platforms, told apart by where they can have come from.
    """
    names = [one.platform for one in sightings]
    lines: list[str] = []
    for name in sorted(set(names)):
        own = sorted(
            (i for i, other in enumerate(names) if other == name and sightings[i].stamp_s is not None),
            key=lambda i: (sightings[i].stamp_s, sightings[i].lat_deg, sightings[i].lon_deg),
        )
        ways: list[tuple[float, np.ndarray[tuple[int], np.dtype[np.float64]]]] = []
        for i in own:
            one = sightings[i]
            stamp_s, at_m = one.stamp_s or 0.0, ecef_from_geodetic(one.lat_deg, one.lon_deg, one.height_m)
            reach = [
                float(np.linalg.norm(at_m - place)) - _GRACE_M - _FASTEST_MPS * (stamp_s - then) for then, place in ways
            ]
            which = int(np.argmin(reach)) if reach and min(reach) <= 0.0 else len(ways)
            if which == len(ways):
                ways.append((stamp_s, at_m))
                if which > 0:
                    names[i] = f"{name}#{which + 1}"
            else:
                ways[which] = stamp_s, at_m
                names[i] = name if which == 0 else f"{name}#{which + 1}"
        if len(ways) > 1:
            lines.append(f"platform {name!r} is in {len(ways)} places at once: taken as {len(ways)} platforms")
    return names, lines


def duplicates_of(sightings: Sequence[Sighting]) -> dict[int, int]:
    """Which sightings repeat an earlier one in every number, and that one."""
    first: dict[tuple[object, ...], int] = {}
    found = {}
    for i, one in enumerate(sightings):
        key = (
            one.platform, one.stamp_s, one.lat_deg, one.lon_deg, one.height_m, *one.direction_enu.tolist(), one.target
        )  # fmt: skip
        if first.setdefault(key, i) != i:
            found[i] = first[key]
    return found
