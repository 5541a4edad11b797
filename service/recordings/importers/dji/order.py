"""Which of two numbers is the latitude, and whether they are degrees; decided by the whole file, never row by row."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from distloc.types import FloatArray
from service.recordings.importers.dji.words import Tuple3, Words
from service.recordings.importers.flight import ImportRefusedError, Remarks
from service.recordings.importers.rows import count

_EARTH_M = 111_195.0  # a degree of latitude
_TOLD_BY = 3.0  # so many times as well must one order fit the distances that the craft tells
_LEAST_MISFIT = 0.02  # of the distance; the craft tells whole or hundredth metres
_LEAST_ROWS = 5
_LEAST_WAY_M = 30.0
_FARTHEST_M = 100_000.0  # from the middle of a film's places


@dataclass(frozen=True)
class Places:
    """`lat_deg`, `lon_deg` (N,), NaN where a cue has none; `resolution_m` is the step of the digits as written."""

    lat_deg: FloatArray
    lon_deg: FloatArray
    resolution_m: float


def places_of(source: str, rows: Sequence[Words], time_s: FloatArray, remarks: Remarks) -> Places:
    """The craft's places; ImportRefusedError where latitude and longitude cannot be told apart."""
    keyed = np.array([(one.number("latitude"), one.number("longitude")) for one in rows]).reshape(-1, 2)
    texts = [one.keyed.get("latitude", "") for one in rows]
    if np.isfinite(keyed).all(axis=1).any():
        lat, lon = _named(source, keyed, remarks)
    else:
        pairs = _pairs(rows, "GPS")
        lat, lon = _ordered(source, rows, pairs, time_s, remarks)
        texts = [one.functions["GPS"].texts[0] if "GPS" in one.functions else "" for one in rows]
    step_deg = 10.0 ** -max((len(one.replace(",", ".").partition(".")[2]) for one in texts), default=0)
    lat, lon, step_deg = _degrees(lat, lon, step_deg, remarks)
    lat, lon = _together(lat, lon, remarks)
    return Places(lat, lon, step_deg * _EARTH_M)


def _named(source: str, keyed: FloatArray, remarks: Remarks) -> tuple[FloatArray, FloatArray]:
    """Under their names; the names themselves may be swapped, which only the range tells."""
    lat, lon = keyed[:, 0], keyed[:, 1]
    is_past = np.abs(lat) > 90.0
    if not is_past.any():
        return lat, lon
    is_swapped = np.nanmax(np.abs(lat)) <= 180.0 and np.nanmax(np.abs(lon)) <= 90.0
    if is_swapped and is_past[np.isfinite(lat)].all():
        remarks.assumed.append(f"latitude and longitude are swapped in the file: no latitude is {lat[is_past][0]:g}")
        return lon, lat
    if is_past.mean() > 0.5:
        raise ImportRefusedError(f"{source}: latitude {lat[is_past][0]:g}: must be -90 to 90 degrees")
    return np.where(is_past, np.nan, lat), np.where(is_past, np.nan, lon)


def _ordered(
    source: str, rows: Sequence[Words], pairs: FloatArray, time_s: FloatArray, remarks: Remarks
) -> tuple[FloatArray, FloatArray]:
    axes = next((one.functions["GPS"].axes for one in rows if "GPS" in one.functions), ())
    if _is_lettered(axes):
        return _lettered(rows)
    homes = _pairs(rows, "HOME")
    both = np.concatenate([pairs, homes])
    past = np.nanmax(np.abs(np.where(np.isfinite(both), both, 0.0)), axis=0, initial=0.0) > 90.0
    if past.all():
        raise ImportRefusedError(f"{source}: GPS({pairs[0, 0]:g}, {pairs[0, 1]:g}): one of them must be -90 to 90")
    if past.any():
        return (pairs[:, 1], pairs[:, 0]) if past[0] else (pairs[:, 0], pairs[:, 1])
    if (is_lon_first := _by_distance(rows, pairs, homes, time_s)) is not None:
        told = "longitude" if is_lon_first else "latitude"
        remarks.found.append(f"GPS(...) has the {told} first, by the distances that the craft tells")
    else:
        is_lon_first = _by_dialect(source, rows, remarks)
    return (pairs[:, 1], pairs[:, 0]) if is_lon_first else (pairs[:, 0], pairs[:, 1])


def _by_dialect(source: str, rows: Sequence[Words], remarks: Remarks) -> bool:
    """Whether the longitude comes first, as those that write such cues do; said, as it is an assumption."""
    first = next((one for one in rows if "GPS" in one.functions), None)
    if first is None:
        return True
    gps = first.functions["GPS"]
    said = f"GPS({', '.join(gps.texts)})"
    if len(gps.units) == 3 and gps.units[2] == "m" and "barometer" in first.keyed:
        remarks.assumed.append(f"{said} has the latitude first, as a Matrice 300 writes it")
        return False
    is_dji = "height" in first.keyed or "HOME" in first.functions or "barometer" in first.keyed
    if is_dji:
        remarks.assumed.append(f"{said} has the longitude first, as DJI's other craft write it")
        return True
    raise ImportRefusedError(
        f"{source}: {said}: which one is the latitude cannot be told: write [latitude: ...] [longitude: ...] instead"
    )


