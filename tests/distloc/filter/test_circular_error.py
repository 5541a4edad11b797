"""CE90 of an ellipse beside an integral of another form, and beside draws."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from distloc.filter.uncertainty import circular_error90_m
from distloc.geometry.rotations import matrix_from_euler


def held(radius_m: float, east_m: float, north_m: float) -> float:
    """The probability within a circle, by strips: independent normals with these standard deviations."""
    edges = np.linspace(-radius_m, radius_m, 20_001)
    x = (edges[1:] + edges[:-1]) / 2.0
    heights = np.sqrt(radius_m**2 - x**2) / (north_m * math.sqrt(2.0))
    density = np.exp(-0.5 * (x / east_m) ** 2) / (east_m * math.sqrt(2.0 * math.pi))
    return float(np.sum(density * np.array([math.erf(one) for one in heights])) * (edges[1] - edges[0]))


@pytest.mark.parametrize("ratio", [1.0, 0.8, 0.5, 1.0 / 3.0, 0.1, 0.01])
def test_the_circle_holds_nine_tenths(ratio: float) -> None:
    assert held(circular_error90_m(np.diag([100.0**2, (100.0 * ratio) ** 2])), 100.0, 100.0 * ratio) == pytest.approx(
        0.9, abs=2e-5
    )


def test_a_circle_and_a_line_have_their_textbook_values() -> None:
    assert circular_error90_m(np.eye(2)) == pytest.approx(2.1460, abs=5e-5)
    assert circular_error90_m(np.diag([0.0, 1.0])) == pytest.approx(1.6449, abs=5e-5)


def test_draws_lie_inside_as_often() -> None:
    covariance = np.array([[9000.0, 5200.0], [5200.0, 3600.0]])
    draws = np.random.default_rng(5).multivariate_normal([0.0, 0.0], covariance, 100_000)
    share = float(np.mean(np.hypot(*draws.T) <= circular_error90_m(covariance)))
    assert 0.897 < share < 0.903


@given(st.floats(0.1, 1e6), st.floats(0.0, 1.0), st.floats(-math.pi, math.pi))
def test_it_turns_and_scales_with_the_ellipse(variance_m2: float, ratio: float, turn_rad: float) -> None:
    flat = np.diag([variance_m2, variance_m2 * ratio])
    R = matrix_from_euler(turn_rad, 0.0, 0.0)[:2, :2]
    radius_m = circular_error90_m(flat)
    assert circular_error90_m(R @ flat @ R.T) == pytest.approx(radius_m, rel=1e-6)
    assert circular_error90_m(4.0 * flat) == pytest.approx(2.0 * radius_m, rel=1e-9)
    assert 1.6448 * math.sqrt(variance_m2) <= radius_m <= 2.1461 * math.sqrt(variance_m2)


def test_what_is_no_covariance_has_none() -> None:
    for bad in (np.full((2, 2), np.nan), np.diag([np.inf, 1.0]), np.diag([1.0, -1.0]), np.zeros((2, 2))):
        assert math.isnan(circular_error90_m(bad))
