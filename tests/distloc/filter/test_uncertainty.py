import numpy as np
import pytest

from distloc.filter.uncertainty import credible_ellipse, ellipse_holds, grown
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
