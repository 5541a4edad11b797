"""Spots where segments stay at a pixel while the camera shakes: dirt, and what only looks like it."""

from dataclasses import replace

import numpy as np
import pytest

from distloc.geometry.rotations import matrix_from_rotation_vector
from distloc.localizer import Localizer, LocalizerConfig
from distloc.sights.detections import detections_from_mask
from distloc.simulation.targets import Box
from distloc.tracks.looks.dirt import MOST_SPOTS, Dirt
from distloc.types import CameraPose, Detection, FloatArray, TargetState
from tests.support.cube_samples import CAMERA, R_NORTH, empty_mask

WHITE_RAD = float(np.radians(0.1))
FIRE = Box(np.array([0.0, 2000.0, 60.0]), (60.0, 60.0, 120.0))
SPOT_PX = np.array([1250.0, 620.0])


def segment(centre_px: FloatArray, size_px: float = 40.0, **changed: bool) -> Detection:
    return Detection(centre_px, centre_px, np.eye(2) * 100.0, 900.0, size_px, size_px, 1.0, **changed)


def shaking(k: int, rng: np.random.Generator, sigma_rad: float = 0.02) -> CameraPose:
    """A craft that flies east and sways, its camera with it."""
    turn = matrix_from_rotation_vector(rng.normal(0.0, sigma_rad, 3))
    return CameraPose(float(k), np.array([10.0 * k - 600.0, 0.0, 100.0]), turn @ R_NORTH, heading_rad=np.pi / 2.0)


def seen_of(place_enu_m: FloatArray, pose: CameraPose) -> FloatArray:
    return np.asarray(CAMERA.project((pose.R_cam_from_enu @ (place_enu_m - pose.position_enu_m))[:, None])[0][:, 0])


def test_what_stays_at_its_pixel_while_the_camera_shakes_goes_to_no_track_from_then_on() -> None:
    dirt, rng, fire = Dirt(CAMERA, 1.0), np.random.default_rng(0), np.array([0.0, 2000.0, 60.0])
    kept = []
    for k in range(80):
        pose = shaking(k, rng)
        spot = [] if k % 5 == 0 else [segment(SPOT_PX + rng.normal(0.0, 0.5, 2))]
        others = dirt.split(pose, [segment(seen_of(fire, pose)), *spot], WHITE_RAD)
        assert len(others) + len(dirt.seen) == 1 + len(spot)
        kept.append(len(others) - 1)
    assert sum(kept[:20]) == 16 and sum(kept[60:]) == 0
    pixels, sizes_px = np.tile(SPOT_PX, (10, 1)), np.full((10, 2), 40.0)
    assert dirt.is_all_of(pixels, sizes_px) and not dirt.is_all_of(pixels + 40.0, sizes_px)
    assert not dirt.is_all_of(pixels, 3.0 * sizes_px)  # a gimbal holds a fire where the speck is
    pixels[:5] += 60.0
    assert not dirt.is_all_of(pixels, sizes_px) and not dirt.is_all_of(np.zeros((0, 2)), np.zeros((0, 2)))
    # after a long while without it, and of another size not at all
    for k in range(80, 200):
        dirt.split(shaking(k, rng), [], WHITE_RAD)
    assert dirt.split(shaking(200, rng), [segment(SPOT_PX)], WHITE_RAD) == []
    assert len(dirt.split(shaking(201, rng), [segment(SPOT_PX, 90.0)], WHITE_RAD)) == 1


