"""Samples as a source has them to clean ones: finite, in range, in rising time; what is left out is counted.

Every reader hands its rows through here. Free of I/O.
"""

from array import array
from bisect import bisect_left
from collections.abc import Callable, Sequence

import numpy as np

from distloc.types import BoolArray, FloatArray
from service.recordings.importers.flight import (
    Attitudes,
    Fixes,
    ImportRefusedError,
    IntArray,
    Positions,
    Remarks,
    unknown,
)

MOST_SAMPLES = 5_000_000  # 3 hours at 400 Hz, 40 MB a column
_HEIGHT_M = (-1_000.0, 50_000.0)
_NULL_ISLAND_DEG = 1e-3
_LEAST_NORM, _MOST_NORM = 0.5, 1.5
_MOST_SPEED_MPS = 1_000.0
_MOST_RATE_RPS = 100.0
_FAR_S = 1.0
_LEAST_ROWS = 10
LONGEST_S = 48 * 3600.0  # of one flight
_EARTH_M = 6_371_000.0
_SLACK_RAD, _LEAST_TURN_RPS, _MOST_TURN_RPS = 0.2, 1.0, 12.0  # the last: a racing craft's
_MOST_SPIKE = 5  # rows; what lasts longer is a heading that was reset
_SLACK_M = 60.0  # by which a receiver's place may step without a flight
_LEAST_LIMIT_MPS, _MOST_LIMIT_MPS = 40.0, 350.0
_USUAL_TIMES = 4.0  # the flight's own usual speed


class Rows:
    """Rows of `width` numbers, one after the other, in 8 bytes each; ImportRefusedError beyond `MOST_SAMPLES`."""

    def __init__(self, width: int, where: str) -> None:
        self._width, self._where = width, where
        self._values = array("d")

    def __len__(self) -> int:
        return len(self._values) // self._width

    def add(self, *row: float) -> None:
        """One more row."""
        if len(row) != self._width:
            raise ValueError(f"a row of {self._width} numbers is wanted, got {len(row)}")
        if len(self) == MOST_SAMPLES:
            raise ImportRefusedError(f"{self._where}: more than {MOST_SAMPLES} rows: cut it")
        self._values.extend(row)

    def table(self) -> FloatArray:
        """(N, width)."""
        return np.frombuffer(self._values, dtype=np.float64).reshape(-1, self._width).copy()


def attitudes_of(
    time_s: Sequence[float] | FloatArray,
    q_ned_from_body: Sequence[Sequence[float]] | FloatArray,
    remarks: Remarks,
    rate_rps: FloatArray | None = None,
    name: str = "attitude",
) -> Attitudes | None:
    """Unit quaternions (N, 4) of what can be used; None where that is nothing."""
    time_s = np.asarray(time_s, dtype=np.float64)
    q = np.asarray(q_ned_from_body, dtype=np.float64).reshape(-1, 4)
    rates = unknown(len(time_s), 3) if rate_rps is None else np.asarray(rate_rps, dtype=np.float64)
    norm = np.linalg.norm(q, axis=1)
    is_good = _counted(np.isfinite(time_s), remarks, f"{name}: no time")
    is_good &= _counted(np.isfinite(norm), remarks, f"{name}: not a number", is_good)
    is_good &= _counted((norm > _LEAST_NORM) & (norm < _MOST_NORM), remarks, f"{name}: no rotation", is_good)
    kept = _rising(time_s, is_good, remarks, name)
    if not len(kept):
        return None
    unit = q / np.where(norm > 0.0, norm, 1.0)[:, None]
    at = unit[kept]

    def turned_rad(i: IntArray, j: IntArray) -> FloatArray:
        return np.asarray(2.0 * np.arccos(np.abs((at[i] * at[j]).sum(axis=-1)).clip(0.0, 1.0)))

    numbers = np.arange(len(kept))
    rates_rps = turned_rad(numbers[:-1], numbers[1:]) / np.diff(time_s[kept])
    usual_rps = _USUAL_TIMES * float(np.quantile(rates_rps, 0.9)) if len(rates_rps) else 0.0
    limit_rps = float(np.clip(usual_rps, _LEAST_TURN_RPS, _MOST_TURN_RPS))
    is_kept = _reached(time_s[kept], turned_rad, _SLACK_RAD, limit_rps, _MOST_SPIKE)
    count(remarks, f"{name}: nothing turns there and back so fast", int((~is_kept).sum()))
    kept = kept[is_kept]
    rates = np.where((np.abs(rates) < _MOST_RATE_RPS).all(axis=1, keepdims=True), rates, np.nan)
    return Attitudes(time_s[kept], unit[kept], rates[kept])


