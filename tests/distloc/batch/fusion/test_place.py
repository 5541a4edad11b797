"""Split covariance intersection against what is known: independent errors, shared ones, and the best by brute force."""

import numpy as np
import pytest

from distloc.batch.fusion.place import enlargement, intersected
from tests.distloc.batch.fusion.samples import spd


def test_independent_claims_are_fused_as_by_least_squares() -> None:
    rng = np.random.default_rng(3)
    x, P = rng.normal(size=(4, 2)), np.array([spd(rng) for _ in range(4)])
    found = intersected(x, P, np.zeros_like(P))
    information = np.linalg.inv(P).sum(axis=0)
    assert found.covariance_m2 == pytest.approx(np.linalg.inv(information), rel=1e-9)
    stacked = np.linalg.cholesky(np.linalg.inv(P)).transpose(0, 2, 1)
    A, b = stacked.reshape(-1, 2), np.einsum("nij,nj->ni", stacked, x).ravel()
    assert found.position_en_m == pytest.approx(np.linalg.lstsq(A, b, rcond=None)[0], rel=1e-9)


def test_a_shared_error_is_not_averaged_away() -> None:
    shared = 9.0 * np.eye(2)
    P = np.repeat((25.0 * np.eye(2) + shared)[None], 5, axis=0)
    found = intersected(np.zeros((5, 2)), P, np.repeat(shared[None], 5, axis=0))
    assert found.covariance_m2 == pytest.approx((25.0 / 5.0 + 9.0) * np.eye(2), rel=1e-6)


def test_the_weights_are_those_with_the_least_trace() -> None:
    rng = np.random.default_rng(4)
    own, shared = np.array([spd(rng), spd(rng)]), np.array([spd(rng), spd(rng)])
    found = intersected(np.zeros((2, 2)), own + shared, shared)
    w = np.linspace(0.001, 0.999, 4000)[:, None, None]
    first, second = own[0] + shared[0] / w, own[1] + shared[1] / (1.0 - w)
    traces = np.trace(np.linalg.inv(np.linalg.inv(first) + np.linalg.inv(second)), axis1=1, axis2=2)
    assert np.trace(found.covariance_m2) == pytest.approx(traces.min(), rel=1e-4)


@pytest.mark.parametrize("correlation", [-1.0, 0.0, 1.0])
def test_it_is_honest_whatever_the_shared_errors_have_in_common(correlation: float) -> None:
    """2,000 draws: the error's mean square is within the covariance in every direction, by 5 % at most more."""
    rng = np.random.default_rng(5)
    own, shared = np.array([spd(rng), spd(rng)]), np.array([spd(rng), spd(rng)])
    common = rng.normal(size=(2000, 2))
    other = correlation * common + np.sqrt(1.0 - correlation**2) * rng.normal(size=(2000, 2))
    errors = []
    for draw in range(2000):
        x = np.stack(
            [
                np.linalg.cholesky(shared[i]) @ part[draw] + np.linalg.cholesky(own[i]) @ rng.normal(size=2)
                for i, part in enumerate((common, other))
            ]
        )
        found = intersected(x, own + shared, shared)
        errors.append(found.position_en_m)
    ratio = np.linalg.eigvals(np.linalg.solve(found.covariance_m2, np.cov(np.array(errors).T)))
    assert 0.02 < ratio.real.min() <= ratio.real.max() < 1.1


def test_one_alone_is_as_told_and_scatter_makes_larger() -> None:
    assert enlargement(0.0, 1) == 1.0
    assert enlargement(2.0, 2) < enlargement(8.0, 2) < enlargement(20.0, 2)
    assert 1.0 < enlargement(198.0, 100) < 1.1  # of a hundred that scatter as told
