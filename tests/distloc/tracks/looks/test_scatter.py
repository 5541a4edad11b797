"""What a target's segments stray by is learnt, and what stays to one side is not taken for it."""

import numpy as np
import pytest

from distloc.tracks.looks.scatter import Scatter

WHITE = np.diag([0.002**2, 0.001**2])


def learnt(offsets: np.ndarray, white: np.ndarray = WHITE) -> np.ndarray:
    """By the second of two targets' rows; the first sees nothing."""
    scatter, row = Scatter(2), np.array([1])
    for offset in offsets:
        scatter.add(row, offset[None], (white + np.diag(scatter.variance(row)[0]))[None])
    untouched, found = scatter.variance(np.arange(2))
    assert not untouched.any()
    return np.asarray(found)


def test_nothing_is_learnt_from_what_was_expected() -> None:
    rng = np.random.default_rng(1)
    found = [learnt(rng.normal(0.0, [0.002, 0.001], (60, 2))) for _ in range(40)]
    assert np.sqrt(np.mean(found, axis=0))[0] < 0.0012
    assert np.array_equal(learnt(np.zeros((5, 2))), np.zeros(2))


@pytest.mark.parametrize("alike", [0.0, 0.6])
def test_what_strays_to_and_fro_is_learnt(alike: float) -> None:
    rng = np.random.default_rng(2)
    off, offsets = np.zeros(2), []
    for _ in range(200):
        off = alike * off + np.sqrt(1.0 - alike**2) * rng.normal(0.0, [0.02, 0.0], 2)
        offsets.append(off + rng.normal(0.0, [0.002, 0.001]))
    sigma = np.sqrt(learnt(np.array(offsets)))
    assert 0.01 < sigma[0] < 0.03
    assert sigma[1] < 0.001


def test_what_stays_to_one_side_is_not_scatter() -> None:
    rng = np.random.default_rng(3)
    sigma = np.sqrt(learnt(np.array([0.02, 0.0]) + rng.normal(0.0, [0.002, 0.001], (40, 2))))
    assert sigma[0] < 0.004
