"""What lasts in the image but is no smoke on the ground: clouds, birds, dirt on the lens, on real flights' geometry."""

from collections.abc import Callable
from dataclasses import replace

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from distloc.filter.ground import FlatGround, NoGround
from distloc.geometry.rotations import matrix_from_rotation_vector
from distloc.localizer import Localizer, LocalizerConfig
from distloc.sights.detections import detections_from_mask
from distloc.sights.sights import ray_of
from distloc.simulation.flights import Geometry, flight_past
from distloc.simulation.pose_noise import CorrelatedPoseErrors, CorrelatedSigmas
from distloc.simulation.targets import Box
from distloc.tracks.plausibility import are_in_the_sky, are_on_the_lens, are_shaken, feet_of, is_too_small
from distloc.types import CameraPose, Extent, FloatArray, TargetState
from tests.support.cube_samples import CAMERA, R_NORTH

TARGET_ENU_M = np.array([0.0, 2000.0, 150.0])
Mask = NDArray[np.uint8]
Draw = Callable[[CameraPose, float], Mask]


def drawn(place_enu_m: FloatArray, half_m: tuple[float, float], pose: CameraPose) -> Mask:
    """An upright ellipse of a size in metres at a place."""
    mask = np.zeros((CAMERA.height, CAMERA.width), np.uint8)
    place_cam_m = pose.R_cam_from_enu @ (place_enu_m - pose.position_enu_m)
    pixels, inside = CAMERA.project(place_cam_m[:, None])
    if inside[0] and place_cam_m[2] > 10.0:
        axes = [max(3, round(CAMERA.fx * half / place_cam_m[2])) for half in half_m]
        cv2.ellipse(mask, pixels[:, 0].round().astype(int).tolist(), axes, 0, 0, 360, 255, -1)
    return mask


def believed_steps(draw: Draw, geometry: Geometry, seed: int, steps: int = 90) -> tuple[int, int]:
    """In how many steps something was told of, and was confirmed."""
    length_m = {"head-on": 1400.0, "orbit": 3000.0}.get(geometry, 2000.0)
    flight = flight_past(geometry, TARGET_ENU_M, 2000.0, length_m, length_m / steps, 120.0, wobble_rad=0.02, seed=seed)
    errors = CorrelatedPoseErrors(CorrelatedSigmas(), np.random.default_rng([1, seed]))
    located = Localizer(CAMERA, LocalizerConfig(n_particles=5000, step_distance_m=0.0), rng=np.random.default_rng(seed))
    told = confirmed = 0
    for stamp_s in flight.stamps_s:
        mask = draw(flight.pose_at(float(stamp_s)), float(stamp_s))
        states = [one.state for one in located.step(errors.reported(flight.pose_at, float(stamp_s)), mask)]
        told += bool(states)
        confirmed += TargetState.CONFIRMED in states
    return told, confirmed


def smoke(pose: CameraPose, stamp_s: float) -> Mask:
    mask = np.zeros((CAMERA.height, CAMERA.width), np.uint8)
    Box(TARGET_ENU_M, (60.0, 60.0, 120.0)).draw(mask, CAMERA, pose)  # lower it might be dust
    return mask


def cloud(velocity_mps: tuple[float, float], pose: CameraPose, stamp_s: float) -> Mask:
    place = np.array([0.0, 5000.0, 900.0]) + stamp_s * np.array([*velocity_mps, 0.0])
    return drawn(place, (300.0, 80.0), pose)


def on_the_lens(pose: CameraPose, stamp_s: float) -> Mask:
    mask = np.zeros((CAMERA.height, CAMERA.width), np.uint8)
    return np.asarray(cv2.ellipse(mask, (1000, 560), (30, 20), 0, 0, 360, 255, -1))


@pytest.mark.parametrize("geometry", ["perpendicular", "orbit", "lawnmower"])
def test_smoke_on_the_ground_is_believed(geometry: Geometry) -> None:
    told, confirmed = believed_steps(smoke, geometry, 1)
    assert told >= 80 and confirmed >= 70


@pytest.mark.parametrize("geometry", ["perpendicular", "oblique", "orbit", "lawnmower"])
@pytest.mark.parametrize("velocity_mps", [(4.0, 0.0), (-3.0, 5.0)])
def test_a_cloud_that_drifts_is_told_of_but_not_believed(geometry: Geometry, velocity_mps: tuple[float, float]) -> None:
    told, confirmed = believed_steps(lambda pose, stamp_s: cloud(velocity_mps, pose, stamp_s), geometry, 2)
    assert told >= 20 and confirmed <= told / 10


@pytest.mark.parametrize("geometry", ["perpendicular", "orbit", "lawnmower"])
def test_dirt_on_the_lens_is_hardly_believed(geometry: Geometry) -> None:
    told, confirmed = believed_steps(on_the_lens, geometry, 3)
    assert 20 <= told <= 30 and confirmed == 0  # until it is known to be dirt


