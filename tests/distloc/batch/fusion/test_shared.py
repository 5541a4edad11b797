"""The shared part of a report, and that what is shared is not averaged away."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from distloc.batch.fusion.place import intersected
from distloc.batch.fusion.shared import AIM_M, GNSS_M, MOST_SHARE, aim_sigma_m, shared_part
from distloc.types import FloatArray


def long_along(azimuth_rad: float, along_m: float, across_m: float) -> FloatArray:
    way = np.array([math.sin(azimuth_rad), math.cos(azimuth_rad)])
    return np.asarray(across_m**2 * np.eye(2) + (along_m**2 - across_m**2) * np.outer(way, way))


@given(
    st.floats(0.0, 6.3),
    st.floats(0.5, 3e3),
    st.floats(0.5, 3e3),
    st.floats(0.0, 200.0),
    st.one_of(st.none(), st.floats(0.0, 6.3)),
)
def test_some_of_a_report_is_its_own_in_every_direction(
    azimuth_rad: float, along_m: float, across_m: float, aim_m: float, terrain_rad: float | None
) -> None:
    whole = long_along(azimuth_rad, along_m, across_m)
    part = shared_part(whole, aim_m, terrain_rad)
    assert np.linalg.eigvalsh(part)[0] > 0.0
    own = np.linalg.inv(np.linalg.cholesky(whole))
    shares = np.linalg.eigvalsh(own @ part @ own.T)
    assert shares[1] <= MOST_SHARE * (1.0 + 1e-6)


def test_in_a_report_that_is_much_larger_the_shared_part_is_as_large_as_told() -> None:
    part = shared_part(1e6 * np.eye(2), 20.0)
    np.testing.assert_allclose(part, (GNSS_M**2 + 20.0**2) * np.eye(2), rtol=1e-9, atol=1e-6)


def test_with_the_terrain_the_range_is_shared_and_the_bearing_is_not() -> None:
    part = shared_part(long_along(0.5, 400.0, 200.0), 20.0, 0.5)
    along = np.array([math.sin(0.5), math.cos(0.5)])
    across = np.array([along[1], -along[0]])
    assert along @ part @ along == pytest.approx(MOST_SHARE * 400.0**2, rel=1e-6)
    assert across @ part @ across == pytest.approx(GNSS_M**2 + 20.0**2, rel=1e-6)


def test_smoke_that_leans_more_is_aimed_at_less_surely_and_what_is_not_told_is_unsure() -> None:
    told = [aim_sigma_m(math.radians(lean_deg)) for lean_deg in (0.0, 45.0, 60.0, 70.0, 89.9)]
    assert told == pytest.approx([18.0, 19.5, 33.8, 53.6, 53.6], abs=0.1)
    assert aim_sigma_m(None) == aim_sigma_m(math.nan) == AIM_M


def test_five_that_err_alike_are_hardly_surer_than_one_and_five_far_ones_are() -> None:
    """Ellipses of 49 to 71 m about a place that is 45 m off for all: the fire is in what is fused of them."""
    reports = [(0.54, 29.0, 25.3), (-0.6, 25.0, 21.7), (3.14, 20.0, 17.5), (2.03, 22.4, 19.6), (-1.73, 22.0, 19.2)]
    covariances = np.array([long_along(*one) for one in reports])
    fused = intersected(np.zeros((5, 2)), covariances, np.array([shared_part(one) for one in covariances]))
    smallest_m, largest_m = np.sqrt(5.99 * np.linalg.eigvalsh(fused.covariance_m2))
    assert 42.0 < smallest_m <= largest_m < 49.0
    far = covariances * 400.0
    fused = intersected(np.zeros((5, 2)), far, np.array([shared_part(one) for one in far]))
    assert np.sqrt(5.99 * np.linalg.eigvalsh(fused.covariance_m2)[1]) < 0.5 * np.sqrt(5.99 * 400.0) * 25.0
