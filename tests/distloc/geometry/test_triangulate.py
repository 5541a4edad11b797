"""Triangulation against exact points, OpenCV, the rays' midpoint, and statistics of noise and clutter."""

import cv2
import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from distloc.geometry.camera import Camera
from distloc.geometry.rotations import matrix_from_rotation_vector
from distloc.geometry.triangulate import _least_by_chance, triangulate_dlt, triangulate_ransac
from distloc.simulation.flights import Flight, Geometry, flight_past
from distloc.types import BoolArray, CameraPose, FloatArray, RejectReason
from tests.support.cube_samples import CAMERA, CUBE_ENU_M, R_NORTH, pose_at

BROWN = Camera(1920, 1080, 1200.0, 1190.0, 955.0, 545.0, (-0.12, 0.03, 0.001, -0.0005, 0.0))
FISHEYE = Camera(1920, 1080, 900.0, 900.0, 955.0, 545.0, (0.02, -0.005, 0.001, 0.0), "fisheye")
CAMERAS = pytest.mark.parametrize("camera", [CAMERA, BROWN, FISHEYE], ids=["pinhole", "brown-conrady", "fisheye"])
GATES = pytest.mark.parametrize("gate_px", [None, 2.0])
VECTOR = st.tuples(*[st.floats(-1.0, 1.0)] * 3).map(np.array)


def poses_of(flight: Flight) -> list[CameraPose]:
    return [flight.pose_at(float(stamp_s)) for stamp_s in flight.stamps_s]


def pixels_of(camera: Camera, poses: list[CameraPose], point_enu_m: FloatArray) -> FloatArray:
    points_cam_m = np.stack([pose.R_cam_from_enu @ (point_enu_m - pose.position_enu_m) for pose in poses], axis=1)
    assert (points_cam_m[2] > 0.0).all()
    return camera.project(points_cam_m)[0]


def moved(poses: list[CameraPose], turn: FloatArray, shift_m: FloatArray) -> list[CameraPose]:
    return [CameraPose(p.stamp_s, turn @ p.position_enu_m + shift_m, p.R_cam_from_enu @ turn.T) for p in poses]


def clutter(rng: np.random.Generator, n: int) -> FloatArray:
    return np.vstack([rng.uniform(-0.5, CAMERA.width - 0.5, n), rng.uniform(-0.5, CAMERA.height - 0.5, n)])


def rms(errors: list[float] | FloatArray) -> float:
    return float(np.sqrt(np.mean(np.square(errors))))


PASS = poses_of(flight_past("perpendicular", CUBE_ENU_M, 2000.0, 1000.0, 25.0))
PASS_PX = pixels_of(CAMERA, PASS, CUBE_ENU_M)


def mixed(seed: int, share: float, sigma_px: float) -> tuple[FloatArray, BoolArray, np.random.Generator]:
    rng = np.random.default_rng(seed)
    is_clutter = np.zeros(len(PASS), dtype=np.bool_)
    is_clutter[rng.permutation(len(PASS))[: int(share * len(PASS))]] = True
    pixels = np.where(is_clutter, clutter(rng, len(PASS)), PASS_PX + sigma_px * rng.standard_normal(PASS_PX.shape))
    return pixels, ~is_clutter, rng


@CAMERAS
@pytest.mark.parametrize("offset_m", [0.0, 1e6])
@pytest.mark.parametrize("geometry", ["perpendicular", "orbit"])
def test_exact_pixels_give_the_point(geometry: Geometry, offset_m: float, camera: Camera) -> None:
    flight = flight_past(geometry, CUBE_ENU_M, 2000.0, 1000.0, 50.0, height_m=100.0)
    poses = poses_of(flight)
    pixels = pixels_of(camera, poses, CUBE_ENU_M)
    shift_m = offset_m * np.array([1.0, -1.0, 0.5])
    found = triangulate_dlt(camera, moved(poses, np.eye(3), shift_m), pixels)
    assert not isinstance(found, RejectReason)
    assert np.linalg.norm(found - shift_m - CUBE_ENU_M) < 1e-3
    robust, inliers = triangulate_ransac(camera, moved(poses, np.eye(3), shift_m), pixels, rng=np.random.default_rng(0))
    assert inliers.all()
    assert np.linalg.norm(robust - shift_m - CUBE_ENU_M) < 1e-3


