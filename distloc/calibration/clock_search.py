"""Where in a flight a film lies, by how the camera turns in both; the importers' clock tie calls it.

The turns of the frames are held against those of the poses at every offset (normalised cross-correlation by FFT, all
three axes at once); `time_offset` then finds the rest, to milliseconds.
"""

from dataclasses import dataclass

import numpy as np

from distloc.types import BoolArray, FloatArray

GRID_S = 0.05
_SLOW_S = 3.0  # half the running mean that is taken off: parallax, and a compass that drifts
_LEAST_OVERLAP_S = 10.0
_LEAST_SHARE = 0.5  # of the shorter of the two, that must lie in both
_EVEN_S = 1e-3
_PEAK_S = 1.0  # half the width of one peak
LEAST_LIKE = 0.5  # correlation
_LEAST_AHEAD = 2.0  # by how much more any other place leaves unexplained: an F of 2 over the hundred turns of 10 s


@dataclass(frozen=True, slots=True)
class ClockSearch:
    """`offset_s`: added to the frames' times it gives the poses'; `like` is the correlation there, `next_like` of the

    best other place. `is_clear` says whether the turning tells them apart.
    """

    offset_s: float
    like: float
    next_like: float

    @property
    def is_clear(self) -> bool:
        """Whether this place, and no other, fits."""
        left, left_elsewhere = 1.0 - self.like**2, 1.0 - max(0.0, self.next_like) ** 2
        return self.like >= LEAST_LIKE and left_elsewhere >= _LEAST_AHEAD * left


def rates_on_grid(
    starts_s: FloatArray, ends_s: FloatArray, turns_rad: FloatArray, longest_s: float
) -> tuple[float, FloatArray, BoolArray]:
    """Turns (n, 3) between times as rates (m, 3) every `GRID_S` from the first time on, and which of them are known."""
    middles_s = (starts_s + ends_s) / 2.0
    first_s = float(middles_s[0])
    grid_s = np.arange(0.0, float(middles_s[-1]) - first_s + GRID_S / 2.0, GRID_S) + first_s
    rates = turns_rad / (ends_s - starts_s)[:, None]
    out = np.stack([np.interp(grid_s, middles_s, one) for one in rates.T], axis=1)
    after = np.clip(np.searchsorted(middles_s, grid_s), 1, max(1, len(middles_s) - 1))
    return first_s, out, (middles_s[after] - middles_s[after - 1]) <= longest_s


def chained(
    starts_s: FloatArray, ends_s: FloatArray, turns: FloatArray, span_s: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Turns (n, 3, 3) from frame to frame as turns over `span_s`, a new one every half of it: start, end, turn.

    Over so long a camera turns by more than corners err; where a frame is missing none is made.
    """
    rows: list[tuple[float, float, FloatArray]] = []
    first = 0
    while first < len(starts_s):
        R, last = turns[first], first
        while ends_s[last] - starts_s[first] < span_s - _EVEN_S and last + 1 < len(starts_s):
            if starts_s[last + 1] != ends_s[last]:
                break
            last += 1
            R = turns[last] @ R
        if ends_s[last] - starts_s[first] >= span_s - _EVEN_S:
            rows.append((float(starts_s[first]), float(ends_s[last]), R))
        first = max(first + 1, int(np.searchsorted(starts_s, starts_s[first] + span_s / 2.0 - _EVEN_S)))
    if not rows:
        return np.zeros(0), np.zeros(0), np.zeros((0, 3, 3))
    return np.array([row[0] for row in rows]), np.array([row[1] for row in rows]), np.stack([row[2] for row in rows])


def search_clock(
    frames: tuple[float, FloatArray, BoolArray], poses: tuple[float, FloatArray, BoolArray]
) -> ClockSearch | None:
    """Where the frames' rates fit the poses' best; both as `rates_on_grid` gives them. None: too short to say."""
    (frames_s, of_frames, has_frame), (poses_s, of_poses, has_pose) = frames, poses
    least = min(_LEAST_SHARE * min(has_frame.sum(), has_pose.sum()), 600.0 / GRID_S)
    if least * GRID_S < _LEAST_OVERLAP_S * _LEAST_SHARE:
        return None
    a, b = _without_slow(of_frames, has_frame), _without_slow(of_poses, has_pose)
    size = 1 << int(np.ceil(np.log2(len(a) + len(b))))

    def correlated(x: FloatArray, y: FloatArray) -> FloatArray:
        product = np.conj(np.fft.rfft(x, size, axis=0)) * np.fft.rfft(y, size, axis=0)
        return np.asarray(np.fft.irfft(product.sum(axis=1), size))

    mask_a, mask_b = has_frame[:, None].astype(np.float64), has_pose[:, None].astype(np.float64)
    overlap = correlated(mask_a, mask_b)
    power_a = correlated((a**2).sum(axis=1, keepdims=True), mask_b)
    power_b = correlated(mask_a, (b**2).sum(axis=1, keepdims=True))
    scale = np.sqrt(np.maximum(power_a, 1e-12) * np.maximum(power_b, 1e-12))
    like = np.where(overlap >= least, correlated(a, b) / scale, -1.0)
    best = int(np.argmax(like))
    steps = np.minimum((np.arange(size) - best) % size, (best - np.arange(size)) % size)
    others = like[steps * GRID_S > _PEAK_S]
    lag = best if best <= len(b) else best - size
    return ClockSearch(poses_s - frames_s + lag * GRID_S, float(like[best]), float(others.max()))


def _without_slow(rates: FloatArray, is_known: BoolArray) -> FloatArray:
    """Less their running mean; 0 where unknown."""
    half = int(_SLOW_S / GRID_S)
    known = is_known.astype(np.float64)
    window = np.ones(2 * half + 1)
    count = np.maximum(np.convolve(known, window, mode="same"), 1.0)
    values = np.where(is_known[:, None], rates, 0.0)
    means = np.stack([np.convolve(one, window, mode="same") / count for one in values.T], axis=1)
    return np.asarray(np.where(is_known[:, None], values - means, 0.0))
