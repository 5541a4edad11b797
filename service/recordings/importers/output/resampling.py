"""Poses at the rates that the replay needs: thinned where there are many, filled in where there are few.

What is filled in is less sure: the sizes of that are told by leaving out samples and finding them again. Free of I/O.
"""

from dataclasses import dataclass

import numpy as np

from distloc.geometry.rotations import slerp
from distloc.types import FloatArray
from service.autopilot.poses import ATTITUDE_GAP_NS, POSITION_GAP_NS
from service.recordings.importers.assumptions import EARTH_M
from service.recordings.importers.flight import Attitudes, Positions, unknown

STEP_S = 0.1
LEAST_STEP_S = 0.01  # 100 Hz are enough for what frames need
ATTITUDE_GAP_S, POSITION_GAP_S = ATTITUDE_GAP_NS * 1e-9, POSITION_GAP_NS * 1e-9
_MARGIN = 0.9  # of a gap: times are written in whole milliseconds
MOST_FILLED_S = {"attitude": 1.5, "position": 3.0}  # longer gaps stay gaps
_LEAST_TO_JUDGE = 8


@dataclass(frozen=True, slots=True)
class Resampled:
    """`filled` samples were put in, `gaps` stay too long to fill; `error` is what interpolation errs by, 1 sigma.

    In radians about each axis of attitudes, in metres on each axis of positions; 0 where nothing was filled in.
    """

    filled: int
    gaps: int
    error: float


def resampled_attitudes(attitudes: Attitudes) -> tuple[Attitudes, Resampled]:
    """Attitudes of which no two are further apart than the replay allows, but for true gaps."""
    kept = thinned(attitudes.time_s)
    attitudes = Attitudes(attitudes.time_s[kept], attitudes.q_ned_from_body[kept], attitudes.rate_rps[kept])
    times_s, filled, gaps = filled_times(attitudes.time_s, ATTITUDE_GAP_S, MOST_FILLED_S["attitude"])
    q = interpolated(attitudes.time_s, attitudes.q_ned_from_body, times_s)
    rates = unknown(len(times_s), 3)
    rates[np.searchsorted(times_s, attitudes.time_s)] = attitudes.rate_rps
    error_rad = left_out_rad(attitudes) if filled else 0.0
    return Attitudes(times_s, q, rates), Resampled(filled, gaps, error_rad)


def resampled_positions(positions: Positions) -> tuple[Positions, Resampled]:
    """The same of positions, along the curve that places and velocities make."""
    kept = thinned(positions.time_s)
    positions = Positions(**{name: getattr(positions, name)[kept] for name in Positions.__dataclass_fields__})
    times_s, filled, gaps = filled_times(positions.time_s, POSITION_GAP_S, MOST_FILLED_S["position"])
    if not filled:
        return positions, Resampled(0, gaps, 0.0)
    return along(positions, times_s), Resampled(filled, gaps, left_out_m(positions))


def thinned(times_s: FloatArray) -> np.ndarray[tuple[int], np.dtype[np.int64]]:
    """Indices of samples at least `LEAST_STEP_S` apart."""
    if len(times_s) < 2 or float(np.median(np.diff(times_s))) >= 0.9 * LEAST_STEP_S:
        return np.arange(len(times_s))
    return np.unique(np.floor(times_s / LEAST_STEP_S), return_index=True)[1]


def filled_times(times_s: FloatArray, gap_s: float, most_s: float) -> tuple[FloatArray, int, int]:
    """The times with steps of `STEP_S` at most put into what is longer than a gap; how many, and the gaps left."""
    steps_s = np.diff(times_s)
    is_filled = (steps_s > _MARGIN * gap_s) & (steps_s <= most_s)
    added = [
        np.linspace(times_s[i], times_s[i + 1], int(np.ceil(steps_s[i] / STEP_S)) + 1)[1:-1]
        for i in np.flatnonzero(is_filled)
    ]
    count = sum(map(len, added))
    return np.sort(np.concatenate([times_s, *added])), count, int((steps_s > most_s).sum())


