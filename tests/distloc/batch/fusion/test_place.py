"""Split covariance intersection against what is known: independent errors, shared ones, and the best by brute force."""

import numpy as np
import pytest

from distloc.batch.fusion.place import PRIOR, SCALES, doubted, intersected, squared
from distloc.filter.uncertainty import CHI2_95
from distloc.types import FloatArray
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


def told(*places: tuple[float, float], sigma_m: float = 20.0) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Claims that are alike but for where they are, with nothing to speak of in common."""
    count = len(places)
    eye = np.repeat(np.eye(2)[None], count, axis=0)
    return np.array(places), sigma_m**2 * eye, 1e-6 * eye, np.tile(PRIOR, (count, 1))


def test_one_alone_is_as_told_and_the_farther_apart_two_are_the_larger_it_is() -> None:
    x, P, shared, prior = told((3.0, 4.0))
    one = doubted(x, P, shared, prior)
    assert one.larger == 1.0 and np.array_equal(one.covariance_m2, P[0]) and np.array_equal(one.position_en_m, x[0])
    larger = [doubted(*told((0.0, 0.0), (away_m, 0.0))).larger for away_m in (0.0, 40.0, 80.0, 160.0, 320.0)]
    assert 1.0 <= larger[0] < 1.6 and np.all(np.diff(larger) > 0.0)


def test_of_two_that_contradict_each_other_the_ellipse_holds_both() -> None:
    found = doubted(*told((0.0, 0.0), (300.0, 0.0)))
    assert found.position_en_m == pytest.approx([150.0, 0.0], abs=1e-6)
    assert squared(np.array([150.0, 0.0]), found.covariance_m2) < CHI2_95
    assert found.scales[0] == pytest.approx(found.scales[1]) and found.scales[0][0] < 0.6


def test_one_that_four_contradict_is_known_to_be_worse_and_moves_nothing() -> None:
    found = doubted(*told((0.0, 0.0), (5.0, -8.0), (-6.0, 3.0), (2.0, 6.0), (400.0, 0.0)))
    assert found.scales[4, 0] < 1e-6 and np.all(found.scales[:4, 0] > 0.7)
    assert np.linalg.norm(found.position_en_m) < 10.0
    assert 1.0 <= found.larger < 2.5


def test_the_ellipse_holds_95_percent_of_the_mixture_that_the_prior_makes() -> None:
    """1,200 draws of two from the prior itself: the ellipse is honest where the drones are as the prior has them."""
    rng, inside = np.random.default_rng(6), 0
    for _ in range(1200):
        scale = rng.choice(SCALES, size=2, p=PRIOR)
        x, P, shared, prior = told((0.0, 0.0), (0.0, 0.0))
        found = doubted(x + 20.0 * scale[:, None] * rng.normal(size=(2, 2)), P, shared, prior)
        inside += squared(found.position_en_m, found.covariance_m2) <= CHI2_95
    assert 0.93 <= inside / 1200 <= 0.97
