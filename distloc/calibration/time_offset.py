"""How late the frames' stamps are, from the camera's turning as the poses have it against what the frames show.

A frame stamped `offset_s` late shows the attitude of that much earlier. Whatever is slow (mount, compass, parallax) is
taken off by a running mean, so only the wobble within `_SLOW_S` counts. `calibrate --time-offset` calls it.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from distloc.calibration.pose_trail import PoseTrail
from distloc.types import FloatArray

MOST_OFFSET_S = 0.5
MOST_SIGMA_S = 0.02  # at 10 deg/s that is 0.2 deg: what is less sure mends nothing
LEAST_USED = 30
_SLOW_S = 3.0  # half the running mean's window; frames 0.5 s apart still give 12
_GRID_S = 0.01
_STEP_S = 0.05  # two and a half attitudes: over less their white errors look like turning
_OUTLIER = 4.0
_SCALE_OF_MEDIAN = 1.0 / np.sqrt(2.0 * np.log(2.0))  # two components
_CLOCKS_S = 0.001  # attitudes are stamped in whole milliseconds, the clocks agree to less
_LEAST_REAL = 0.5  # share of the slope's square that is turning and no noise: with less it finds what is not there
_ROUNDS = 10
_LAGS = 3  # neighbours whose errors may be alike

Residuals = Callable[[float], FloatArray]


@dataclass(frozen=True, slots=True)
class TimeOffset:
    """`offset_s`: how late the stamps are, None where `used` frames cannot tell (`sigma_s` may then be infinite)."""

    offset_s: float | None
    sigma_s: float
    used: int


def aim_residuals(
    trail: PoseTrail, stamps_s: FloatArray, rays_cam: FloatArray, landmark_enu_m: FloatArray
) -> Residuals:
    """By the offset: tangents (n, 2) by which the landmark's rays (n, 3) lie right of and below where they should."""
    right = np.cross([0.0, 1.0, 0.0], rays_cam)
    right /= np.linalg.norm(right, axis=1, keepdims=True)
    down = np.cross(rays_cam, right)

    def residuals(offset_s: float) -> FloatArray:
        R, positions_m, is_known = trail.at(stamps_s - offset_s)
        lines = np.einsum("nij,nj->ni", R, landmark_enu_m - positions_m)
        ahead = np.sum(lines * rays_cam, axis=1)
        out = -np.stack([np.sum(lines * right, axis=1), np.sum(lines * down, axis=1)], axis=1) / ahead[:, None]
        out[~is_known] = np.nan
        return np.asarray(out)

    return residuals


def turn_residuals(trail: PoseTrail, starts_s: FloatArray, ends_s: FloatArray, turns_rad: FloatArray) -> Residuals:
    """By the offset: the turns (n, 3) of the camera that pairs of frames show, less those of the poses.

    A turn is the rotation vector of R_cam(end) R_cam(start)', small.
    """

    def residuals(offset_s: float) -> FloatArray:
        R_start, _, is_start = trail.at(starts_s - offset_s)
        R_end, _, is_end = trail.at(ends_s - offset_s)
        R = R_end @ np.swapaxes(R_start, 1, 2)
        out = turns_rad - vee(R)
        out[~(is_start & is_end)] = np.nan
        return np.asarray(out)

    return residuals


def vee(R: FloatArray) -> FloatArray:
    """Rotation vectors (n, 3) of small rotations (n, 3, 3): the sine's, the same for what is compared."""
    return np.stack([R[:, 2, 1] - R[:, 1, 2], R[:, 0, 2] - R[:, 2, 0], R[:, 1, 0] - R[:, 0, 1]], axis=1) / 2.0


def estimate_time_offset(residuals: Residuals, stamps_s: FloatArray) -> TimeOffset:
    """The offset within +-`MOST_OFFSET_S` at which what is left of the wobble is least.

    The sigma is a sandwich over neighbours, as errors may be alike from frame to frame. None where it is larger than
    `MOST_SIGMA_S`, or the least is at an end: there is too little turning, or the offset is larger.
    """
    grid_s = np.arange(-MOST_OFFSET_S, MOST_OFFSET_S + _GRID_S / 2, _GRID_S)
    curves = np.stack([residuals(float(offset_s)) for offset_s in grid_s])
    is_known = np.isfinite(curves).all(axis=(0, 2))  # the same frames at each offset
    if is_known.sum() < LEAST_USED:
        return TimeOffset(None, np.inf, int(is_known.sum()))
    kept_s = stamps_s[is_known]

    def quick(offset_s: float) -> FloatArray:
        return without_slow(kept_s, residuals(offset_s)[is_known])

    costs = [np.linalg.norm(without_slow(kept_s, curve[is_known]), axis=1).mean() for curve in curves]
    best = int(np.argmin(costs))
    offset_s, sigma_s, used = float(grid_s[best]), np.inf, 0
    for _ in range(_ROUNDS):
        left = quick(offset_s)
        lengths = np.linalg.norm(left, axis=1)
        good = lengths <= _OUTLIER * _SCALE_OF_MEDIAN * np.median(lengths)
        near, far = (
            (quick(offset_s + step_s) - quick(offset_s - step_s)) / (2.0 * step_s) for step_s in (_STEP_S, 2 * _STEP_S)
        )
        # the white errors of attitude in the two slopes are independent, so they do not count as turning
        information = float(np.sum(near[good] * far[good]))
        used = int(good.sum())
        if information <= _LEAST_REAL * float(np.sum(near[good] ** 2)):
            return TimeOffset(None, np.inf, used)
        change_s = -float(np.sum(near[good] * left[good])) / information
        sigma_s = float(np.hypot(_pull(near[good], left[good]) / information, _CLOCKS_S))
        offset_s += float(np.clip(change_s, -_STEP_S, _STEP_S))
        if abs(change_s) < 1e-5:
            break
    is_sure = sigma_s <= MOST_SIGMA_S and 0 < best < len(grid_s) - 1 and abs(offset_s) < MOST_OFFSET_S
    return TimeOffset(offset_s if is_sure else None, sigma_s, used)


def without_slow(stamps_s: FloatArray, values: FloatArray) -> FloatArray:
    """Values (n, m) less their running mean."""
    sums = np.vstack([np.zeros(values.shape[1]), np.cumsum(values, axis=0)])
    first = np.searchsorted(stamps_s, stamps_s - _SLOW_S, side="left")
    last = np.searchsorted(stamps_s, stamps_s + _SLOW_S, side="right")
    return np.asarray(values - (sums[last] - sums[first]) / (last - first)[:, None])


def _pull(slope: FloatArray, left: FloatArray) -> float:
    """One standard deviation of the sum of slope times error, which is alike over `_LAGS` neighbours (Newey-West)."""
    pulls = np.sum(slope * left, axis=1)
    total = float(pulls @ pulls)
    for lag in range(1, _LAGS + 1):
        total += 2.0 * (1.0 - lag / (_LAGS + 1)) * float(pulls[lag:] @ pulls[:-lag])
    plain = float(np.mean(left**2)) * float(np.sum(slope**2))  # a sum that came out small by chance says nothing
    return float(np.sqrt(max(total, plain)))