def _by_distance(rows: Sequence[Words], pairs: FloatArray, homes: FloatArray, time_s: FloatArray) -> bool | None:
    """By the distance from home (D) or the speed (H.S): a degree of longitude is shorter; None: not told."""
    told_m = np.array([one.number("distance") for one in rows])
    speed_mps = np.array([one.number("speed") for one in rows])
    from_home = [_metres(pairs - homes, homes, first) for first in (True, False)]
    step_s = np.diff(time_s, prepend=math.nan)
    steps = np.diff(pairs, axis=0, prepend=math.nan)
    ways = [_metres(steps, pairs, first) for first in (True, False)]
    for told, sizes in ((told_m, from_home), (speed_mps * step_s, ways)):
        is_told = np.isfinite(told) & np.isfinite(sizes[0]) & np.isfinite(sizes[1])
        if is_told.sum() < _LEAST_ROWS or told[is_told].sum() < _LEAST_WAY_M:
            continue
        total = float(told[is_told].sum())
        if told is not told_m:  # single steps are coarse: their sum is not
            misfits = [abs(float(size[is_told].sum()) - total) / total for size in sizes]
        else:
            misfits = [float(np.abs(size[is_told] - told[is_told]).sum()) / total for size in sizes]
        floor = [max(one, _LEAST_MISFIT) for one in misfits]
        if max(floor) > _TOLD_BY * min(floor):
            return floor[0] < floor[1]
    return None


def _metres(step_deg: FloatArray, at_deg: FloatArray, is_lon_first: bool) -> FloatArray:
    """Lengths (N,) of steps (N, 2) in degrees."""
    lon, lat = (0, 1) if is_lon_first else (1, 0)
    east = step_deg[:, lon] * np.cos(np.radians(at_deg[:, lat]))
    return np.asarray(np.hypot(east, step_deg[:, lat]) * _EARTH_M)


def _degrees(lat: FloatArray, lon: FloatArray, step: float, remarks: Remarks) -> tuple[FloatArray, FloatArray, float]:
    """Degrees, of radians where they are no place on land as degrees: there is none within 3.1 degrees of 0, 0."""
    is_fix = np.isfinite(lat + lon) & ~((lat == 0.0) & (lon == 0.0))
    if not is_fix.any() or np.abs(lat[is_fix]).max() > math.pi / 2 or np.abs(lon[is_fix]).max() > math.pi:
        return lat, lon, step
    remarks.assumed.append(
        f"latitude {lat[is_fix][0]:g}, longitude {lon[is_fix][0]:g} are radians, as some firmware writes them: in "
        "degrees they are in the open sea off Africa"
    )
    return np.degrees(lat), np.degrees(lon), math.degrees(step)


def _together(lat: FloatArray, lon: FloatArray, remarks: Remarks) -> tuple[FloatArray, FloatArray]:
    """Without those that no craft was at: one digit that is wrong, or two numbers that are swapped."""
    is_fix = np.isfinite(lat + lon) & ~((lat == 0.0) & (lon == 0.0))
    if not is_fix.any():
        return lat, lon
    step = np.stack([(lon - lon[is_fix][0] + 180.0) % 360.0 - 180.0, lat], axis=1)  # over the date line, too
    middle = np.median(step[is_fix], axis=0)
    step -= middle
    is_far = is_fix & (_metres(step, np.broadcast_to(middle, step.shape), True) > _FARTHEST_M)
    count(remarks, f"position: {_FARTHEST_M / 1000:.0f} km from the others", int(is_far.sum()))
    return np.where(is_far, np.nan, lat), np.where(is_far, np.nan, lon)


def _pairs(rows: Sequence[Words], name: str) -> FloatArray:
    return np.array(
        [one.functions[name].values[:2] if name in one.functions else (math.nan, math.nan) for one in rows]
    ).reshape(-1, 2)


def _is_lettered(axes: tuple[str, ...]) -> bool:
    return len(axes) >= 2 and {axes[0], axes[1]} in ({"E", "N"}, {"E", "S"}, {"W", "N"}, {"W", "S"})


def _lettered(rows: Sequence[Words]) -> tuple[FloatArray, FloatArray]:
    found = np.array([_by_letters(one.functions.get("GPS")) for one in rows]).reshape(-1, 2)
    return found[:, 0], found[:, 1]


def _by_letters(numbers: Tuple3 | None) -> tuple[float, float]:
    if numbers is None or not _is_lettered(numbers.axes):
        return math.nan, math.nan
    signed = {
        axis: -value if axis in "SW" else value
        for axis, value in zip(numbers.axes[:2], numbers.values[:2], strict=True)
    }
    return signed.get("N", signed.get("S", math.nan)), signed.get("E", signed.get("W", math.nan))
