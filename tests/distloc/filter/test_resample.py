"""Resampling by counting gives what searching for each point would, in bounded memory."""

import tracemalloc

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from distloc.filter.resample import systematic_indices


@given(st.integers(1, 20_000), st.integers(1, 20_000), st.floats(0.0, 0.999999), st.integers(0, 2**32 - 1))
def test_each_gets_its_share_rounded_down_or_up(n: int, drawn: int, offset: float, seed: int) -> None:
    rng = np.random.default_rng(seed)
    weights = rng.random(n) ** rng.integers(1, 30) * (rng.random(n) < 0.7)
    weights[rng.integers(n)] += 1e-3
    chosen = systematic_indices(weights.astype(np.float32), offset, np.empty(drawn, np.intp))
    assert (np.diff(chosen) >= 0).all()
    shares = weights.astype(np.float32) / weights.astype(np.float32).sum(dtype=np.float64) * drawn
    counts = np.bincount(chosen, minlength=n)
    assert counts.size == n
    assert (np.abs(counts - shares) < 1.0 + 1e-9 * drawn).all()
    assert (counts[weights == 0.0] == 0).all()


def test_it_is_the_search_for_each_point() -> None:
    rng = np.random.default_rng(1)
    for n in (1, 7, 4095, 4096, 4097, 30_000):
        weights = rng.exponential(size=n)
        offset = float(rng.random())
        sums = np.cumsum(weights)
        searched = np.searchsorted(sums, (np.arange(n) + offset) * (sums[-1] / n), side="right")
        found = systematic_indices(weights, offset)
        assert np.count_nonzero(found != searched) <= 1  # a point on a sum's rounding


@pytest.mark.parametrize("place", [0, 4095, 4096, 99_999])
def test_one_that_has_all_the_weight_is_all(place: int) -> None:
    weights = np.zeros(100_000, np.float32)
    weights[place] = 1e-30
    assert (systematic_indices(weights, 0.7) == place).all()


@pytest.mark.parametrize("bad", [np.zeros(4), np.array([1.0, np.nan]), np.array([np.inf, 1.0])])
def test_weights_without_a_sum_are_refused(bad: np.ndarray) -> None:
    with pytest.raises(ValueError, match="finite sum above 0"):
        systematic_indices(bad, 0.5)


def test_memory_is_bounded_where_the_result_is_given() -> None:
    weights, out = np.random.default_rng(0).random(1_000_000).astype(np.float32), np.empty(1_000_000, np.intp)
    tracemalloc.start()
    try:
        systematic_indices(weights, 0.5, out)
        assert tracemalloc.get_traced_memory()[1] < 256 * 1024
    finally:
        tracemalloc.stop()
