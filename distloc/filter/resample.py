"""Systematic resampling, the lowest-variance of the standard schemes (Kitagawa 1996), by counting."""

import numpy as np
from numpy.typing import NDArray

_BLOCK = 4096  # weights at a time: what is allocated does not grow with N


def systematic_indices(
    weights: NDArray[np.floating], offset: float, out: NDArray[np.intp] | None = None
) -> NDArray[np.intp]:
    """Indices, rising, as many as `out` has, or else as there are weights (N,): a particle's share is its weight's.

    Of M indices particle i gets floor or ceil of M w_i; `offset` in [0, 1) is the one random number. Weights need not
    sum to 1; ValueError where their sum is not above 0.
    """
    n = weights.shape[0]
    chosen = np.empty(n, dtype=np.intp) if out is None else out
    total = float(weights.sum(dtype=np.float64))
    if not (np.isfinite(total) and total > 0):
        raise ValueError(f"weights must have a finite sum above 0, got {total}")
    chosen.fill(0)
    last, carried = 0, 0.0
    for start in range(0, n, _BLOCK):
        cumulative = np.cumsum(weights[start : start + _BLOCK], dtype=np.float64)
        cumulative += carried
        carried = float(cumulative[-1])
        # how many points (k + offset) / M lie below each sum; the next particle's indices begin there
        cumulative *= chosen.size / total
        cumulative -= offset
        np.ceil(cumulative, out=cumulative)
        begins = np.empty(cumulative.size + 1, dtype=np.intp)
        begins[0] = last
        np.clip(cumulative, last, chosen.size, out=begins[1:], casting="unsafe")
        last = int(begins[-1])
        drawn = np.flatnonzero(begins[1:] > begins[:-1])
        chosen[begins[drawn]] = drawn + start
    for start in range(0, chosen.size, _BLOCK):
        part = chosen[max(start - 1, 0) : start + _BLOCK]
        np.maximum.accumulate(part, out=part)
    return chosen
