"""The bound against Monte Carlo of the best estimate, closed forms, and what any bound must do."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from distloc.simulation.flights import Geometry, flight_past, paper_flight
from distloc.study.bound import NoiseModel, error_bound_m, position_bound
from distloc.types import CameraPose, FloatArray
from tests.support.cube_samples import CAMERA, CUBE_ENU_M, R_NORTH, pose_at

TARGET = np.array([300.0, 1000.0, 100.0])
SEEDS = 2000
UP = np.array([0.0, 0.0, 1.0])


def poses_on(geometry: Geometry) -> list[CameraPose]:
    flight = flight_past(geometry, TARGET, 1000.0, 800.0, 40.0, height_m=20.0, wobble_rad=0.02)
    return [flight.pose_at(float(stamp_s)) for stamp_s in flight.stamps_s]


def turned(vectors: FloatArray, rotations_rad: FloatArray) -> FloatArray:
    """Rodrigues' formula on the last axis."""
    angle = np.linalg.norm(rotations_rad, axis=-1, keepdims=True) + 1e-300
    axis = rotations_rad / angle
    along = axis * (axis * vectors).sum(axis=-1, keepdims=True)
    return vectors * np.cos(angle) + np.cross(axis, vectors) * np.sin(angle) + along * (1.0 - np.cos(angle))


