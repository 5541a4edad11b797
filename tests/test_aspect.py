"""How far a silhouette's middle strays, against drawn blocks."""

import numpy as np
import pytest

from distloc.aspect import Aspect, aim_sigma_rad


def strays_rad(half_m: float, range_m: float, turned_rad: float) -> tuple[float, float]:
    """Of a square block seen `turned_rad` off its face: the middle ray off its centre's direction, and its width."""
    corners = half_m * np.array([[-1.0, 1.0, 1.0, -1.0], [-1.0, -1.0, 1.0, 1.0]])
    cos, sin = np.cos(turned_rad), np.sin(turned_rad)
    right, away = np.array([[cos, -sin], [sin, cos]]) @ corners
    bearings = np.arctan2(right, range_m + away)
    return (bearings.min() + bearings.max()) / 2.0, bearings.max() - bearings.min()


@pytest.mark.parametrize("range_m", [500.0, 1000.0, 4000.0])
def test_the_error_of_a_square_block_has_the_stated_size(range_m: float) -> None:
    strays, widths = np.array([strays_rad(50.0, range_m, turn) for turn in np.radians(np.arange(0.5, 360.0))]).T
    rms_rad = float(np.sqrt(np.square(strays).mean()))
    assert abs(strays.mean()) < 0.1 * rms_rad
    stated_rad = float(np.sqrt(np.mean([aim_sigma_rad(width) ** 2 for width in widths])))
    assert 1.0 < stated_rad / rms_rad < 2.0  # a block seen corner on is wider than its face


def test_a_share_of_the_error_is_left_by_how_far_the_view_turned() -> None:
    target_m = np.array([0.0, 1000.0, 100.0])
    aspect = Aspect(np.zeros(3))
    assert aspect.turned(target_m, np.zeros(3)) == 1.0
    assert aspect.turned(target_m, np.array([0.0, 500.0, 50.0])) == pytest.approx(1.0, abs=1e-6)  # straight at it
    in_one = Aspect(np.zeros(3)).turned(target_m, np.array([200.0, 0.0, 0.0]))
    steps = Aspect(np.zeros(3))
    in_two = steps.turned(target_m, np.array([100.0, 0.0, 0.0])) * steps.turned(target_m, np.array([200.0, 0.0, 0.0]))
    assert 0.05 < in_one < 0.5
    assert in_two == pytest.approx(in_one, rel=1e-2)