@pytest.mark.parametrize("velocity_mps", [(-8.0, 3.0), (-5.0, -2.0), (3.0, 6.0)])
def test_a_bird_that_flies_by_is_not_believed(velocity_mps: tuple[float, float]) -> None:
    start = np.array([-900.0, 150.0, 118.0])

    def bird(pose: CameraPose, stamp_s: float) -> Mask:
        return drawn(start + stamp_s * np.array([*velocity_mps, 0.0]), (0.7, 0.4), pose)

    told, confirmed = believed_steps(bird, "perpendicular", 4)
    assert told >= 3 and confirmed <= told / 4


def test_too_small_is_of_both_sides_with_their_doubt() -> None:
    assert is_too_small(Extent(1.5, 0.2, 0.8, 0.1))
    assert not is_too_small(Extent(1.5, 1.5, 0.8, 0.1))  # it may be 4.5 m wide
    assert not is_too_small(Extent(1.0, 0.1, 30.0, 2.0))  # a mast
    assert not is_too_small(Extent(0.0, 0.0, 0.0, 0.0))  # not measured yet


def test_the_foot_is_below_the_target_where_the_segment_ends_now() -> None:
    pose = CameraPose(0.0, np.array([0.0, 0.0, 100.0]), R_NORTH)
    (one,) = detections_from_mask(drawn(np.array([0.0, 500.0, 60.0]), (20.0, 10.0), pose), CAMERA)
    ray = replace(ray_of(CAMERA, pose, one, "centre"), foot_tangent=-0.1)
    # 500 m away over the map, at whatever height the cloud is
    assert np.allclose(feet_of([ray], np.array([[300.0, 400.0, 999.0]])), [300.0, 400.0, 50.0])


def test_in_the_sky_is_over_the_ground_or_else_over_the_camera() -> None:
    over_camera = np.array([0.0, 3000.0, 400.0])
    feet = over_camera + np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 50.0], [0.0, 0.0, 500.0]])
    highest_m = np.full(3, 120.0)
    assert are_in_the_sky(feet, highest_m, NoGround()).tolist() == [False, True, True]
    assert are_in_the_sky(feet, highest_m, FlatGround(0.0, 30.0)).tolist() == [True, True, True]
    assert are_in_the_sky(feet, highest_m, FlatGround(700.0, 30.0)).tolist() == [False] * 3  # on a mountain


def test_on_the_lens_needs_movement_that_is_not_seen() -> None:
    moved = np.stack([np.linspace(0.0, 100.0, 12), np.zeros(12)], axis=1)
    still, unseen = np.full((12, 2), 500.0), np.full((12, 2), np.nan)
    few = np.where(np.arange(12)[:, None] < 5, still, np.nan)
    # of those in the middle: the view hardly moved, nobody can tell; the last two are seen too seldom
    seen = np.array([still, moved, still, few, unseen])
    expected = np.array([moved, moved, 0.1 * moved, moved, moved])
    assert are_on_the_lens(seen, expected, 2.0).tolist() == [True, False, False, False, False]
    assert not are_on_the_lens(seen[:1], np.where(np.arange(12)[:, None] < 5, moved, np.nan)[None], 2.0).any()


def test_what_shakes_with_the_camera_is_on_the_lens_and_what_a_gimbal_holds_is_not() -> None:
    rng = np.random.default_rng(5)
    fire_enu_m = np.array([0.0, 1000.0, 0.0])
    seen, turns = {"dirt": [], "fixed": [], "gimbal": []}, {"dirt": [], "fixed": [], "gimbal": []}
    for k in range(12):
        place = np.array([20.0 * k - 120.0, 0.0, 100.0])
        shaken = matrix_from_rotation_vector(rng.normal(0.0, 0.02, 3)) @ R_NORTH
        held = looking_at(fire_enu_m - place)
        for name, R in (("dirt", shaken), ("fixed", shaken), ("gimbal", held)):
            pixel = CAMERA.project((R @ (fire_enu_m - place))[:, None])[0][:, 0]
            seen[name].append((np.array([900.0, 500.0]) if name == "dirt" else pixel) + rng.normal(0.0, 1.0, 2))
            turns[name].append(R)
    pixels, R_cam_from_enu = (np.array([one[name] for name in seen]) for one in (seen, turns))
    assert are_shaken(pixels, R_cam_from_enu, CAMERA, 1.5).tolist() == [True, False, False]
    few = np.where(np.arange(12)[:, None] < 7, pixels, np.nan)
    assert not are_shaken(few, R_cam_from_enu, CAMERA, 1.5).any()


def looking_at(along_enu: FloatArray) -> FloatArray:
    """The camera's turn (3, 3) with its axis along a vector."""
    forward = along_enu / np.linalg.norm(along_enu)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    return np.stack([right, np.cross(forward, right), forward])
