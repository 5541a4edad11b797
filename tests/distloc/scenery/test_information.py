"""Information matrices: what is let wander is as unsure as it should be, and nothing else is surer or moved."""

import numpy as np

from distloc.scenery.information import wandering


def test_what_wanders_gains_its_variance_alone() -> None:
    rng = np.random.default_rng(1)
    A = rng.normal(size=(6, 6))
    P, mean = A @ A.T + np.eye(6), rng.normal(size=6)
    H = np.linalg.inv(P)
    wider, vector = wandering(H, H @ mean, np.array([1, 4]), np.array([2.0, 3.0]))
    added = np.linalg.inv(wider) - P
    expected = np.zeros((6, 6))
    expected[1, 1], expected[4, 4] = 2.0, 3.0
    np.testing.assert_allclose(added, expected, atol=1e-9)
    np.testing.assert_allclose(np.linalg.solve(wider, vector), mean, atol=1e-9)
