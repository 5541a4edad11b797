"""A track whose places are written in steps of many metres: between two steps the craft flew on. Free of I/O."""

import numpy as np

from distloc.types import FloatArray
from service.recordings.importers.flight import IntArray

COARSE_M = 2.0  # from this step on the digits are what a place errs by
_STEP_S = 0.5
_WINDOW_S = 4.0  # on both sides: a craft's speed and turn change little in it
_LEAST_POINTS = 5
_METRES_A_DEGREE = 111_195.0


def smoothed(
    time_s: FloatArray, lat_deg: FloatArray, lon_deg: FloatArray
) -> tuple[IntArray, FloatArray, FloatArray, FloatArray]:
    """Indices (M,) of cues half a second apart, with latitude, longitude and velocity north and east (M, 2) there.

    By parabolas through the cues of some seconds (Savitzky and Golay 1964, for times that need not be even). Cues
    without a place have NaN.
    """
    chosen = np.unique(np.floor(time_s / _STEP_S), return_index=True)[1]
    is_fix = np.isfinite(lat_deg + lon_deg) & ~((lat_deg == 0.0) & (lon_deg == 0.0))
    fixes = chosen[is_fix[chosen]]
    lon_deg, lon_0_deg = lon_deg[fixes], lon_deg[fixes[:1]]
    lon_deg = (lon_deg - lon_0_deg + 180.0) % 360.0 - 180.0  # over the date line, too
    t, place = time_s[fixes], np.stack([lat_deg[fixes], lon_deg], axis=1)
    out, velocity_mps = place.copy(), np.full_like(place, np.nan)
    first = np.searchsorted(t, t - _WINDOW_S)
    last = np.searchsorted(t, t + _WINDOW_S, side="right")
    for i in range(len(t)):
        span = slice(int(first[i]), int(last[i]))
        if last[i] - first[i] < _LEAST_POINTS:
            continue
        powers = np.vander(t[span] - t[i], 3, increasing=True)
        at, slope, _ = np.linalg.lstsq(powers, place[span] - place[i], rcond=None)[0]
        out[i] += at
        velocity_mps[i] = slope * _METRES_A_DEGREE * np.array([1.0, np.cos(np.radians(place[i, 0]))])
    return fixes, out[:, 0], (out[:, 1] + lon_0_deg + 180.0) % 360.0 - 180.0, velocity_mps
