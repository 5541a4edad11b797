"""Landmarks are found where the true poses put them, at any range, and nothing else is taken for one."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from distloc.geometry.camera import Camera
from distloc.geometry.rotations import R_cam_from_enu, matrix_from_euler, matrix_from_rotation_vector
from distloc.scenery.landmark_finder import LandmarkFinder
from distloc.simulation.landscape.renderer import LandscapeRenderer
from distloc.simulation.landscape.scenes import SCENES
from distloc.simulation.landscape.texture import of_lists
from distloc.simulation.landscape.things import Boxes
from distloc.simulation.paths import straight
from distloc.types import CameraPose, FloatArray
from tests.support.ground_pictures import GroundPictures, board, flown, put_board

CAMERA = Camera(480, 270, 400.0, 400.0, 239.5, 134.5)
PICTURES = GroundPictures(CAMERA)
PLACE, SIDE_M = np.array([190.0, 240.0, 8.0]), 18.0
TEMPLATE = np.asarray(cv2.resize(board(), (29, 29), interpolation=cv2.INTER_AREA), dtype=np.uint8)
TIMES = np.arange(0.0, 16.0, 0.5)
SIGMA_RAD = float(np.radians(1.5))


def picture(t_s: float, *boards: tuple[FloatArray, int]) -> NDArray[np.uint8]:
    image = PICTURES.at(flown(t_s))
    for place, seed in boards:
        put_board(image, CAMERA, flown(t_s), place, SIDE_M, seed)
    return image


def off_px(finder: LandmarkFinder, t_s: float, image: NDArray[np.uint8], told: CameraPose) -> float | None:
    """How far the first landmark was found from where it is; None where it was not."""
    found = finder.find(image, told, PLACE[None], SIGMA_RAD)
    if found.names.size == 0:
        return None
    true_px, _ = CAMERA.project(flown(t_s).R_cam_from_enu @ (PLACE - flown(t_s).position_enu_m)[:, None])
    assert (found.names == 0).all() and (found.places_enu_m == PLACE).all()
    return float(np.linalg.norm(found.pixels - true_px))


@pytest.mark.parametrize("error_deg", [0.0, 3.0, -3.0])
def test_it_is_found_and_followed_as_it_comes_nearer(error_deg: float) -> None:
    finder = LandmarkFinder(CAMERA, [TEMPLATE])
    off = [off_px(finder, t_s, picture(t_s, (PLACE, 0)), flown(t_s, error_deg)) for t_s in TIMES]
    found = [one for one in off if one is not None]
    assert len(found) > 0.8 * TIMES.size
    assert max(found) < 0.7  # the sigma that is told


def test_what_looks_otherwise_and_what_is_there_twice_are_not_taken() -> None:
    other, twice = LandmarkFinder(CAMERA, [TEMPLATE]), LandmarkFinder(CAMERA, [TEMPLATE])
    beside = PLACE + np.array([6.0, -22.0, 0.0])
    for t_s in TIMES:
        assert off_px(other, t_s, picture(t_s, (PLACE, 1)), flown(t_s)) is None
    for t_s in TIMES[:12]:  # then the other one is beyond what the pose leaves open
        assert off_px(twice, t_s, picture(t_s, (PLACE, 0), (beside, 0)), flown(t_s)) is None


def test_it_is_lost_where_it_is_hidden_and_found_again() -> None:
    finder = LandmarkFinder(CAMERA, [TEMPLATE])
    seen = [off_px(finder, t_s, picture(t_s, *([] if 4.0 <= t_s < 6.0 else [(PLACE, 0)])), flown(t_s)) for t_s in TIMES]
    is_found = np.array([one is not None for one in seen])
    assert is_found[:8].all() and not is_found[8:12].any() and is_found[13:].all()


def test_none_is_in_the_smoke() -> None:
    finder = LandmarkFinder(CAMERA, [TEMPLATE])
    (u,), (v,) = CAMERA.project(flown(0.0).R_cam_from_enu @ (PLACE - flown(0.0).position_enu_m)[:, None])[0]
    smoke = np.zeros((135, 240), np.uint8)
    cv2.circle(smoke, (round(u / 2), round(v / 2)), 8, 255, -1)
    image = picture(0.0, (PLACE, 0))
    assert finder.find(image, flown(0.0), PLACE[None], SIGMA_RAD, smoke).names.size == 0
    assert finder.find(image, replace(flown(0.0), stamp_s=1.0), PLACE[None], SIGMA_RAD).names.size == 1


@pytest.mark.parametrize("is_forgotten", [True, False])
def test_one_false_match_of_another_size_does_not_lose_it(is_forgotten: bool) -> None:
    finder, seen = LandmarkFinder(CAMERA, [TEMPLATE]), []
    for t_s in TIMES:
        image = PICTURES.at(flown(t_s))
        if t_s < 1.0 or t_s >= 2.0:
            put_board(image, CAMERA, flown(t_s), PLACE, SIDE_M / 1.9 if t_s < 1.0 else SIDE_M)
        if t_s == 2.0 and is_forgotten:
            finder.forget()
        seen.append(off_px(finder, t_s, image, flown(t_s)) is not None)
    assert seen[:2] == [True, True] and not any(seen[2:4])
    assert all(seen[4 if is_forgotten else 8 :])


def test_one_that_is_doubted_is_searched_for_while_another_is_followed() -> None:
    """The look-alike stands beside it, of half the size: followed on, until the landmark itself is there."""
    for is_doubted in (False, True):
        finder, off = LandmarkFinder(CAMERA, [TEMPLATE]), []
        for t_s in TIMES[:16]:
            image = PICTURES.at(flown(t_s))
            put_board(image, CAMERA, flown(t_s), PLACE + np.array([0.0, -16.0, 0.0]), SIDE_M / 1.9)
            if t_s >= 4.0:
                put_board(image, CAMERA, flown(t_s), PLACE, SIDE_M)
            finder.doubt(np.array([is_doubted]))
            off.append(off_px(finder, t_s, image, flown(t_s)))
        assert all(one is not None and one > 5.0 for one in off[:8])  # followed on, to be told of
        assert all((one is not None and one < 0.7) is is_doubted for one in off[8:])


def test_those_in_smoke_that_is_known_later_are_given_up() -> None:
    finder = LandmarkFinder(CAMERA, [TEMPLATE] * 2)
    places, image = np.stack([PLACE, PLACE]), picture(0.0, (PLACE, 0))
    for stamp_s in (0.0, 1.0):
        found = finder.find(image, replace(flown(0.0), stamp_s=stamp_s), places, SIGMA_RAD)
    apart = replace(found, pixels=np.column_stack([found.pixels[:, 0], found.pixels[:, 1] + [0.0, 60.0]]))
    smoke = np.zeros((135, 240), np.uint8)
    assert finder.outside(apart, smoke) is apart and finder.outside(apart, smoke[:0]) is apart
    u, v = (found.pixels[:, 0] / 2.0).round().astype(int)
    cv2.circle(smoke, (int(u), int(v)), 8, 255, -1)
    free = finder.outside(apart, smoke)
    assert free.names.tolist() == [1] and free.sigma_px.size == len(free.places_enu_m) == 1
    np.testing.assert_array_equal(free.pixels, apart.pixels[:, 1:])
    # at once, before it is time to search again: the other one alone is followed
    assert finder.find(image, replace(flown(0.0), stamp_s=1.1), places, SIGMA_RAD).names.tolist() == [1]


def test_it_is_searched_for_where_the_pose_says_only() -> None:
    image, line_m = picture(0.0, (PLACE, 0)), PLACE - flown(0.0).position_enu_m
    for turned_deg, expects in ((3.0, 1), (12.0, 0), (180.0, 0)):
        finder = LandmarkFinder(CAMERA, [TEMPLATE])
        turned = matrix_from_rotation_vector(np.radians([0.0, 0.0, turned_deg]))
        place = flown(0.0).position_enu_m + turned @ line_m
        assert finder.find(image, flown(0.0), place[None], SIGMA_RAD).names.size == expects


def test_a_picture_of_half_the_size_is_half_as_exact_and_many_are_searched_in_turns() -> None:
    finder = LandmarkFinder(CAMERA, [TEMPLATE] * 16)
    places = np.tile(PLACE, (16, 1))
    small = np.asarray(cv2.resize(picture(0.0, (PLACE, 0)), (240, 135), interpolation=cv2.INTER_AREA), np.uint8)
    names: set[int] = set()
    for number in range(16):
        found = finder.find(small, replace(flown(0.0), stamp_s=float(number)), places, SIGMA_RAD)
        assert found.names.size == number + 1
        assert found.sigma_px == pytest.approx(np.full(number + 1, 1.4))
        names |= set(found.names.tolist())
    assert names == set(range(16))


def test_a_tower_in_the_landscape_is_found_by_a_piece_of_another_frame() -> None:
    """From 720 m, over 11 degrees of bearing: where its top stands, whichever side of it is seen."""
    camera = Camera(640, 360, 450.0, 450.0, 319.5, 179.5)
    renderer = LandscapeRenderer(camera, [], np.random.default_rng(4), replace(SCENES["hills"], cars_km=0.0))
    place = np.array([[-700.0], [0.0]])
    foot = np.vstack([place, of_lists(renderer.terrain.height_m, *place)])
    grey, red = np.array([[170.0], [170.0], [170.0]]), np.array([[60.0], [60.0], [190.0]])
    renderer.houses = Boxes(foot, np.array([[7.0], [7.0], [22.0]]), np.array([0.3]), grey, red, True)
    mount = matrix_from_euler(float(np.radians(-80.0)), float(np.radians(-8.0)), 0.0)
    flight = straight(np.array([0.0, 0.0, 120.0]), 0.0, 20.0, wobble_rad=0.01)

    def pose_at(t_s: float) -> CameraPose:
        truth = flight.state(t_s)
        R = R_cam_from_enu(matrix_from_euler(truth.yaw_rad, truth.pitch_rad, truth.roll_rad), mount)
        return CameraPose(t_s, truth.position_enu_m, R)

    top = foot[:, 0] + [0.0, 0.0, 22.0]

    def pixel_of(t_s: float) -> FloatArray:
        return camera.project(pose_at(t_s).R_cam_from_enu @ (top - pose_at(t_s).position_enu_m)[:, None])[0][:, 0]

    u, v = pixel_of(3.0).round().astype(int)
    image = renderer.render(pose_at(3.0))[0][v - 12 : v + 13, u - 12 : u + 13]
    finder = LandmarkFinder(camera, [np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), np.uint8)])
    off = []
    for t_s in np.arange(0.0, 7.0, 0.5):
        found = finder.find(renderer.render(pose_at(t_s))[0], pose_at(t_s), top[None], SIGMA_RAD)
        off += [found.pixels[:, 0] - pixel_of(t_s)] if found.names.size else []
    assert len(off) == 14 and np.abs(off).max() < 0.7
