import numpy as np
import pytest

from distloc.filter.uncertainty import (
    circular_error90_m,
    credible_ellipse,
    ellipse_holds,
    equal_parts,
    grown,
    quantiles,
    weighted_quantile,
)
from distloc.types import Ellipse


def gaussian(azimuth_rad: float, sigmas_m: tuple[float, float], count: int, seed: int) -> np.ndarray:
    along = np.array([np.sin(azimuth_rad), np.cos(azimuth_rad)])
    across = np.array([along[1], -along[0]])
    samples = np.random.default_rng(seed).standard_normal((2, count)) * np.array(sigmas_m)[:, None]
    return np.outer(along, samples[0]) + np.outer(across, samples[1])


def test_axes_of_a_gaussian_and_the_share_of_fresh_samples_inside() -> None:
    ellipse = credible_ellipse(gaussian(0.5, (300.0, 40.0), 100_000, seed=1) + np.array([[1e4], [-2e4]]))
    assert ellipse.semi_major_m == pytest.approx(2.448 * 300.0, rel=0.02)
    assert ellipse.semi_minor_m == pytest.approx(2.448 * 40.0, rel=0.02)
    inside = [ellipse_holds(ellipse, offset) for offset in gaussian(0.5, (300.0, 40.0), 20_000, seed=2).T]
    assert np.mean(inside) == pytest.approx(0.95, abs=0.01)


@pytest.mark.parametrize("azimuth_deg", [1.0, 30.0, 90.0, 150.0, 179.0])
def test_azimuth_is_clockwise_from_north(azimuth_deg: float) -> None:
    ellipse = credible_ellipse(gaussian(np.radians(azimuth_deg), (300.0, 40.0), 50_000, seed=3))
    assert np.degrees(ellipse.azimuth_rad) == pytest.approx(azimuth_deg, abs=0.3)


def test_ellipse_by_hand() -> None:
    east = Ellipse(100.0, 10.0, np.pi / 2)
    offsets = [(99.0, 0.0), (-99.0, 0.0), (101.0, 0.0), (0.0, 9.0), (0.0, 11.0)]
    assert [ellipse_holds(east, np.array(offset)) for offset in offsets] == [True, True, False, True, False]
    assert grown(east, 5.0) == Ellipse(105.0, 15.0, np.pi / 2)


def test_degenerate_clouds_get_a_millimetre() -> None:
    point = credible_ellipse(np.full((2, 50), 7.0))
    assert (point.semi_major_m, point.semi_minor_m) == (1e-3, 1e-3)
    line = credible_ellipse(np.vstack([np.zeros(1001), np.linspace(-100.0, 100.0, 1001)]))
    assert line.semi_major_m == pytest.approx(95.0, abs=0.2)
    assert line.semi_minor_m < 0.01
    assert np.sin(line.azimuth_rad) == pytest.approx(0.0, abs=1e-6)


def test_quantiles_of_equal_values_are_hazens() -> None:
    values = np.random.default_rng(0).standard_normal((3, 501)).astype(np.float32)
    expected = np.quantile(values, (0.025, 0.95), axis=1, method="hazen")
    assert quantiles(values, (0.025, 0.95)) == pytest.approx(expected, abs=1e-6)
    assert quantiles(values[:, :1], (0.5,)) == pytest.approx(values[None, :, 0])  # of one there is but one


def test_equal_parts_have_the_weights_of_what_they_are_of() -> None:
    rng = np.random.default_rng(1)
    values = rng.standard_normal((2, 3, 2000)).astype(np.float32)
    weights = rng.exponential(size=(3, 2000)).astype(np.float32)
    weights[1, 7:] = 0.0  # few have all of the weight
    weights /= weights.sum(axis=1, keepdims=True)
    parts = equal_parts(values, weights)
    assert parts.shape == values.shape
    for row in range(2):
        for target in range(3):
            held, counts = np.unique(parts[row, target], return_counts=True)
            at = {float(value): weight for value, weight in zip(values[row, target], weights[target], strict=True)}
            assert counts == pytest.approx([2000 * at[float(value)] for value in held], abs=1.001)
    for target in (0, 2):
        expected = weighted_quantile(values[0, target], weights[target], 0.95)
        assert quantiles(parts[0, target : target + 1], (0.95,))[0, 0] == pytest.approx(expected, abs=0.1)


@pytest.mark.parametrize(
    ("sigmas_m", "radius_m"),
    [  # where SciPy's quad of the density at x, times erf of the chord's half over sigma2 and sqrt 2, is 0.9
        ((1.0, 0.0), 1.6448536),
        ((1.0, 0.2), 1.6573135),
        ((1.0, 0.5), 1.7370800),
        ((1.0, 0.8), 1.9471581),
        ((1.0, 1.0), 2.1459660),
    ],
)
def test_ce90_is_another_integral_s(sigmas_m: tuple[float, float], radius_m: float) -> None:
    azimuth_rad = 0.7
    along = np.array([np.sin(azimuth_rad), np.cos(azimuth_rad)]) * sigmas_m[0] * 300.0
    across = np.array([np.cos(azimuth_rad), -np.sin(azimuth_rad)]) * sigmas_m[1] * 300.0
    assert circular_error90_m(np.outer(along, along) + np.outer(across, across)) == pytest.approx(
        300.0 * radius_m, rel=1e-6
    )
