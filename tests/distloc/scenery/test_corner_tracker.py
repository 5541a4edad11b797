"""Corners in drawn pictures: where the true poses put them, and never where they must not be."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from distloc.geometry.camera import Camera
from distloc.geometry.rotations import R_cam_from_enu, matrix_from_euler
from distloc.scenery.corner_tracker import CornerTracker
from distloc.scenery.own_parts import own_mask
from distloc.scenery.patches import Patches
from distloc.simulation.landscape.renderer import LandscapeRenderer
from distloc.simulation.landscape.scenes import SCENES
from distloc.simulation.landscape.sensor import CameraFaults
from distloc.simulation.paths import straight
from distloc.types import CameraPose, FloatArray

Image = NDArray[np.uint8]
CAMERA = Camera(640, 360, 450.0, 450.0, 319.5, 179.5)
MOUNT = matrix_from_euler(float(np.radians(-80.0)), float(np.radians(-8.0)), 0.0)
FLIGHT = straight(np.array([0.0, 0.0, 120.0]), 0.0, 20.0, wobble_rad=0.01)
FRAMES = 24


def pose_at(stamp_s: float) -> CameraPose:
    truth = FLIGHT.state(stamp_s)
    R = R_cam_from_enu(matrix_from_euler(truth.yaw_rad, truth.pitch_rad, truth.roll_rad), MOUNT)
    return CameraPose(stamp_s, truth.position_enu_m, R)


@pytest.fixture(scope="module")
def film() -> list[tuple[CameraPose, Image]]:
    scene = replace(SCENES["hills"], cars_km=0.0)
    renderer = LandscapeRenderer(CAMERA, [], np.random.default_rng(4), scene, CameraFaults())
    poses = [pose_at(0.25 * number) for number in range(FRAMES)]
    return [(pose, renderer.render(pose)[0]) for pose in poses]


def followed(film: list[tuple[CameraPose, Image]], tracker: CornerTracker) -> dict[int, list[tuple[int, FloatArray]]]:
    tracks: dict[int, list[tuple[int, FloatArray]]] = {}
    for number, (pose, image) in enumerate(film):
        corners = tracker.track(image, pose)
        assert len(set(corners.names)) == corners.names.size and (corners.sigma_px > 0.0).all()
        for name, pixel in zip(corners.names, corners.pixels.T, strict=True):
            tracks.setdefault(int(name), []).append((number, pixel))
    return tracks


def off_px(film: list[tuple[CameraPose, Image]], track: list[tuple[int, FloatArray]]) -> float:
    """Root mean square of what is left of a track when a fixed point is fitted to it, at the true poses."""
    rows, right = [], []
    for number, pixel in track:
        pose = film[number][0]
        ray = pose.R_cam_from_enu.T @ CAMERA.rays(pixel[:, None])[:, 0]
        across = np.linalg.svd(ray[None])[2][1:]
        rows.append(across)
        right.append(across @ pose.position_enu_m)
    point = np.linalg.lstsq(np.concatenate(rows), np.concatenate(right), rcond=None)[0]
    off = []
    for number, pixel in track:
        pose = film[number][0]
        seen, _ = CAMERA.project((pose.R_cam_from_enu @ (point - pose.position_enu_m))[:, None])
        off.append(seen[:, 0] - pixel)
    return float(np.sqrt(np.square(off).mean()))


def test_corners_stay_on_their_places(film: list[tuple[CameraPose, Image]]) -> None:
    tracks = [track for track in followed(film, CornerTracker(CAMERA)).values() if len(track) >= 8]
    assert len(tracks) >= 30
    left_px = np.array([off_px(film, track) for track in tracks])
    assert np.median(left_px) < 0.2
    assert (left_px > 1.0).mean() < 0.1  # tree tops before a moving background: the window finds them out


def test_none_in_the_smoke_the_sky_or_on_the_crafts_own_parts(film: list[tuple[CameraPose, Image]]) -> None:
    smoke = np.zeros((180, 320), np.uint8)
    smoke[100:150, 60:160] = 255
    own = np.zeros((360, 640), np.bool_)
    own[:, 500:] = True
    tracker = CornerTracker(CAMERA, own=own)
    for pose, image in film:
        corners = tracker.track(image, pose, smoke)
        u, v = corners.pixels
        assert corners.names.size > 10
        assert not ((u > 110) & (u < 330) & (v > 190) & (v < 310)).any()
        assert (u < 500).all()
        up = pose.R_cam_from_enu[:, 2] @ CAMERA.rays(corners.pixels)
        assert (up < 0.03).all()  # a corner may rise a little before it is given up


def test_those_in_smoke_that_is_found_later_are_left_out_and_given_up(film: list[tuple[CameraPose, Image]]) -> None:
    tracker = CornerTracker(CAMERA)
    frames = [tracker.track(image, pose) for pose, image in film[:3]]
    smoke = np.zeros((180, 320), np.uint8)
    smoke[100:150, 60:160] = 255
    u, v = frames[1].pixels
    is_in = (u > 110) & (u < 330) & (v > 190) & (v < 310)
    assert is_in.sum() >= 3
    left = tracker.outside(frames[1], smoke)
    gone = np.setdiff1d(frames[1].names, left.names)
    assert set(frames[1].names[is_in].tolist()) <= set(gone.tolist()) and left.names.size > 10
    np.testing.assert_array_equal(left.pixels, frames[1].pixels[:, np.isin(frames[1].names, left.names)])
    assert np.isin(gone, frames[2].names).any()
    assert not np.isin(gone, tracker.track(film[3][1], film[3][0]).names).any()
    assert tracker.outside(frames[2], np.zeros_like(smoke)) is frames[2]


def test_who_is_in_a_hurry_has_the_new_ones_with_the_next_frame(film: list[tuple[CameraPose, Image]]) -> None:
    at_once, later = CornerTracker(CAMERA), CornerTracker(CAMERA)
    put_off = 0
    for pose, image in film:
        both, old = at_once.track(image, pose), later.follow(image, pose)
        all_of_them = later.look()
        new = np.setdiff1d(all_of_them.names, old.names)
        put_off += new.size
        assert old.names.size >= 24  # at least half: at the start it looks at once
        np.testing.assert_array_equal(all_of_them.pixels, both.pixels)
        np.testing.assert_array_equal(later.look().sigma_px, both.sigma_px)
    assert put_off > 0


def test_own_parts_are_drawn_at_the_trackers_size() -> None:
    camera = Camera(3840, 2160, 2700.0, 2700.0, 1919.5, 1079.5)
    mask = own_mask(camera, [((0.0, 0.0), (1919.0, 0.0), (1919.0, 2159.0), (0.0, 2159.0))])
    assert mask is not None and mask.shape == (720, 1280)
    assert mask[:, :639].all() and not mask[:, 641:].any()
    assert own_mask(camera, []) is None


def test_the_crafts_own_parts_are_learnt(film: list[tuple[CameraPose, Image]]) -> None:
    leg = np.random.default_rng(5).integers(0, 255, (90, 60, 3), dtype=np.uint8)
    leg = np.asarray(cv2.resize(leg[::6, ::6], (60, 90), interpolation=cv2.INTER_NEAREST), dtype=np.uint8)
    tracker = CornerTracker(CAMERA)
    started, followed_on = [], []
    before: set[int] = set()
    for pose, image in [*film, *film[::-1]]:
        picture = image.copy()
        picture[250:340, 40:100] = leg
        corners = tracker.track(picture, replace(pose, stamp_s=0.0))
        u, v = corners.pixels
        on_leg = set(corners.names[(u > 45) & (u < 95) & (v > 255) & (v < 335)].tolist())
        started.append(len(on_leg - before))
        followed_on.append(len(on_leg & before))
        before = on_leg
    assert sum(started[:12]) >= 5
    assert sum(followed_on) <= 2  # each is given up as soon as it ought to have moved
    assert sum(started[-12:]) < sum(started[:12])


def test_it_begins_anew_after_forget_and_takes_other_pictures(film: list[tuple[CameraPose, Image]]) -> None:
    tracker = CornerTracker(CAMERA)
    first = tracker.track(film[0][1], film[0][0])
    second = tracker.track(film[1][1], film[1][0])
    assert np.isin(second.names, first.names).sum() > 20
    tracker.forget()
    assert not np.isin(tracker.track(film[2][1], film[2][0]).names, second.names).any()
    grey = np.asarray(cv2.cvtColor(film[3][1], cv2.COLOR_BGR2GRAY), dtype=np.uint8)
    assert tracker.track(grey, film[3][0]).names.size > 20
    for picture in (np.zeros_like(film[0][1]), np.full_like(film[0][1], 255)):
        assert tracker.track(picture, film[4][0]).names.size == 0


def test_a_patch_is_found_under_another_scale_and_turn() -> None:
    rng = np.random.default_rng(6)
    wide = cv2.GaussianBlur(rng.integers(0, 255, (200, 200)).astype(np.float32), (0, 0), 2.0)
    grey = np.clip((wide - wide.mean()) * 6.0 + 128.0, 0, 255).astype(np.uint8)
    warp = cv2.getRotationMatrix2D((100.0, 100.0), 8.0, 1.15)
    other = np.asarray(cv2.warpAffine(grey, warp, (200, 200), flags=cv2.INTER_LINEAR) // 2 + 30, dtype=np.uint8)
    pixels = np.array([[80.0, 120.0, 100.0], [90.0, 110.0, 75.0]])
    true_px = warp[:, :2] @ pixels + warp[:, 2:]
    patches, slots = Patches(3), np.arange(3)
    patches.take(slots, grey, pixels)
    assert patches.is_good.all()
    found_px, correlation = patches.find(slots, other, true_px + np.array([[1.0, -1.0, 0.5], [-0.5, 1.0, 1.0]]))
    assert np.abs(found_px - true_px).max() < 0.1
    assert correlation.min() > 0.95
    np.testing.assert_allclose(patches.warp[0], warp[:, :2], atol=0.05)