@pytest.mark.parametrize("kind", ["point", "border", "calm", "gimbal", "jumps"])
def test_what_only_looks_like_dirt_is_kept(kind: str) -> None:
    """A tower's bearings, what the border clips, a camera that does not shake, one that a gimbal holds on a fire, one
    whose reported heading is noisier than told and jumps now and then.
    """
    dirt, rng, fire = Dirt(CAMERA, 1.0), np.random.default_rng(1), np.array([0.0, 2000.0, 60.0])
    for k in range(120):
        pose = shaking(k, rng, {"calm": 0.0, "gimbal": 0.0, "jumps": 1.6 * WHITE_RAD}.get(kind, 0.02))
        if kind == "jumps" and k // 40 % 2:
            turn = matrix_from_rotation_vector(np.array([0.0, 0.0, np.radians(8.0)]))
            pose = CameraPose(pose.stamp_s, pose.position_enu_m, pose.R_cam_from_enu @ turn)
        if kind == "gimbal":
            azimuth_rad = np.arctan2(-pose.position_enu_m[0], 2000.0) + rng.normal(0.0, 0.01)
            turn = matrix_from_rotation_vector(np.array([0.0, 0.0, azimuth_rad]))
            pose = CameraPose(pose.stamp_s, pose.position_enu_m, R_NORTH @ turn)
        changed = {"point": {"is_point": True}, "border": {"touches_border": True}}.get(kind, {})
        pixel = seen_of(fire, pose) if kind == "gimbal" else SPOT_PX
        assert len(dirt.split(pose, [segment(pixel, **changed)], WHITE_RAD)) == 1


def test_a_flood_of_segments_has_no_more_spots_than_there_are() -> None:
    dirt, rng = Dirt(CAMERA, 1.0), np.random.default_rng(2)
    for k in range(50):
        flood = [segment(rng.uniform([20.0, 20.0], [1900.0, 1060.0])) for _ in range(2 * MOST_SPOTS)]
        assert len(dirt.split(shaking(k, rng), [*flood, flood[0]], WHITE_RAD)) + len(dirt.seen) == 2 * MOST_SPOTS + 1


def test_a_fire_goes_by_behind_dirt_and_is_confirmed_and_of_the_dirt_nothing_is_left() -> None:
    rng = np.random.default_rng(3)
    located = Localizer(CAMERA, LocalizerConfig(n_particles=2000), rng=np.random.default_rng(0))
    for k in range(110):
        pose, mask = shaking(k, rng), empty_mask()
        FIRE.draw(mask, CAMERA, pose)
        if k % 5:
            mask[560:600, 940:980] = 255  # where the fire is half-way
        told = located.step_detections(pose, detections_from_mask(mask, CAMERA))
        if k > 80:
            assert len(located.explain().tracks) <= 1, k
    (one,) = told
    assert one.state is TargetState.CONFIRMED and one.id == 1
    assert np.linalg.norm(one.position_enu_m[:2] - [0.0, 2000.0]) < 150.0


def test_dirt_on_another_platform_s_lens_takes_no_fire() -> None:
    """One camera's gimbal holds the fire in its picture where another's lens, that looks elsewhere, has a spot."""
    rng, confirmed = np.random.default_rng(4), 0
    located = Localizer(CAMERA, LocalizerConfig(n_particles=2000, platforms=2), rng=np.random.default_rng(0))
    for k in range(90):
        away = shaking(k, rng)
        away = replace(away, position_enu_m=away.position_enu_m - [0.0, 9000.0, 0.0], platform="away")
        located.step_detections(away, [segment(SPOT_PX + rng.normal(0.0, 0.3, 2))])
        position_enu_m = np.array([10.0 * k - 450.0, 0.0, 100.0])
        azimuth_rad = np.arctan2(-position_enu_m[0], 2000.0)
        held = matrix_from_rotation_vector(np.array([0.0, 0.0, azimuth_rad]) + rng.normal(0.0, 0.002, 3))
        pose = CameraPose(k + 0.5, position_enu_m, R_NORTH @ held, heading_rad=np.pi / 2.0, platform="near")
        told = located.step_detections(pose, [segment(SPOT_PX + rng.normal(0.0, 1.0, 2))])
        confirmed += k >= 50 and any(one.state is TargetState.CONFIRMED for one in told)
    assert confirmed >= 30