def positions_of(
    time_s: Sequence[float] | FloatArray,
    lat_deg: Sequence[float] | FloatArray,
    lon_deg: Sequence[float] | FloatArray,
    remarks: Remarks,
    *,
    alt_msl_m: FloatArray | None = None,
    alt_ellipsoid_m: FloatArray | None = None,
    above_home_m: FloatArray | None = None,
    velocity_ned_mps: FloatArray | None = None,
) -> Positions | None:
    """Places that can be used, with at least one height each; None where that is nothing."""
    time_s, lat, lon = (np.asarray(one, dtype=np.float64) for one in (time_s, lat_deg, lon_deg))
    heights = [
        unknown(len(time_s)) if one is None else np.asarray(one, dtype=np.float64)
        for one in (alt_msl_m, alt_ellipsoid_m, above_home_m)
    ]
    velocity = unknown(len(time_s), 3) if velocity_ned_mps is None else np.asarray(velocity_ned_mps, dtype=np.float64)
    heights = [np.where((one > _HEIGHT_M[0]) & (one < _HEIGHT_M[1]), one, np.nan) for one in heights]
    is_good = _counted(np.isfinite(time_s), remarks, "position: no time")
    is_good &= _counted(np.isfinite(lat + lon), remarks, "position: not a number", is_good)
    is_good &= _counted((np.abs(lat) <= 90.0) & (np.abs(lon) <= 180.0), remarks, "position: no place on earth", is_good)
    is_null = (np.abs(lat) < _NULL_ISLAND_DEG) & (np.abs(lon) < _NULL_ISLAND_DEG)
    is_good &= _counted(~is_null, remarks, "position: 0, 0, as before a fix", is_good)
    has_height = np.asarray(np.isfinite(np.stack(heights)).any(axis=0))
    is_good &= _counted(has_height, remarks, "position: no height", is_good)
    kept = _rising(time_s, is_good, remarks, "position")
    if not len(kept):
        return None
    velocity = np.where((np.abs(velocity) < _MOST_SPEED_MPS).all(axis=1, keepdims=True), velocity, np.nan)
    msl_m, ellipsoid_m, home_m = (one[kept] for one in heights)
    return Positions(time_s[kept], lat[kept], lon[kept], msl_m, ellipsoid_m, home_m, velocity[kept])


def flown(positions: Positions, step_m: float, remarks: Remarks) -> Positions:
    """Without places to which the craft cannot have flown from the others, and back: a bit that flipped, a bad fix.

    The longest part whose places follow each other as a flight's do is believed, and what can be reached from it.
    `step_m` is that of the places' digits. Heights above the sea must be known.
    """
    time_s = positions.time_s
    if len(time_s) < 3:
        return positions
    place_m = _ecef_m(positions)
    way_m, span_s = np.linalg.norm(np.diff(place_m, axis=0), axis=1), np.diff(time_s)
    limit_mps = float(np.clip(_USUAL_TIMES * np.median(way_m / span_s), _LEAST_LIMIT_MPS, _MOST_LIMIT_MPS))
    slack_m = _SLACK_M + 2.0 * step_m
    is_kept = _reached(time_s, lambda i, j: np.linalg.norm(place_m[i] - place_m[j], axis=-1), slack_m, limit_mps)
    count(remarks, "position: the craft cannot have flown there and back", int((~is_kept).sum()))
    return Positions(**{name: getattr(positions, name)[is_kept] for name in Positions.__dataclass_fields__})


