"""Tables that look wrong as a whole: places far from all others, angles in another unit."""

import math
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

_FAR_DEG = 5.0  # from the others: 550 km, no camera sees so far
_NEAR_DEG = 2.0
_LEAST_ROWS = 3
_MOST_COMPARED = 400  # rows of one target, platform or table


def far_apart(
    places: Sequence[tuple[float, float]],
    home: tuple[float, float] | None,
    targets: Sequence[str] = (),
    platforms: Sequence[str] = (),
) -> dict[int, str]:
    """A line for each place (lat, lon) that is nowhere near the others, or near `home` where that is told.

    The others are those of the same target, where `targets` names one for each place: a table may span a state. Where
    a target's own rows are as many here as there, those of the same of `platforms` tell, then all. Where nothing
    tells there is no line.
    """
    if home is not None:
        return _far_from(places, range(len(places)), home, "home is")
    if len(places) < _LEAST_ROWS:
        return {}
    found: dict[int, str] = {}
    by_platform = _rows_of(platforms)
    for rows in _rows_of(targets or [""] * len(places)).values():
        middle = _middle(places, rows, [by_platform.get(platforms[i], []) if platforms else [] for i in rows])
        if middle is not None:
            found |= _far_from(places, rows, middle, "the other rows are")
    return found


def _far_from(
    places: Sequence[tuple[float, float]], rows: Sequence[int], middle: tuple[float, float], near: str
) -> dict[int, str]:
    found = {}
    for i in rows:
        lat, lon = places[i]
        if _apart_deg((lat, lon), middle) <= _FAR_DEG:
            continue
        if abs(lon) <= 90.0 and _apart_deg((lon, lat), middle) <= _NEAR_DEG:
            found[i] = f"lat {lat:g}, lon {lon:g} are swapped: {near} near {middle[0]:.2f}, {middle[1]:.2f}"
        else:
            found[i] = f"lat {lat:g}, lon {lon:g} is far off: {near} near {middle[0]:.2f}, {middle[1]:.2f}"
    return found


def _rows_of(names: Sequence[str]) -> dict[str, list[int]]:
    found: dict[str, list[int]] = {}
    for row, name in enumerate(names):
        found.setdefault(name, []).append(row)
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


def _middle(
    places: Sequence[tuple[float, float]], rows: Sequence[int], of_platform: Sequence[Sequence[int]]
) -> tuple[float, float] | None:
    """The place of `rows` that has most of them near it, so that a few wrong ones don't move it.

    Of two with as many, the one with more rows of its platform near it, then of all; None where these are as many too.
    `of_platform` has the rows of each one's platform.
    """
    picked = _some(range(len(rows)))
    some = [places[rows[k]] for k in picked]
    votes = [(int(_are_near(one, some).sum()),) for one in some]
    if all(vote == (len(some),) for vote in votes):
        return some[0]
    whole = [places[i] for i in _some(range(len(places)))]
    best: list[tuple[int, int, int]] = []
    for k, one, (near,) in zip(picked, some, votes, strict=True):
        own = [places[i] for i in _some(of_platform[k])]
        best.append((near, int(_are_near(one, own).sum()), int(_are_near(one, whole).sum())))
    first = max(range(len(some)), key=lambda k: best[k])
    far = [best[k] for k in range(len(some)) if _apart_deg(some[k], some[first]) > _FAR_DEG]
    return None if best[first] in far else some[first]


def _some(rows: Sequence[int]) -> list[int]:
    """At most so many, evenly spread."""
    return [rows[i] for i in np.unique(np.linspace(0, len(rows) - 1, min(len(rows), _MOST_COMPARED)).astype(np.intp))]


def _are_near(one: tuple[float, float], others: Sequence[tuple[float, float]]) -> NDArray[np.bool_]:
    apart = np.abs(np.array(others).reshape(-1, 2) - one)
    apart[:, 1] = np.minimum(apart[:, 1], 360.0 - apart[:, 1])
    return np.asarray(apart.max(axis=1) < _NEAR_DEG)


def _apart_deg(one: tuple[float, float], other: tuple[float, float]) -> float:
    beside = abs(one[1] - other[1]) % 360.0
    return max(abs(one[0] - other[0]), min(beside, 360.0 - beside) * math.cos(math.radians(other[0])))