@settings(max_examples=100, deadline=None)
@given(
    st.floats(100.0, 5000.0),
    st.tuples(st.floats(0.0, 1919.0), st.floats(0.0, 1079.0)),
    st.tuples(st.floats(20.0, 90.0), st.floats(-90.0, 90.0), st.floats(-20.0, 20.0)),
    st.integers(2, 9),
    VECTOR,
    VECTOR,
)
def test_a_point_before_a_baseline_moves_with_the_world(
    range_m: float,
    pixel: tuple[float, float],
    baseline_m: tuple[float, float, float],
    n: int,
    rotation: FloatArray,
    shift: FloatArray,
) -> None:
    point_enu_m = R_NORTH.T @ CAMERA.rays(np.array(pixel)[:, None])[:, 0] * range_m
    across_m = R_NORTH.T @ np.array(baseline_m)
    across_m -= point_enu_m * (across_m @ point_enu_m) / range_m**2 * 0.9  # parallax whatever the direction
    poses = [CameraPose(float(i), share * across_m, R_NORTH) for i, share in enumerate(np.linspace(-0.5, 0.5, n))]
    assume(min((R_NORTH @ (point_enu_m - p.position_enu_m))[2] for p in poses) > 10.0)
    pixels = pixels_of(CAMERA, poses, point_enu_m)
    turn, shift_m = matrix_from_rotation_vector(3.0 * rotation), 1e4 * shift
    found = triangulate_dlt(CAMERA, poses, pixels)
    there = triangulate_dlt(CAMERA, moved(poses, turn, shift_m), pixels)
    assert not isinstance(found, RejectReason)
    assert not isinstance(there, RejectReason)
    assert np.linalg.norm(found - point_enu_m) < 1e-3
    assert np.linalg.norm(there - (turn @ point_enu_m + shift_m)) < 1e-3


@pytest.mark.parametrize("n", [0, 1])
def test_one_view_is_no_point(n: int) -> None:
    pixels = PASS_PX[:, :n]
    assert triangulate_dlt(CAMERA, PASS[:n], pixels) is RejectReason.ONE_VIEW
    reason, inliers = triangulate_ransac(CAMERA, PASS[:n], pixels, rng=np.random.default_rng(0))
    assert (reason, inliers.tolist()) == (RejectReason.ONE_VIEW, [False] * n)


@GATES
def test_one_place_is_no_baseline(gate_px: float | None) -> None:
    poses, pixels = [pose_at(0.0)] * 9, np.repeat(PASS_PX[:, :1], 9, axis=1)
    assert triangulate_dlt(CAMERA, poses, pixels) is RejectReason.NO_BASELINE
    reason, inliers = triangulate_ransac(CAMERA, poses, pixels, rng=np.random.default_rng(0), gate_px=gate_px)
    assert reason is RejectReason.NO_BASELINE
    assert not inliers.any()


@pytest.mark.parametrize(("baseline_px", "has_point"), [(0.98, False), (1.02, True)])
def test_half_a_pixel_of_parallax_each_way_is_the_least(baseline_px: float, has_point: bool) -> None:
    poses = [pose_at(500.0 + side * baseline_px * 2000.0 / CAMERA.fx / 2.0) for side in (-1.0, 1.0)]
    target_enu_m = np.array([500.0, 2000.0, 0.0])
    found = triangulate_dlt(CAMERA, poses, pixels_of(CAMERA, poses, target_enu_m))
    if has_point:
        assert np.linalg.norm(found - target_enu_m) < 1e-3
    else:
        assert found is RejectReason.NO_BASELINE


def straight_at_it() -> tuple[list[CameraPose], FloatArray]:
    poses = [CameraPose(float(i), np.array([0.0, 50.0 * i, 0.0]), R_NORTH) for i in range(9)]
    return poses, pixels_of(CAMERA, poses, np.array([0.0, 2000.0, 0.0]))


