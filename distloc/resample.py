"""Systematic resampling, the lowest-variance of the standard schemes (Kitagawa 1996)."""

import numpy as np
from numpy.typing import NDArray

from distloc.types import FloatArray


def effective_sample_size(weights: FloatArray) -> float:
    """1 / sum w^2 of weights (N,) that sum to 1."""
    return float(1.0 / np.square(weights).sum())


def systematic_indices(weights: FloatArray, rng: np.random.Generator) -> NDArray[np.intp]:
    """Indices (N,), rising: particle i appears floor(N w_i) or ceil(N w_i) times.

    Weights (N,) need not sum to 1; ValueError where their sum is not above 0.
    """
    n = weights.shape[0]
    cumulative = np.cumsum(weights, dtype=np.float64)
    if not (np.isfinite(cumulative[-1]) and cumulative[-1] > 0):
        raise ValueError(f"weights must have a finite sum above 0, got {cumulative[-1]}")
    points = (np.arange(n) + rng.random()) * (cumulative[-1] / n)
    return np.asarray(np.minimum(np.searchsorted(cumulative, points, side="right"), n - 1), dtype=np.intp)