def _reached(
    time_s: FloatArray,
    apart: Callable[[IntArray, IntArray], FloatArray],
    slack: float,
    limit_per_s: float,
    most_lost: int | None = None,
) -> BoolArray:
    """(N,) the longest part in which none is further `apart` (of two rows' numbers) from the next one than it can go,

    and what can be reached from it; of more than `most_lost` rows in turn none is left out.
    """
    numbers = np.arange(len(time_s))
    steps = apart(numbers[:-1], numbers[1:])
    breaks = np.flatnonzero(steps > slack + limit_per_s * np.diff(time_s)) + 1
    starts, ends = np.concatenate([[0], breaks]), np.concatenate([breaks, [len(time_s)]]) - 1
    main = int(np.argmax(ends - starts))
    is_kept = np.zeros(len(time_s), dtype=np.bool_)
    is_kept[starts[main] : ends[main] + 1] = True
    for order, near, far in (
        (range(main + 1, len(starts)), starts, ends),
        (range(main - 1, -1, -1), ends, starts),
    ):
        last = far[main]
        for run in order:
            first = near[run]
            is_near = apart(first, last) <= slack + limit_per_s * abs(time_s[first] - time_s[last])
            if is_near or (most_lost is not None and ends[run] - starts[run] >= most_lost):
                is_kept[starts[run] : ends[run] + 1] = True
                last = far[run]
    return is_kept


def step_deg_of(lat_deg: FloatArray, lon_deg: FloatArray) -> float:
    """The step in which places are written, in degrees: that of the fewest decimals that have them all; 0: finer."""
    both = np.concatenate([lat_deg, lon_deg])
    for decimals in range(2, 6):
        scaled = both * 10.0**decimals
        if len(both) and (np.abs(scaled - np.round(scaled)) < 1e-4).all():
            return float(10.0**-decimals)
    return 0.0


def _ecef_m(positions: Positions) -> FloatArray:
    lat, lon = np.radians(positions.lat_deg), np.radians(positions.lon_deg)
    up = np.stack([np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)], axis=1)
    return np.asarray(up * (_EARTH_M + positions.alt_msl_m)[:, None])


def fixes_of(
    time_s: Sequence[float] | FloatArray,
    fix_type: Sequence[int] | FloatArray,
    remarks: Remarks,
    *,
    satellites: FloatArray | None = None,
    h_acc_m: FloatArray | None = None,
    v_acc_m: FloatArray | None = None,
) -> Fixes | None:
    """Fixes in rising time; None where there are none."""
    time_s, kind = np.asarray(time_s, dtype=np.float64), np.asarray(fix_type, dtype=np.float64)
    seen = np.full(len(time_s), 255.0) if satellites is None else np.asarray(satellites, dtype=np.float64)
    sizes = [unknown(len(time_s)) if one is None else np.asarray(one, dtype=np.float64) for one in (h_acc_m, v_acc_m)]
    is_good = _counted(np.isfinite(time_s) & (kind >= 0) & (kind <= 8), remarks, "fix: not a number")
    kept = _rising(time_s, is_good, remarks, "fix")
    if not len(kept):
        return None
    seen = np.where((seen >= 0) & (seen < 255), seen, 255.0)
    sizes = [np.where((one > 0.0) & (one < 1e6), one, np.nan) for one in sizes]
    return Fixes(time_s[kept], kind[kept].astype(np.int64), seen[kept].astype(np.int64), sizes[0][kept], sizes[1][kept])