def interpolated(times_s: FloatArray, q: FloatArray, at_s: FloatArray) -> FloatArray:
    """Unit quaternions (M, 4) at times between those of `q` (N, 4), by slerp; the ends are held."""
    after = np.clip(np.searchsorted(times_s, at_s), 1, max(1, len(times_s) - 1))
    if len(times_s) == 1:
        return np.repeat(q, len(at_s), axis=0)
    before = after - 1
    share = np.clip((at_s - times_s[before]) / (times_s[after] - times_s[before]), 0.0, 1.0)
    out = q[after].copy()
    for i in np.flatnonzero(share < 1.0):
        out[i] = q[before[i]] if share[i] == 0.0 else slerp(q[before[i]], q[after[i]], float(share[i]))
    return out


def along(positions: Positions, at_s: FloatArray) -> Positions:
    """Positions at other times: cubic Hermite by places and velocities, as the replay has it; the rest is linear."""
    times_s = positions.time_s
    metres, velocity = _metres(positions), positions.velocity_ned_mps
    after = np.clip(np.searchsorted(times_s, at_s), 1, len(times_s) - 1)
    before = after - 1
    span_s = (times_s[after] - times_s[before])[:, None]
    s = np.clip((at_s - times_s[before]) / span_s[:, 0], 0.0, 1.0)[:, None]
    a, b, va, vb = metres[before], metres[after], velocity[before] * span_s, velocity[after] * span_s
    place = (2 * s**3 - 3 * s**2 + 1) * a + (s**3 - 2 * s**2 + s) * va + (3 * s**2 - 2 * s**3) * b + (s**3 - s**2) * vb
    slope = ((6 * s**2 - 6 * s) * (a - b) + (3 * s**2 - 4 * s + 1) * va + (3 * s**2 - 2 * s) * vb) / span_s
    lat_deg = np.degrees(place[:, 0] / EARTH_M) + positions.lat_deg[0]
    lon_deg = np.degrees(place[:, 1] / EARTH_M / np.cos(np.radians(positions.lat_deg[0]))) + positions.lon_deg[0]
    linear = {name: np.interp(at_s, times_s, getattr(positions, name)) for name in ("alt_ellipsoid_m", "above_home_m")}
    lon_deg = (lon_deg + 180.0) % 360.0 - 180.0
    return Positions(at_s, lat_deg, lon_deg, -place[:, 2], **linear, velocity_ned_mps=slope)


def left_out_rad(attitudes: Attitudes) -> float:
    """By how much each second sample is missed by its neighbours, about each axis, rms.

    At twice the source's spacing: no less than at its own, whether the craft sways slowly or faster than it is sampled.
    """
    times_s, q = attitudes.time_s, attitudes.q_ned_from_body
    if len(times_s) < _LEAST_TO_JUDGE:
        return 0.0
    found = interpolated(times_s[::2], q[::2], times_s[1:-1:2])
    dots = np.abs(np.einsum("ni,ni->n", found, q[1:-1:2])).clip(0.0, 1.0)
    is_near = (times_s[2::2] - times_s[:-2:2])[: len(dots)] <= 2.0 * MOST_FILLED_S["attitude"]
    return float(np.sqrt(np.mean((2.0 * np.arccos(dots[is_near])) ** 2) / 3.0)) if is_near.any() else 0.0


def left_out_m(positions: Positions) -> float:
    """The same in metres on each axis."""
    times_s = positions.time_s
    if len(times_s) < _LEAST_TO_JUDGE:
        return 0.0
    half = Positions(**{name: getattr(positions, name)[::2] for name in Positions.__dataclass_fields__})
    found = _metres(along(half, times_s[1:-1:2]), positions)
    off_m = np.linalg.norm(found - _metres(positions)[1:-1:2], axis=1)
    is_near = (times_s[2::2] - times_s[:-2:2])[: len(off_m)] <= 2.0 * MOST_FILLED_S["position"]
    return float(np.sqrt(np.mean(off_m[is_near] ** 2) / 3.0)) if is_near.any() else 0.0


def _metres(positions: Positions, about: Positions | None = None) -> FloatArray:
    """(N, 3) north, east, down of the first place of `about`, on a sphere: between places seconds apart it is exact."""
    origin = about or positions
    lat_deg, lon_deg = origin.lat_deg[0], origin.lon_deg[0]
    east_deg = (positions.lon_deg - lon_deg + 180.0) % 360.0 - 180.0
    return np.stack(
        [
            np.radians(positions.lat_deg - lat_deg) * EARTH_M,
            np.radians(east_deg) * EARTH_M * np.cos(np.radians(lat_deg)),
            -positions.alt_msl_m,
        ],
        axis=1,
    )
