"""The craft's track of the cues: the cues at which a new place came, with their heights."""

import math
from collections.abc import Sequence

import numpy as np

from distloc.types import BoolArray, FloatArray
from service.recordings.importers.dji.coarse import COARSE_M, smoothed
from service.recordings.importers.dji.order import Places
from service.recordings.importers.dji.words import Words
from service.recordings.importers.flight import Fixes, Positions, Remarks, unknown
from service.recordings.importers.rows import count, fixes_of, home_of, positions_of

_HELD_STEP_S = 0.2  # a craft that hovers is at its place this often
_MOST_UPDATE_S = 2.0
_FIX_SIGMA_M = 2.5  # of a consumer's receiver
_HIGHEST_FLIGHT_M = 510.0  # DJI's craft fly no higher above their home
_3D_FIX = 3
_LOWEST_HOME_M = -30.0  # a barometer at the coast, on a day of low pressure


def track_of(
    rows: Sequence[Words], time_s: FloatArray, places: Places, remarks: Remarks
) -> tuple[Positions | None, Fixes | None]:
    """Places with heights, and how sure the receiver can be of them; None where no cue has both.

    A cue repeats the last place until the craft knows a new one, ten times or once a second: the repetitions would be
    steps in the track, so only the first of each counts, and between them the craft flew on.
    """
    above_home_m, alt_msl_m = _heights(rows, remarks)
    is_null = (places.lat_deg == 0.0) & (places.lon_deg == 0.0)
    is_place = np.isfinite(places.lat_deg + places.lon_deg) & ~is_null
    count(remarks, "position: 0, 0, as before a fix", int(is_null.sum()))
    count(remarks, "position: no place in the cue", int((~is_place & ~is_null).sum()))
    if places.resolution_m > COARSE_M:
        kept, lat_deg, lon_deg, level_mps = smoothed(time_s, places.lat_deg, places.lon_deg)
    else:
        kept = np.flatnonzero(_is_news(time_s, places) & is_place).astype(np.int64)
        lat_deg, lon_deg, level_mps = places.lat_deg[kept], places.lon_deg[kept], unknown(len(kept), 2)
    positions = positions_of(
        time_s[kept],
        lat_deg,
        lon_deg,
        remarks,
        alt_msl_m=alt_msl_m[kept],
        above_home_m=above_home_m[kept],
        velocity_ned_mps=_with_climb(level_mps, time_s[kept], alt_msl_m[kept], above_home_m[kept]),
    )
    if positions is None:
        return None, None
    sigma_m = math.hypot(_FIX_SIGMA_M, places.resolution_m / math.sqrt(12.0))
    satellites = _satellites(rows)
    number = len(positions.time_s)
    seen = np.interp(positions.time_s, time_s, satellites) if np.isfinite(satellites).all() else unknown(number)
    fixes = fixes_of(
        positions.time_s, np.full(number, _3D_FIX), remarks, satellites=np.floor(seen), h_acc_m=np.full(number, sigma_m)
    )
    if places.resolution_m > COARSE_M:
        remarks.assumed.append(
            f"places are written in steps of {places.resolution_m:.0f} m: a smooth path is laid through them"
        )
    return positions, fixes


def home_told(rows: Sequence[Words], places: Places, remarks: Remarks) -> tuple[float, float, float] | None:
    """Of HOME(a, b, metres), whichever of the two is the latitude; None where it tells no height."""
    homes = [one.functions["HOME"] for one in rows if "HOME" in one.functions]
    told = [one.values for one in homes if one.units[2:] == ("m",)]
    is_place = np.isfinite(places.lat_deg + places.lon_deg)
    if not told or not is_place.any():
        return None
    first, second, alt_m = (float(one) for one in np.median(np.array(told), axis=0))
    lat_deg, lon_deg = float(np.median(places.lat_deg[is_place])), float(np.median(places.lon_deg[is_place]))
    is_lon_first = abs(first - lon_deg) + abs(second - lat_deg) < abs(first - lat_deg) + abs(second - lon_deg)
    home = home_of(second, first, alt_m) if is_lon_first else home_of(first, second, alt_m)
    if home is not None:
        remarks.assumed.append(
            f"home is {alt_m:.2f} m above the sea, as HOME tells: of an RTK's craft it may be over the ellipsoid"
        )
    return home