def home_of(lat_deg: float, lon_deg: float, alt_msl_m: float) -> tuple[float, float, float] | None:
    """The place where that is one on earth."""
    is_place = abs(lat_deg) <= 90.0 and abs(lon_deg) <= 180.0 and _HEIGHT_M[0] < alt_msl_m < _HEIGHT_M[1]
    return (float(lat_deg), float(lon_deg), float(alt_msl_m)) if is_place else None


def most_rising(time_s: FloatArray) -> np.ndarray[tuple[int], np.dtype[np.int64]]:
    """Indices of the longest part of `time_s` (N,) that rises: one wild time costs its own row, not all that follow."""
    known = np.flatnonzero(np.isfinite(time_s))
    if len(known) < len(time_s):
        return known[most_rising(time_s[known])]
    if len(time_s) < 2 or (np.diff(time_s) > 0.0).all():
        return np.arange(len(time_s))
    ends: list[float] = []
    at_end: list[int] = []
    before = np.full(len(time_s), -1)
    for i, t in enumerate(time_s.tolist()):
        length = bisect_left(ends, t)
        if length == len(ends):
            ends.append(t)
            at_end.append(i)
        else:
            ends[length], at_end[length] = t, i
        before[i] = at_end[length - 1] if length else -1
    kept, i = np.zeros(len(ends), dtype=np.int64), at_end[-1]
    for number in range(len(ends) - 1, -1, -1):
        kept[number], i = i, int(before[i])
    return kept


def sampled(time_s: FloatArray, values: FloatArray, at_s: FloatArray) -> FloatArray:
    """Values (N, k) of another row of times at `at_s` (M,): (M, k), linear, NaN farther than a second from them."""
    kept = most_rising(time_s)
    if not len(kept):
        return np.full((len(at_s), values.shape[1]), np.nan)
    times_s, values = time_s[kept], values[kept]
    out = np.stack([np.interp(at_s, times_s, column) for column in values.T], axis=1)
    after = np.clip(np.searchsorted(times_s, at_s), 0, len(times_s) - 1)
    apart_s = np.minimum(np.abs(times_s[after] - at_s), np.abs(times_s[np.maximum(after - 1, 0)] - at_s))
    out[~(apart_s <= _FAR_S)] = np.nan
    return np.asarray(out)


def count(remarks: Remarks, reason: str, number: int = 1) -> None:
    """Note rows that are left out."""
    if number:
        remarks.dropped[reason] = remarks.dropped.get(reason, 0) + number


def _counted(is_good: BoolArray, remarks: Remarks, reason: str, of: BoolArray | None = None) -> BoolArray:
    count(remarks, reason, int((~is_good if of is None else of & ~is_good).sum()))
    return is_good


def _rising(
    time_s: FloatArray, is_good: BoolArray, remarks: Remarks, name: str
) -> np.ndarray[tuple[int], np.dtype[np.int64]]:
    good = np.flatnonzero(is_good)
    if len(good):  # one wild stamp would make a flight of years
        is_near = np.abs(time_s[good] - np.median(time_s[good])) <= LONGEST_S
        count(remarks, f"{name}: a time days from the others'", int((~is_near).sum()))
        good = good[is_near]
    kept = good[most_rising(time_s[good])]
    kept = _without_strays(time_s, kept, remarks, name)
    repeated = len(good) - len(np.unique(time_s[good]))
    count(remarks, f"{name}: time repeated", min(repeated, len(good) - len(kept)))
    count(remarks, f"{name}: time runs backwards", max(0, len(good) - len(kept) - repeated))
    return kept


def _without_strays(time_s: FloatArray, kept: IntArray, remarks: Remarks, name: str) -> IntArray:
    """Without a last row that comes later than all the others took: its stamp's bit flipped."""
    if len(kept) < _LEAST_ROWS:
        return kept
    span_s = float(time_s[kept[-2]] - time_s[kept[0]])
    is_stray = float(time_s[kept[-1]] - time_s[kept[-2]]) > max(span_s, _FAR_S)
    count(remarks, f"{name}: a last time far from the others'", int(is_stray))
    return kept[:-1] if is_stray else kept
