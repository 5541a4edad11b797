"""The best of all ways to give rows a column each, against all ways."""

from itertools import permutations

import numpy as np
import pytest

from distloc.tracks.assignment.matching import best_pairs
from distloc.types import FloatArray


def best_of_all(table: FloatArray) -> float:
    """By trying each: a row has a column more, of its own, that scores nothing."""
    rows = np.arange(table.shape[0])
    padded = np.hstack([table, np.zeros((rows.size, rows.size))])
    return max(float(padded[rows, list(order)].sum()) for order in permutations(range(padded.shape[1]), rows.size))


@pytest.mark.parametrize("seed", range(20))
def test_no_other_way_scores_more_and_none_is_taken_twice(seed: int) -> None:
    rng = np.random.default_rng(seed)
    rows, columns = int(rng.integers(1, 5)), int(rng.integers(1, 5))
    table = np.where(rng.random((rows, columns)) < 0.7, rng.uniform(-2.0, 9.0, (rows, columns)), 0.0)
    by_row, by_column = (one.ravel() for one in np.indices((rows, columns)))
    found = best_pairs(table.ravel(), by_row, by_column)
    assert len(set(by_row[found].tolist())) == len(set(by_column[found].tolist())) == len(found)
    assert (table.ravel()[found] > 0.0).all()
    assert table.ravel()[found].sum() == pytest.approx(best_of_all(np.maximum(table, 0.0)))


def test_the_best_pair_gives_way_where_two_others_are_better_together() -> None:
    assert sorted(best_pairs(np.array([5.0, 4.0, 4.0]), np.array([0, 0, 1]), np.array([0, 1, 0]))) == [1, 2]


def test_nothing_of_nothing_and_of_what_scores_nothing() -> None:
    none = np.array([], np.intp)
    assert best_pairs(np.array([]), none, none) == []
    assert best_pairs(np.array([-1.0, -np.inf]), np.array([0, 1]), np.array([0, 0])) == []
