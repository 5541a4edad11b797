"""Tables that look wrong as a whole: places far from all others, angles in another unit."""

import math
from collections.abc import Mapping, Sequence

import numpy as np

_FAR_DEG = 5.0  # from the others: 550 km, no camera sees so far
_NEAR_DEG = 2.0
_LEAST_ROWS = 3


def far_apart(places: Sequence[tuple[float, float]], home: tuple[float, float] | None) -> dict[int, str]:
    """A line for each place (lat, lon) that is nowhere near the others, or near `home` where that is told."""
    if home is None and len(places) < _LEAST_ROWS:
        return {}
    middle = home or _middle(places)
    found = {}
    for i, (lat, lon) in enumerate(places):
        if _apart_deg((lat, lon), middle) <= _FAR_DEG:
            continue
        near = "home is" if home else "the other rows are"
        if abs(lon) <= 90.0 and _apart_deg((lon, lat), middle) <= _NEAR_DEG:
            found[i] = f"lat {lat:g}, lon {lon:g} are swapped: {near} near {middle[0]:.2f}, {middle[1]:.2f}"
        else:
            found[i] = f"lat {lat:g}, lon {lon:g} is far off: {near} near {middle[0]:.2f}, {middle[1]:.2f}"
    return found


def looks_like_radians(rows: Sequence[Mapping[str, float]], name: str) -> str:
    """A line where no angle of a column in degrees is over 2 pi while they differ a lot; empty: all is well."""
    values = np.array([row[name] for row in rows if name in row])
    if len(values) < _LEAST_ROWS or np.abs(values).max() > 2.0 * math.pi or np.ptp(values) < 1.0:
        return ""
    radians = name.replace("_deg", "_rad")
    return f"{name} is {values.min():.4g} to {values.max():.4g} in all rows: radians go into {radians}"


def places_look_like_radians(places: Sequence[tuple[float, float]]) -> str:
    """A line where all places lie at sea off Guinea, where angles in radians would be; empty: all is well."""
    at = np.abs(np.array(places)).reshape(-1, 2)
    if len(at) < _LEAST_ROWS or at[:, 0].max() > 0.5 * math.pi or at[:, 1].max() > math.pi:
        return ""
    return f"lat and lon are at most {at[:, 0].max():.4g} and {at[:, 1].max():.4g}: radians go into lat_rad and lon_rad"


def _middle(places: Sequence[tuple[float, float]]) -> tuple[float, float]:
    """The place that has most others near it, so that a few wrong ones don't move it."""
    some = np.array(places)[np.unique(np.linspace(0, len(places) - 1, min(len(places), 400)).astype(np.intp))]
    apart = np.abs(some[:, None] - some[None])
    apart[..., 1] = np.minimum(apart[..., 1], 360.0 - apart[..., 1])
    lat, lon = some[int(np.argmax((apart.max(axis=2) < _NEAR_DEG).sum(axis=1)))]
    return float(lat), float(lon)


def _apart_deg(one: tuple[float, float], other: tuple[float, float]) -> float:
    beside = abs(one[1] - other[1]) % 360.0
    return max(abs(one[0] - other[0]), min(beside, 360.0 - beside) * math.cos(math.radians(other[0])))