def pinhole(cam_m: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Pixels (..., 2) and their derivative (..., 2, 3) by the point in the camera's axes, by hand."""
    x, y, z = np.moveaxis(cam_m, -1, 0)
    zero, f = np.zeros_like(z), CAMERA.fx
    pixels = np.stack([f * x / z + CAMERA.cx, f * y / z + CAMERA.cy], axis=-1)
    by_cam = np.stack([np.stack([f / z, zero, -f * x / z**2], -1), np.stack([zero, f / z, -f * y / z**2], -1)], -2)
    return pixels, by_cam


def best_estimates(poses: list[CameraPose], noise: NoiseModel, seed: int) -> FloatArray:
    """Errors (SEEDS, 3) of Gauss-Newton on the weighted reprojection error, with the heading bias as a fourth state."""
    rng = np.random.default_rng(seed)
    R = np.stack([pose.R_cam_from_enu for pose in poses])
    C = np.stack([pose.position_enu_m for pose in poses])
    n, bias_sigma = len(poses), max(noise.heading_bias_rad, 1e-9)
    # R_enu_from_cam reported = exp(beta) R_enu_from_cam true: seen through R exp(beta) of what is reported
    biases = bias_sigma * rng.standard_normal((SEEDS, 1, 1)) * UP
    cam_m = np.einsum("nij,snj->sni", R, turned(TARGET - C, biases))
    shaken = turned(cam_m, noise.rotation_white_rad * rng.standard_normal((SEEDS, n, 3)))
    seen = pinhole(shaken)[0] + noise.pixel_px * rng.standard_normal((SEEDS, n, 2))
    truth_m = np.einsum("nij,nj->ni", R, TARGET - C)
    by_turn = pinhole(truth_m)[1] @ np.cross(np.eye(3)[None], truth_m[:, None, :]).transpose(0, 2, 1)
    covariance = noise.pixel_px**2 * np.eye(2) + noise.rotation_white_rad**2 * by_turn @ by_turn.transpose(0, 2, 1)
    W = np.linalg.inv(covariance)
    prior = np.diag([0.0, 0.0, 0.0, 1.0 / bias_sigma**2])
    state = np.tile(np.append(TARGET + 5.0, 0.0), (SEEDS, 1))
    for _ in range(8):
        offsets = turned(state[:, None, :3] - C, state[:, None, 3:] * UP)
        expected, by_cam = pinhole(np.einsum("nij,snj->sni", R, offsets))
        by_offset = by_cam @ R
        Z = turned(np.eye(3)[None], state[:, 3, None, None] * UP).transpose(0, 2, 1)  # exp(beta)
        by_bias = by_offset @ np.cross(UP, offsets)[..., None]
        H = np.concatenate([by_offset @ Z[:, None], by_bias], axis=-1)
        HW = np.einsum("snik,nij->snkj", H, W)
        gradient = np.einsum("snkj,snj->sk", HW, seen - expected) - state @ prior
        J = np.einsum("snkj,snjl->skl", HW, H) + prior
        state = state + np.linalg.solve(J, gradient[..., None])[..., 0]
    return state[:, :3] - TARGET


@pytest.mark.parametrize(
    "noise",
    [
        NoiseModel(pixel_px=1.0),
        NoiseModel(pixel_px=0.5, rotation_white_rad=float(np.radians(0.3))),
        NoiseModel(pixel_px=1.0, heading_bias_rad=float(np.radians(1.0)), tau_s=1e12),
    ],
    ids=["pixels", "white rotations", "heading bias"],
)
@pytest.mark.parametrize("geometry", ["perpendicular", "orbit"])
def test_the_best_estimate_attains_the_bound(geometry: Geometry, noise: NoiseModel) -> None:
    poses = poses_on(geometry)
    bound = position_bound(CAMERA, poses, TARGET, noise)[-1]
    errors_m = best_estimates(poses, noise, seed=1)
    rms_m = float(np.sqrt(np.square(errors_m).sum(axis=1).mean()))
    assert 0.93 < rms_m / error_bound_m(bound[None])[0] < 1.08
    values, vectors = np.linalg.eigh(bound)
    ratios = np.square(errors_m @ vectors).mean(axis=0) / values
    assert ((ratios > 0.8) & (ratios < 1.25)).all(), ratios


def covariance_of(poses: list[CameraPose], noise: NoiseModel, point_enu_m: FloatArray = TARGET) -> FloatArray:
    return position_bound(CAMERA, poses, point_enu_m, noise)[-1]


def bound_m(poses: list[CameraPose], noise: NoiseModel) -> float:
    return float(error_bound_m(position_bound(CAMERA, poses, TARGET, noise))[-1])


WHITE = NoiseModel(pixel_px=1.0)
LEVEL = [pose_at(50.0 * i) for i in range(13)]  # 0 to 600 m, TARGET abeam of the middle


@pytest.mark.parametrize(("baseline_m", "pixel_px"), [(20.0, 1.0), (200.0, 0.3), (800.0, 2.0)])
def test_two_views_by_hand(baseline_m: float, pixel_px: float) -> None:
    # u1 - u2 = f b / r, so sigma_r = r^2 s sqrt(2) / (f b); the mean of two pixels gives sigma = r s / (f sqrt(2))
    abeam = np.array([300.0, 1000.0, 0.0])
    pair = [pose_at(300.0 + side * baseline_m / 2.0) for side in (-1.0, 1.0)]
    sigmas_m = np.sqrt(np.diag(covariance_of(pair, NoiseModel(pixel_px=pixel_px), abeam)))
    across_m = 1000.0 * pixel_px / (CAMERA.fx * np.sqrt(2.0))
    range_m = 1000.0**2 * pixel_px * np.sqrt(2.0) / (CAMERA.fx * baseline_m)
    assert sigmas_m == pytest.approx([across_m, range_m, across_m], rel=0.02)


def test_shifts_of_all_frames_add_to_the_covariance_by_hand() -> None:
    # a shift of every camera by the same vector shifts the point by it; at 10 m/s east, 0.3 s are 3 m
    plain = covariance_of(LEVEL, WHITE)
    biased = covariance_of(LEVEL, replace(WHITE, position_bias_m=2.0))
    late = covariance_of(LEVEL, replace(WHITE, time_offset_s=0.3))
    assert biased - plain == pytest.approx(4.0 * np.eye(3), abs=1e-4)
    assert late - plain == pytest.approx(np.diag([9.0, 0.0, 0.0]), abs=1e-4)


@settings(max_examples=25, deadline=None)
@given(
    st.sampled_from(["perpendicular", "oblique", "orbit", "lawnmower"]),
    st.floats(0.1, 5.0),
    st.floats(0.0, 0.02),
    st.floats(0.0, 0.05),
    st.floats(1.0, 1e4),
    st.floats(0.0, 5.0),
)
def test_more_frames_never_hurt(
    geometry: Geometry, pixel_px: float, white_rad: float, bias_rad: float, tau_s: float, shift_m: float
) -> None:
    noise = NoiseModel(
        pixel_px, white_rad, heading_bias_rad=bias_rad, tilt_bias_rad=bias_rad, tau_s=tau_s, position_bias_m=shift_m
    )
    errors_m = error_bound_m(position_bound(CAMERA, poses_on(geometry), TARGET, noise))
    known_m = errors_m[np.isfinite(errors_m)]
    assert known_m.size >= 15
    assert np.isinf(errors_m[: errors_m.size - known_m.size]).all()
    assert (np.diff(known_m) <= 1e-6 * known_m[:-1]).all()


def test_one_frame_and_a_perfect_hover_know_no_range() -> None:
    assert np.isinf(error_bound_m(position_bound(CAMERA, LEVEL[:1], TARGET, WHITE))).all()
    hover = flight_past("hover", TARGET, 1000.0, 500.0, wobble_rad=0.02)
    poses = [hover.pose_at(float(stamp_s)) for stamp_s in hover.stamps_s]
    assert np.isinf(error_bound_m(position_bound(CAMERA, poses, TARGET, WHITE))).all()
    assert np.isfinite(error_bound_m(position_bound(CAMERA, LEVEL, TARGET, WHITE))[1:]).all()


@pytest.mark.parametrize(
    ("name", "low", "high"),
    [
        ("pixel_px", 1.5, 3.0),
        ("rotation_white_rad", 0.002, 0.004),
        ("translation_white_m", 1.0, 2.0),
        ("heading_bias_rad", 0.01, 0.02),
        ("tilt_bias_rad", 0.01, 0.02),
        ("position_bias_m", 2.0, 4.0),
        ("time_offset_s", 0.2, 0.4),
        ("missed", 0.2, 0.4),
    ],
)
def test_grows_with_each_noise(name: str, low: float, high: float) -> None:
    none, little, much = (
        bound_m(LEVEL, n) for n in (WHITE, replace(WHITE, **{name: low}), replace(WHITE, **{name: high}))
    )
    assert 1.02 * none < little < 0.99 * much
    assert much < 30.0 * none


def test_rotations_about_a_far_origin_move_the_camera_as_well() -> None:
    noise = replace(WHITE, rotation_white_rad=0.002)
    shift_m = 5000.0 * np.array([0.0, 1.0, 0.0])
    far = [CameraPose(p.stamp_s, p.position_enu_m + shift_m, p.R_cam_from_enu) for p in LEVEL]

    def ratio(poses: list[CameraPose], point_enu_m: FloatArray) -> float:
        origin = covariance_of(poses, replace(noise, rotation_about="origin"), point_enu_m)
        camera = covariance_of(poses, noise, point_enu_m)
        return float(np.sqrt(np.trace(origin) / np.trace(camera)))

    assert 0.8 < ratio(LEVEL, TARGET) < 1.25
    assert 3.0 < ratio(far, TARGET + shift_m) < 8.0


def test_white_noise_averages_out_and_a_lasting_bias_does_not() -> None:
    white = replace(WHITE, rotation_white_rad=0.002, translation_white_m=1.0)
    assert bound_m(LEVEL, white) / bound_m(LEVEL * 2, white) == pytest.approx(np.sqrt(2.0), rel=1e-6)
    lasting = NoiseModel(pixel_px=0.3, heading_bias_rad=0.005)  # 5 m at 1000 m, too little for the frames to tell
    assert 5.0 < bound_m(LEVEL, lasting) < 7.0
    assert 1.0 <= bound_m(LEVEL, lasting) / bound_m(LEVEL * 2, lasting) < 1.1
    forgotten = replace(lasting, tau_s=1e-3)
    again = [CameraPose(p.stamp_s + 1000.0, p.position_enu_m, p.R_cam_from_enu) for p in LEVEL]
    assert bound_m(LEVEL, forgotten) / bound_m(LEVEL + again, forgotten) == pytest.approx(np.sqrt(2.0), rel=1e-6)


def test_half_of_the_frames_is_half_of_the_information() -> None:
    noise = replace(WHITE, rotation_white_rad=0.002, translation_white_m=1.0)
    assert bound_m(LEVEL, replace(noise, missed=0.5)) / bound_m(LEVEL, noise) == pytest.approx(np.sqrt(2.0), rel=1e-9)


def with_one_turned_back() -> tuple[list[CameraPose], list[CameraPose]]:
    back = CameraPose(LEVEL[6].stamp_s, LEVEL[6].position_enu_m, R_NORTH @ np.diag([-1.0, -1.0, 1.0]))
    return [*LEVEL[:6], back, *LEVEL[7:]], LEVEL[:6] + LEVEL[7:]


@pytest.mark.parametrize("noise", [WHITE, NoiseModel(heading_bias_rad=0.03, position_bias_m=1.0)])
def test_a_frame_that_does_not_show_it_adds_nothing(noise: NoiseModel) -> None:
    turned_back, without = with_one_turned_back()
    bounds = position_bound(CAMERA, turned_back, TARGET, noise)
    assert bounds[-1] == pytest.approx(covariance_of(without, noise), rel=1e-9)
    assert bounds[6].tolist() == bounds[5].tolist()
    assert np.isinf(bound_m([turned_back[6]] * 3, noise))


def test_a_time_offset_near_a_frame_that_does_not_show_it() -> None:
    turned_back, without = with_one_turned_back()
    noise = replace(WHITE, time_offset_s=0.3)
    assert bound_m(turned_back, noise) == pytest.approx(bound_m(without, noise), rel=0.05)


@pytest.mark.parametrize("missed", [-0.1, 1.0, float("nan")])
def test_an_impossible_share_missed_raises(missed: float) -> None:
    with pytest.raises(ValueError, match="missed"):
        position_bound(CAMERA, LEVEL, TARGET, NoiseModel(missed=missed))


def test_the_papers_noise_read_literally() -> None:
    flight = paper_flight()
    poses = [flight.pose_at(float(stamp_s)) for stamp_s in flight.stamps_s]
    noise = NoiseModel(
        rotation_white_rad=float(np.radians(0.5) / np.sqrt(3.0)),
        rotation_about="origin",
        translation_white_m=0.1 / float(np.sqrt(3.0)),
    )
    errors_m = error_bound_m(position_bound(CAMERA, poses, CUBE_ENU_M, noise))
    assert 74.0 < errors_m[20] < 79.5
    assert errors_m[100] == pytest.approx(7.1, abs=0.1)
    assert 21.0 < errors_m[20:].mean() < 22.5


def test_a_drift_that_lasts_for_good_is_a_bias_that_stays_and_a_short_one_weighs_less() -> None:
    poses = poses_on("perpendicular")
    noise = NoiseModel(pixel_px=0.2, tau_s=1e9)
    stays, lasts, forgets = (
        error_bound_m(position_bound(CAMERA, poses, TARGET, one))[-1]
        for one in (
            replace(noise, position_bias_m=3.0),
            replace(noise, position_drift_m=3.0),
            replace(noise, position_drift_m=3.0, tau_s=1.0),
        )
    )
    assert lasts == pytest.approx(stays, rel=1e-3)
    assert error_bound_m(position_bound(CAMERA, poses, TARGET, noise))[-1] < forgets != pytest.approx(stays, rel=0.05)
    with pytest.raises(ValueError, match="position_drift_m=-1"):
        NoiseModel(position_drift_m=-1.0)
