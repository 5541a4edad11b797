"""Metrics by hand: the normalised error, GOSPA, the assignment under it and Wilson's interval."""

from itertools import permutations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from distloc.geometry.metrics import assignment, gospa, nees, wilson_interval

NONE = np.empty((2, 0))


def points(*at: tuple[float, float]) -> np.ndarray:
    return np.array(at, dtype=np.float64).T.reshape(2, -1)


def test_nees_by_hand() -> None:
    assert nees(np.array([3.0, 4.0]), np.diag([9.0, 4.0])) == pytest.approx(1.0 + 4.0)
    assert nees(np.array([1.0, 0.0]), np.array([[2.0, 1.0], [1.0, 2.0]])) == pytest.approx(2.0 / 3.0)
    with pytest.raises(np.linalg.LinAlgError):
        nees(np.ones(2), np.ones((2, 2)))


def test_nees_averages_to_its_degrees_of_freedom() -> None:
    covariance = np.array([[400.0, 150.0], [150.0, 100.0]])
    errors = np.random.default_rng(1).multivariate_normal(np.zeros(2), covariance, 4000)
    assert np.mean([nees(error, covariance) for error in errors]) == pytest.approx(2.0, abs=0.1)


def test_gospa_by_hand() -> None:
    # (0, 0) pairs with (3, 4), 5 m; (100, 0) has nobody within 20 m, and (50, 50) belongs to nobody
    found = gospa(points((0, 0), (100, 0)), points((50, 50), (3, 4)), cutoff_m=20.0)
    assert found.localisation == pytest.approx(5.0) and (found.missed, found.false) == (1, 1)
    assert found.distance == pytest.approx(np.sqrt(25.0 + 200.0 * 2))
    first = gospa(points((0, 0), (100, 0)), points((50, 50), (3, 4)), cutoff_m=20.0, order=1)
    assert first.distance == pytest.approx(5.0 + 10.0 * 2)


def test_gospa_of_nothing() -> None:
    assert gospa(NONE, NONE, 10.0).distance == 0.0
    missed = gospa(points((0, 0), (1, 1)), NONE, 10.0)
    assert missed.distance == pytest.approx(10.0) and (missed.missed, missed.false) == (2, 0)  # sqrt(100 / 2 x 2)
    false = gospa(NONE, points((0, 0)), 10.0)
    assert false.distance == pytest.approx(np.sqrt(50.0)) and (false.missed, false.false) == (0, 1)
    with pytest.raises(ValueError, match="cutoff_m must be > 0"):
        gospa(NONE, NONE, 0.0)


def test_gospa_takes_the_best_assignment_and_not_the_nearest_first() -> None:
    truths, estimates = np.array([[0.0, 10.0], [0.0, 0.0], [5.0, 5.0]]), np.array([[9.0, -9.0], [0.0, 0.0], [5.0, 5.0]])
    found = gospa(truths, estimates, cutoff_m=100.0)
    assert found.distance == pytest.approx(np.sqrt(81.0 + 1.0))
    truths, estimates = points((0, 0), (10, 0)), points((9, 0), (21, 0))
    assert gospa(truths, estimates, cutoff_m=100.0).distance == pytest.approx(np.sqrt(81.0 + 121.0))  # not 1 and 441


@given(st.integers(0, 5), st.integers(0, 5), st.integers(0, 10_000))
def test_assignment_is_as_good_as_the_best_of_all(rows: int, columns: int, seed: int) -> None:
    costs = np.random.default_rng(seed).random((rows, columns))
    pairs = assignment(costs)
    few = min(rows, columns)
    assert len(pairs) == len({row for row, _ in pairs}) == len({column for _, column in pairs}) == few
    wide = costs if rows <= columns else costs.T
    least = min(sum(wide[i, j] for i, j in enumerate(order)) for order in permutations(range(max(rows, columns)), few))
    assert sum(costs[pair] for pair in pairs) == pytest.approx(least)


def test_wilson_interval_by_hand() -> None:
    # 95 of 100 and z = 1.96: (0.95 + 0.0192) / 1.0384 -+ 1.96 / 1.0384 sqrt(0.0475 / 100 + 3.8416 / 40000)
    assert wilson_interval(95, 100) == pytest.approx((0.8882, 0.9785), abs=1e-4)
    assert wilson_interval(0, 10) == pytest.approx((0.0, 0.2775), abs=1e-4)
    assert wilson_interval(10, 10) == pytest.approx((0.7225, 1.0), abs=1e-4)
    assert wilson_interval(0, 0) == (0.0, 1.0)
    with pytest.raises(ValueError, match="11 of 10"):
        wilson_interval(11, 10)