def _with_climb(level_mps: FloatArray, time_s: FloatArray, alt_m: FloatArray, above_m: FloatArray) -> FloatArray:
    """(N, 3) north, east, down; NaN where the first two are not told."""
    height_m = alt_m if np.isfinite(alt_m).any() else above_m
    down_mps = -np.gradient(height_m, time_s) if len(time_s) > 1 else np.zeros(len(time_s))
    return np.concatenate([level_mps, down_mps[:, None]], axis=1)


def _is_news(time_s: FloatArray, places: Places) -> BoolArray:
    """(N,) whether a cue's place is a new one, or the craft has stood for longer than news take."""
    place = np.stack([places.lat_deg, places.lon_deg], axis=1)
    is_changed = np.ones(len(place), dtype=np.bool_)
    is_changed[1:] = (place[1:] != place[:-1]).any(axis=1)  # NaN differs from all: positions_of counts it
    changed = np.flatnonzero(is_changed)
    if len(changed) < 2:
        return _spaced(time_s, is_changed, np.full(len(time_s), time_s[0]), np.full(len(time_s), np.inf), 0.0)
    update_s = float(np.clip(np.median(np.diff(time_s[changed])), 0.0, _MOST_UPDATE_S))
    number = np.cumsum(is_changed) - 1
    since = time_s[changed][number]
    until = np.append(time_s[changed][1:], np.inf)[number]
    return _spaced(time_s, is_changed, since, until, update_s)


def _spaced(
    time_s: FloatArray, is_changed: BoolArray, since_s: FloatArray, until_s: FloatArray, update_s: float
) -> BoolArray:
    """The changes and, where a place was held for long, a cue each `_HELD_STEP_S` until news were on their way."""
    is_held = (time_s - since_s > 1.5 * update_s) & (until_s - time_s >= update_s) & ~is_changed
    step = np.floor(time_s / _HELD_STEP_S)
    is_held[1:] &= step[1:] != step[:-1]
    if len(is_held) and not is_changed[-1] and not np.isfinite(until_s[-1]):
        is_held[-1] = True
    return np.asarray(is_changed | is_held)


def _heights(rows: Sequence[Words], remarks: Remarks) -> tuple[FloatArray, FloatArray]:
    """Above home and above the sea (N,), NaN where not told."""
    above_home = _first_of(rows, ("rel_alt", "height", "barometer"))
    msl = _first_of(rows, ("abs_alt",))
    if np.isfinite(msl).any():
        remarks.assumed.append(
            "abs_alt is above the sea by the barometer, at times tens of metres wrong: only used without --home-alt"
        )
    _doubt_low(msl, above_home, remarks)
    if np.isfinite(above_home).any() or np.isfinite(msl).any():
        return above_home, msl
    bare = _first_of(rows, ("altitude",))
    thirds = [one.functions.get("GPS") for one in rows]
    if not np.isfinite(bare).any():
        bare = np.array([one.values[2] if one and one.units[2:] == ("m",) else math.nan for one in thirds])
    if not np.isfinite(bare).any():
        remarks.lacks.append("height: no cue tells one")
        return bare, bare
    if np.nanmax(bare) > _HIGHEST_FLIGHT_M:
        remarks.assumed.append(f"altitude is above the sea: no craft of DJI's flies {np.nanmax(bare):.0f} m above home")
        return np.full_like(bare, math.nan), bare
    remarks.assumed.append(
        "altitude is above home: it is not said above what, and some craft write it above the sea; a wrong one moves "
        "the fire"
    )
    return bare, np.full_like(bare, math.nan)


def _doubt_low(msl_m: FloatArray, above_home_m: FloatArray, remarks: Remarks) -> None:
    """Say it where a barometer puts the take-off under the sea."""
    home_m = msl_m - np.where(np.isfinite(above_home_m), above_home_m, 0.0)
    if np.isfinite(home_m).any() and (low_m := float(np.nanmedian(home_m))) < _LOWEST_HOME_M:
        remarks.doubt.append(
            f"abs_alt puts the take-off at {low_m:.0f} m, under the sea: the heights are surely wrong, and the fire's "
            "place with them; give --home-alt METRES"
        )


def _first_of(rows: Sequence[Words], names: tuple[str, ...]) -> FloatArray:
    for name in names:
        values = np.array([one.number(name) for one in rows])
        if np.isfinite(values).any():
            return values
    return np.full(len(rows), math.nan)


def _satellites(rows: Sequence[Words]) -> FloatArray:
    """(N,) the whole number after a place, in the dialects that have no unit there."""
    found = [one.functions.get("GPS") for one in rows]
    return np.array(
        [one.values[2] if one and one.units[2:] == ("",) and one.texts[2].isdigit() else math.nan for one in found]
    )