@GATES
def test_flying_straight_at_it_is_never_a_point(gate_px: float | None) -> None:
    poses, pixels = straight_at_it()
    assert isinstance(triangulate_dlt(CAMERA, poses, pixels), RejectReason)
    for seed in range(40):
        rng = np.random.default_rng(seed)
        noisy = pixels + 0.3 * rng.standard_normal(pixels.shape)
        found, inliers = triangulate_ransac(CAMERA, poses, noisy, rng=rng, gate_px=gate_px)
        assert isinstance(found, RejectReason)
        assert not inliers.any()


def test_flying_straight_at_it_is_no_baseline() -> None:
    assert triangulate_dlt(CAMERA, *straight_at_it()) is RejectReason.NO_BASELINE


def test_a_point_outside_the_field_of_view_is_no_inlier_at_the_centre() -> None:
    camera = Camera(1920, 1080, 1200.0, 1200.0, 959.5, 539.5, (-0.1, 0.01, 0.0, 0.0))
    # two views meet at a point far outside the field of view of the other eight, which see something at their centre
    side_enu_m = np.array([3000.0, 60.0, 0.0])
    R_EAST = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]])
    poses = [CameraPose(float(i), np.array([0.0, 40.0 * i, 0.0]), R_EAST) for i in (0, 1)]
    pixels = pixels_of(camera, poses, side_enu_m)
    poses += [CameraPose(float(i), np.array([20.0 * i, 0.0, 0.0]), R_NORTH) for i in range(2, 10)]
    pixels = np.hstack([pixels, np.tile([[959.5], [539.5]], 8)])
    _, inliers = triangulate_ransac(camera, poses, pixels, rng=np.random.default_rng(0), gate_px=2.0)
    assert inliers.sum() < 10


@GATES
def test_diverging_rays_are_behind_the_camera(gate_px: float | None) -> None:
    pair = [pose_at(0.0), pose_at(100.0)]
    pixels = pixels_of(CAMERA, pair, CUBE_ENU_M)[:, ::-1]
    assert triangulate_dlt(CAMERA, pair, pixels) is RejectReason.BEHIND_CAMERA
    found, inliers = triangulate_ransac(CAMERA, pair, pixels, rng=np.random.default_rng(0), gate_px=gate_px)
    assert found in {RejectReason.BEHIND_CAMERA, RejectReason.ALL_OUTLIERS}
    assert not inliers.any()


