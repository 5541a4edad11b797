"""From what is seen of a root to the fire under it: by the smoke's lean, the root's width and the ground."""

from dataclasses import replace

import numpy as np
import pytest

from distloc.filter.ground import FlatGround, NoGround
from distloc.geometry.camera import Camera
from distloc.sights.sights import Ray, ray_of
from distloc.tracks.looks.lean import Lean, hidden_of, leans_of
from distloc.types import CameraPose, Detection, Root
from tests.support.cube_samples import R_NORTH

CAMERA = Camera(640, 360, 450.0, 450.0, 319.5, 179.5)
SEEN_ENU_M = np.array([[0.0, 2000.0, 40.0]])


def ray(lean: float, stamp_s: float = 0.0, looks_east: bool = False) -> Ray:
    turned = np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]) if looks_east else np.eye(3)
    point = Detection.from_point(319.5, 179.5, 2.0)
    seen = replace(point, is_point=False, root=Root(20.0, 1.0, lean))
    return ray_of(CAMERA, CameraPose(stamp_s, np.zeros(3), R_NORTH @ turned.T), seen, "base")


def leaning(lean: float, seconds: int = 100) -> Lean:
    found = Lean()
    for stamp_s in range(seconds):
        found.add(ray(lean, float(stamp_s)))
    return found


def test_what_one_side_shows_is_the_lean_across_and_nothing_along() -> None:
    (mean,), (covariance,) = leans_of([leaning(1.0)])
    assert mean == pytest.approx([0.63, 0.0], abs=0.03)  # 0.65 of what it is over the root, and the prior
    assert covariance[0, 0] < 0.25**2 and covariance[1, 1] > 0.5**2


def test_from_two_sides_it_is_known_whole_and_old_looks_are_forgotten() -> None:
    lean = leaning(1.0, 30)
    for stamp_s in range(30, 60):
        lean.add(ray(-1.0, float(stamp_s), looks_east=True))  # right of a camera that looks east is south
    (mean,), (covariance,) = leans_of([lean])
    assert mean[0] > 0.4 and mean[1] > 0.4 and covariance.diagonal().max() < 0.35**2
    lean.add(ray(0.0, 2000.0))
    assert np.abs(leans_of([lean])[0]).max() < 0.01


def test_the_fire_is_upwind_under_a_root_and_the_wider_that_is_the_less_sure() -> None:
    leans = [leaning(1.0), leaning(1.0)]
    found = hidden_of(leans, np.array([20.0, 60.0]), np.repeat(SEEN_ENU_M, 2, axis=0), np.full(2, 100.0), NoGround())
    assert (found.shift_enu_m[:, 0] < 0.0).all() and (found.shift_enu_m[:, 2] < 0.0).all()
    assert found.shift_enu_m[1] == pytest.approx(3.0 * found.shift_enu_m[0])
    assert found.covariance_m2[1] == pytest.approx(9.0 * found.covariance_m2[0])


def test_ground_that_is_known_says_how_far_under_it() -> None:
    root_m, up_m2 = np.array([60.0]), np.array([1.0])
    on, over = (
        hidden_of([leaning(1.0)], root_m, SEEN_ENU_M, up_m2, FlatGround(up_m, 3.0, slope=0.0)) for up_m in (40.0, -10.0)
    )
    assert on.shift_enu_m[0, 2] > -5.0 and over.shift_enu_m[0, 2] < -45.0
    assert over.up_sigma_m[0] < 4.0


def test_without_a_root_nothing_is_hidden() -> None:
    found = hidden_of([Lean()], np.zeros(1), SEEN_ENU_M, np.ones(1), FlatGround(0.0, 30.0, slope=0.0))
    assert not found.shift_enu_m.any() and not found.covariance_m2.any() and not found.up_sigma_m.any()
