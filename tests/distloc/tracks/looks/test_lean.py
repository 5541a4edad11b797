"""From what is seen of a root to the fire under it: by the smoke's lean, the root's width and the ground."""

from dataclasses import replace

import numpy as np
import pytest

from distloc.filter.ground import FlatGround, Ground, NoGround
from distloc.geometry.camera import Camera
from distloc.sights.sights import Ray, ray_of
from distloc.tracks.looks.lean import Beside, Leans, hidden_of
from distloc.types import CameraPose, Detection, FloatArray, Root
from tests.support.cube_samples import R_NORTH

CAMERA = Camera(640, 360, 450.0, 450.0, 319.5, 179.5)
ONE = np.array([0])
SEEN_ENU_M = np.array([[0.0, 2000.0, 40.0]])


def ray(lean: float, stamp_s: float = 0.0, looks_east: bool = False) -> Ray:
    turned = np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]) if looks_east else np.eye(3)
    point = Detection.from_point(319.5, 179.5, 2.0)
    seen = replace(point, is_point=False, root=Root(20.0, 1.0, lean))
    return ray_of(CAMERA, CameraPose(stamp_s, np.zeros(3), R_NORTH @ turned.T), seen, "base")


def add(leans: Leans, seen: Ray) -> None:
    """Of all targets."""
    places = np.arange(len(leans.weighed))
    right_enu, lean = np.repeat(seen.axes[None, 0], places.size, axis=0), np.full(places.size, seen.lean)
    leans.add(places, seen.pose.stamp_s, right_enu, lean)


def leaning(lean: float, seconds: int = 100, targets: int = 1) -> Leans:
    found = Leans(targets)
    for stamp_s in range(seconds):
        add(found, ray(lean, float(stamp_s)))
    return found


def hidden(leans: Leans, root_m: FloatArray, up_m2: FloatArray, ground: Ground) -> Beside:
    places = np.arange(root_m.size)
    return hidden_of(*leans.of(places), root_m, np.repeat(SEEN_ENU_M, root_m.size, axis=0), up_m2, ground)


def test_what_one_side_shows_is_the_lean_across_and_nothing_along() -> None:
    (mean,), (covariance,) = leaning(1.0).of(ONE)
    assert mean == pytest.approx([0.63, 0.0], abs=0.03)  # 0.65 of what it is over the root, and the prior
    assert covariance[0, 0] < 0.25**2 and covariance[1, 1] > 0.5**2


def test_from_two_sides_it_is_known_whole_and_old_looks_are_forgotten() -> None:
    lean = leaning(1.0, 30)
    for stamp_s in range(30, 60):
        add(lean, ray(-1.0, float(stamp_s), looks_east=True))  # right of a camera that looks east is south
    (mean,), (covariance,) = lean.of(ONE)
    assert mean[0] > 0.4 and mean[1] > 0.4 and covariance.diagonal().max() < 0.35**2
    add(lean, ray(0.0, 2000.0))
    assert np.abs(lean.of(ONE)[0]).max() < 0.01


def test_the_fire_is_upwind_under_a_root_and_the_wider_that_is_the_less_sure() -> None:
    found = hidden(leaning(1.0, targets=2), np.array([20.0, 60.0]), np.full(2, 100.0), NoGround())
    assert (found.shift_enu_m[:, 0] < 0.0).all() and (found.shift_enu_m[:, 2] < 0.0).all()
    assert found.shift_enu_m[1] == pytest.approx(3.0 * found.shift_enu_m[0])
    assert found.covariance_m2[1] == pytest.approx(9.0 * found.covariance_m2[0])


def test_ground_that_is_known_says_how_far_under_it() -> None:
    root_m, up_m2 = np.array([60.0]), np.array([1.0])
    on, over = (hidden(leaning(1.0), root_m, up_m2, FlatGround(up_m, 3.0, slope=0.0)) for up_m in (40.0, -10.0))
    assert on.shift_enu_m[0, 2] > -5.0 and over.shift_enu_m[0, 2] < -45.0
    assert over.up_sigma_m[0] < 4.0


def test_without_a_root_nothing_is_hidden() -> None:
    found = hidden(Leans(1), np.zeros(1), np.ones(1), FlatGround(0.0, 30.0, slope=0.0))
    assert not found.shift_enu_m.any() and not found.covariance_m2.any() and not found.up_sigma_m.any()