@pytest.mark.parametrize("n", [20, 41])
def test_clutter_alone_is_no_point_but_a_third_of_truth_is(n: int) -> None:
    poses = PASS[:: 41 // n][:n]
    numbers = found = 0
    for seed in range(100):
        rng = np.random.default_rng(seed)
        pixels = clutter(rng, n)
        point, inliers = triangulate_ransac(CAMERA, poses, pixels, rng=rng)
        numbers += not isinstance(point, RejectReason)
        assert not isinstance(point, RejectReason) or not inliers.any()
        true = rng.permutation(n)[: int(np.ceil(0.35 * n))]
        pixels[:, true] = PASS_PX[:, :: 41 // n][:, true] + rng.standard_normal((2, true.size))
        point, _ = triangulate_ransac(CAMERA, poses, pixels, rng=rng)
        found += not isinstance(point, RejectReason) and bool(np.linalg.norm(point - CUBE_ENU_M) < 50.0)
    assert numbers <= 5
    assert found >= 95  # a search that finds nothing in anything would pass the line above


@pytest.mark.parametrize(
    ("pixels", "n"),
    [(np.zeros((2, 3)), 4), (np.zeros((3, 4)), 4), (np.zeros(2), 1), (np.full((2, 4), np.nan), 4)],
    ids=["count", "three rows", "one axis", "nan"],
)
def test_impossible_pixels_raise(pixels: FloatArray, n: int) -> None:
    with pytest.raises(ValueError, match="pixels"):
        triangulate_dlt(CAMERA, PASS[:n], pixels)
    with pytest.raises(ValueError, match="pixels"):
        triangulate_ransac(CAMERA, PASS[:n], pixels, rng=np.random.default_rng(0))


@GATES
def test_gross_outliers_are_found_exactly(gate_px: float | None) -> None:
    for seed in range(20):
        pixels, is_true, rng = mixed(seed, 0.3, 0.0)
        point, inliers = triangulate_ransac(CAMERA, PASS, pixels, rng=rng, gate_px=gate_px)
        assert inliers.tolist() == is_true.tolist()
        assert np.linalg.norm(point - CUBE_ENU_M) < 1e-3


@pytest.mark.parametrize(("gate_px", "kept", "worse"), [(None, (0.97, 1.0), 1.2), (2.0, (0.8, 0.95), 1.5)])
def test_half_clutter_costs_little(gate_px: float | None, kept: tuple[float, float], worse: float) -> None:
    errors_m, least_m, shares = [], [], []
    for seed in range(40):
        pixels, is_true, rng = mixed(seed, 0.45, 1.0)
        point, inliers = triangulate_ransac(CAMERA, PASS, pixels, rng=rng, gate_px=gate_px)
        true_poses = [pose for pose, is_kept in zip(PASS, is_true, strict=True) if is_kept]
        errors_m.append(float(np.linalg.norm(point - CUBE_ENU_M)))
        least_m.append(float(np.linalg.norm(triangulate_dlt(CAMERA, true_poses, pixels[:, is_true]) - CUBE_ENU_M)))
        shares.append((inliers & is_true).sum() / is_true.sum())
    assert 0.9 < rms(errors_m) / rms(least_m) < worse
    assert kept[0] < np.mean(shares) <= kept[1]  # of a Rayleigh error of 1 px, 86 % lie under 2 px


@GATES
def test_the_same_seed_gives_the_same_answer(gate_px: float | None) -> None:
    pixels, _, _ = mixed(3, 0.45, 1.0)
    answers = [
        triangulate_ransac(CAMERA, PASS, pixels, rng=np.random.default_rng(7), gate_px=gate_px) for _ in range(2)
    ]
    assert answers[0][0].tolist() == answers[1][0].tolist()
    assert answers[0][1].tolist() == answers[1][1].tolist()


@GATES
def test_a_frame_may_give_several_pixels(gate_px: float | None) -> None:
    rng = np.random.default_rng(0)
    poses = [pose for pose in PASS for _ in range(2)]
    pixels = np.repeat(PASS_PX, 2, axis=1)
    pixels[:, 1::2] = clutter(rng, len(PASS))
    point, inliers = triangulate_ransac(CAMERA, poses, pixels, rng=rng, gate_px=gate_px)
    assert inliers.tolist() == [True, False] * len(PASS)
    assert np.linalg.norm(point - CUBE_ENU_M) < 1e-3


# With moves of 5 cm the noise pulls the point to the cameras: it must not pass for a near one.
@pytest.mark.parametrize(
    ("drift_m", "gate_px", "most"), [(0.0, None, 0), (0.0, 2.0, 0), (0.05, None, 1), (0.05, 2.0, 4)]
)
def test_a_noisy_hover_is_rarely_a_point(drift_m: float, gate_px: float | None, most: int) -> None:
    numbers = 0
    for seed in range(40):
        rng = np.random.default_rng(seed)
        poses = [CameraPose(p.stamp_s, drift_m * rng.standard_normal(3), R_NORTH) for p in PASS]
        pixels = pixels_of(CAMERA, poses, CUBE_ENU_M) + rng.standard_normal((2, len(poses)))
        found, inliers = triangulate_ransac(CAMERA, poses, pixels, rng=rng, gate_px=gate_px)
        numbers += not isinstance(found, RejectReason)
        assert not isinstance(found, RejectReason) or not inliers.any()
    assert numbers <= most


def midpoint_of_rays(camera: Camera, poses: list[CameraPose], pixels: FloatArray) -> FloatArray:
    rays = camera.rays(pixels).T
    directions = [pose.R_cam_from_enu.T @ ray for pose, ray in zip(poses, rays, strict=True)]
    across = [np.eye(3) - np.outer(d, d) for d in directions]
    rows = np.concatenate([P @ pose.position_enu_m for P, pose in zip(across, poses, strict=True)])
    return np.linalg.lstsq(np.concatenate(across), rows, rcond=None)[0]


def by_opencv(poses: list[CameraPose], pixels: FloatArray) -> FloatArray:
    M = [CAMERA.matrix @ np.column_stack([p.R_cam_from_enu, -p.R_cam_from_enu @ p.position_enu_m]) for p in poses]
    x = cv2.triangulatePoints(M[0], M[1], pixels[:, :1].copy(), pixels[:, 1:].copy())[:, 0]
    return x[:3] / x[3]


@pytest.mark.parametrize("peer", ["opencv, two views", "midpoint, 41 views"])
def test_agrees_with_an_independent_method(peer: str) -> None:
    poses, exact = ([PASS[0], PASS[-1]], PASS_PX[:, [0, -1]]) if peer.startswith("opencv") else (PASS, PASS_PX)

    def other(pixels: FloatArray) -> FloatArray:
        return by_opencv(poses, pixels) if len(poses) == 2 else midpoint_of_rays(CAMERA, poses, pixels)

    assert np.linalg.norm(triangulate_dlt(CAMERA, poses, exact) - other(exact)) < 1e-3
    rng = np.random.default_rng(5)
    noisy = [exact + 0.5 * rng.standard_normal(exact.shape) for _ in range(200)]
    ours_m = np.stack([triangulate_dlt(CAMERA, poses, pixels) for pixels in noisy]) - CUBE_ENU_M
    others_m = np.stack([other(pixels) for pixels in noisy]) - CUBE_ENU_M
    assert 0.9 < rms(ours_m) / rms(others_m) < 1.1
    assert 0.0 < rms(ours_m - others_m) < 0.1 * rms(others_m)


def test_pose_like_noise_does_not_pull_towards_the_cameras() -> None:
    poses = poses_of(flight_past("perpendicular", CUBE_ENU_M, 2000.0, 200.0, 10.0))
    exact = pixels_of(CAMERA, poses, CUBE_ENU_M)
    away = (CUBE_ENU_M - poses[10].position_enu_m) / np.linalg.norm(CUBE_ENU_M - poses[10].position_enu_m)
    rng = np.random.default_rng(0)
    found = [triangulate_dlt(CAMERA, poses, exact + 6.0 * rng.standard_normal(exact.shape)) for _ in range(300)]
    errors_m = (np.stack(found) - CUBE_ENU_M) @ away
    # by hand: var = r^4 s^2 / (f^2 sum of squared offsets from the middle), r = 2010 m along the line of sight
    sigma_m = 2000.0 * 2010.0 * 6.0 / (1200.0 * np.sqrt(77_000.0))
    assert 0.85 < errors_m.std() / sigma_m < 1.15
    assert abs(errors_m.mean()) < 0.35 * errors_m.std()


def test_the_set_least_expected_by_chance_by_hand() -> None:
    # n = 5, area 1e6: the three at 2 px or less: (5 - 2) C(5, 3) C(3, 2) alpha^1 = 90 pi 4 / 1e6 = 1.13e-3; with the
    # fourth at 100 px: 3 * 5 * 6 * (pi * 1e4 / 1e6)^2 = 8.9e-2; with the fifth at 400 px: 3 * 1 * 10 * 0.503^3 = 3.8
    errors_px = np.array([[1.0, 400.0, 0.5, 100.0, 1.9]])
    assert _least_by_chance(errors_px, 1e6).tolist() == [True, False, True, False, True]
    # over 1.13e-3 of the same area the three are expected once: a fifth larger is not enough, a fifth smaller is
    assert _least_by_chance(np.array([[1.0, 1.0, 1.0, 1e9, 1e9]]), 90 * np.pi * 4.0 / 1.2).any() == np.False_
    assert _least_by_chance(np.array([[1.0, 1.0, 1.0, 1e9, 1e9]]), 90 * np.pi * 4.0 / 0.8).sum() == 3


@pytest.mark.parametrize("bad", [{"max_samples": 0}, {"gate_px": 0.0}, {"gate_px": float("nan")}])
def test_impossible_settings_raise(bad: dict) -> None:
    with pytest.raises(ValueError, match=next(iter(bad))):
        triangulate_ransac(CAMERA, PASS, PASS_PX, rng=np.random.default_rng(0), **bad)
