"""How far a silhouette's middle strays, against drawn blocks."""

import numpy as np
import pytest

from distloc.sights.aspect import Aspect, Turn, aim_sigma_rad


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
    stated_rad = float(np.sqrt(np.square(aim_sigma_rad(widths)).mean()))
    assert 1.0 < stated_rad / rms_rad < 2.0  # a block seen corner on is wider than its face


TARGET_M = np.array([0.0, 1000.0, 100.0])


def test_a_share_of_the_error_is_left_by_how_far_the_view_turned() -> None:
    start = np.zeros(3)
    assert Aspect(TARGET_M, start).turned(TARGET_M, start).kept == 1.0
    straight = Aspect(TARGET_M, start).turned(TARGET_M, np.array([0.0, 500.0, 50.0]))
    assert straight.kept == pytest.approx(1.0, abs=1e-6)
    higher = Aspect(TARGET_M, start).turned(TARGET_M, np.array([0.0, 0.0, 200.0]))
    aside = Aspect(TARGET_M, start).turned(TARGET_M, np.array([200.0, 0.0, 0.0]))
    assert 0.05 < aside.kept < 0.5 and 0.05 < higher.kept < 0.5
    steps = Aspect(TARGET_M, start)
    in_two = [steps.turned(TARGET_M, np.array([east_m, 0.0, 0.0])).kept for east_m in (100.0, 200.0)]
    assert np.prod(in_two) == pytest.approx(aside.kept, rel=1e-2)


def test_legs_to_and_fro_are_visits_to_the_same_sides() -> None:
    aspect = Aspect(TARGET_M, np.array([-400.0, 0.0, 0.0]))
    legs_m = np.concatenate([np.arange(-400.0, 401.0, 20.0), np.arange(400.0, -401.0, -20.0)])
    visits = [aspect.turned(TARGET_M, np.array([east_m, 0.0, 0.0])).visit for east_m in legs_m]
    assert set(visits[:30]) == {1}
    assert set(visits[60:]) == {2}
    still = Aspect(TARGET_M, np.zeros(3))
    rng = np.random.default_rng(0)
    wobbles = [still.turned(TARGET_M, np.array([*rng.normal(0.0, 5.0, 2), 0.0])).visit for _ in range(200)]
    assert set(wobbles) == {1}  # however near the edge of a side it is held


def test_all_visits_together_tell_what_one_aim_can() -> None:
    """Sightings with that much doubt add up to what their mean is worth, the aim's error being common to all."""
    aim, white, count = 5.0e-6, 3.0e-6, 4
    information = 0.0
    for visit in range(1, 6):
        doubt = Turn(1.0, 1.0, visit, count).doubt(aim, white)
        information += 1.0 / (doubt * white / count + aim)
        assert information == pytest.approx(1.0 / (white / (count * visit) + aim), rel=1e-9)
