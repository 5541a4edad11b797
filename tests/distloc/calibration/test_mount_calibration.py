"""The mount from sights of a landmark: errors against their sigmas over many flights, outliers, and what is refused."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from distloc.calibration.chain import solve_chain
from distloc.calibration.mount_calibration import (
    GAIN_SIGMA,
    LANDMARK_SIGMA_M,
    LandmarkSight,
    MountCalibration,
    calibrate_mount,
    euler_from_matrix,
    landmark_sight,
    nearest_sights,
    shifted,
    wrapped_rad,
)
from distloc.calibration.pose_trail import PoseTrail
from distloc.geometry.camera import Camera
from distloc.geometry.rotations import R_cam_from_enu, matrix_from_euler, matrix_from_rotation_vector
from distloc.sights.sights import ray_of, sight_of
from distloc.simulation.paths import Wobble
from distloc.simulation.pose_noise import CorrelatedPoseErrors, CorrelatedSigmas
from distloc.types import CameraPose, Detection, FloatArray, PoseErrors

CAMERA = Camera(1920, 1080, 1200.0, 1200.0, 960.0, 540.0)
LANDMARK_ENU_M = np.array([0.0, 0.0, 60.0])
BELIEVED_RAD = np.radians([-75.0, -5.0, 0.0])
ERRORS = PoseErrors(np.radians(2.0), np.radians(0.5), np.radians(0.1), 1.0, 120.0)
PIXEL_SIGMA_PX = 1.0


def flight(
    seed: int,
    mount_rad: FloatArray,
    errors: PoseErrors = ERRORS,
    headings_deg: tuple[float, ...] = (0.0, 90.0, 180.0, 270.0),
    rocking_rad: float = 0.1,
    outliers: float = 0.0,
    noisier: float = 1.0,
    drawn: float = 1.0,
) -> list[LandmarkSight]:
    """Legs of 60 s past a landmark, 1.5 km off on the side that the camera looks to; a sight every second.

    The errors of pose and landmark are drawn as the estimate takes them to be; `noisier` makes the pixels' larger,
    `drawn` the landmark's and those by the tilt.
    """
    rng = np.random.default_rng(seed)
    sigmas = CorrelatedSigmas(
        heading_bias_rad=errors.heading_bias_rad,
        tilt_bias_rad=errors.tilt_bias_rad,
        attitude_white_rad=errors.attitude_white_rad,
        position_bias_m=drawn * float(np.hypot(errors.position_m, LANDMARK_SIGMA_M)),
        position_white_m=errors.position_m,
        tau_s=errors.bias_time_constant_s,
    )
    noise, wobble = CorrelatedPoseErrors(sigmas, rng), Wobble(rocking_rad, seed)
    gain = drawn * GAIN_SIGMA * rng.standard_normal((3, 2))
    R_old = matrix_from_euler(*BELIEVED_RAD)
    sights = []
    for second in range(60 * len(headings_deg)):
        heading = np.radians(headings_deg[second // 60])
        along = np.array([np.sin(heading), np.cos(heading), 0.0])
        left = np.array([-along[1], along[0], 0.0])
        position = (12.0 * (second % 60) - 700.0) * along - 1500.0 * left + np.array([0.0, 0.0, 120.0])
        R_ned_from_body = matrix_from_euler(*(np.array([heading, 0.0, 0.0]) + wobble.at(float(second))))
        true = CameraPose(float(second), position, R_cam_from_enu(R_ned_from_body, matrix_from_euler(*mount_rad)))
        pixel, inside = CAMERA.project((true.R_cam_from_enu @ (LANDMARK_ENU_M - position))[:, None])
        if not inside[0]:
            continue
        u, v = pixel[:, 0] + noisier * PIXEL_SIGMA_PX * rng.standard_normal(2)
        if rng.random() < outliers:
            u, v = u + rng.uniform(-200.0, 200.0), v + rng.uniform(-200.0, 200.0)
        # what is reported has the old mount in it and the attitude's errors about it
        tilted = R_ned_from_body @ matrix_from_rotation_vector(gain @ -R_ned_from_body[2, :2])
        old = CameraPose(true.stamp_s, position, R_cam_from_enu(tilted, R_old))
        pose = noise.reported(lambda stamp_s, pose=old: pose, true.stamp_s)  # type: ignore[misc]
        detection = Detection.from_point(u, v, PIXEL_SIGMA_PX / np.sqrt(2.0))
        ray = ray_of(CAMERA, pose, detection, "centre")
        sight = sight_of(ray, errors, PIXEL_SIGMA_PX / np.sqrt(2.0), 1500.0, np.array([detection.width_px] * 2))
        sights.append(landmark_sight(sight, pose, errors, R_old))
    return sights


def fitted(sights: list[LandmarkSight]) -> MountCalibration:
    return calibrate_mount(sights, LANDMARK_ENU_M, matrix_from_euler(*BELIEVED_RAD))


def random_mount(seed: int) -> FloatArray:
    return BELIEVED_RAD + np.radians(3.0) * np.random.default_rng(1000 + seed).standard_normal(3)


@pytest.mark.thorough
@pytest.mark.parametrize("outliers", [0.0, 0.1])
def test_errors_are_as_large_as_the_sigmas_say(outliers: float) -> None:
    squared, each = [], []
    for seed in range(24):
        mount_rad = random_mount(seed)
        found = fitted(flight(seed, mount_rad, outliers=outliers))
        error = wrapped_rad(found.angles_rad - mount_rad)
        squared.append(error @ np.linalg.solve(found.covariance_rad2, error))
        each.append(error / found.sigmas_rad)
    # chi-square with 3 degrees of freedom: the mean of 24 is 3 +- 0.5; each angle's is 1 +- 0.29
    assert 1.8 < np.mean(squared) < 4.5
    each_mean = np.mean(np.square(each), axis=0)
    assert (each_mean > 0.4).all() and (each_mean < 1.9).all()


def test_sigmas_are_no_larger_than_the_flight_makes_them() -> None:
    rocking = np.degrees(fitted(flight(1, random_mount(1))).sigmas_rad)
    level = np.degrees(fitted(flight(1, random_mount(1), rocking_rad=1e-3)).sigmas_rad)
    one_leg = np.degrees(fitted(flight(1, random_mount(1), headings_deg=(0.0,), rocking_rad=1e-3)).sigmas_rad)
    # level, the yaw is as unsure as the compass' mean: 2 deg * sqrt(2 / (2 + T / tau)) is 1.41 and 1.79 deg at the best
    assert 1.25 < level[0] < 1.55 and 1.65 < one_leg[0] < 1.95
    # one heading: the pitch, half a degree of tilt; four: the mean of what turns with the earth
    assert 0.4 < one_leg[1] < 0.7 and 0.08 < level[1] < 0.35
    assert 0.2 < rocking[0] < 0.8 and (rocking[1:] < 0.35).all()


def test_noisier_sights_than_said_are_noticed() -> None:
    quiet, noisy = (fitted(flight(2, random_mount(2), noisier=noisier)) for noisier in (1.0, 12.0))
    assert 1.0 <= quiet.white_scale < 1.2
    # 0.57 deg of pixels beside 0.1 deg of attitude, where 0.11 are expected
    assert 4.0 < noisy.white_scale < 6.5
    assert noisy.used.mean() > 0.98
    assert (noisy.sigmas_rad > quiet.sigmas_rad).all()


def test_outliers_are_rejected_and_named() -> None:
    sights = flight(3, random_mount(3))
    clean = fitted(sights)
    wrong = np.arange(10, len(sights), 17)
    for i in wrong:
        turn = matrix_from_rotation_vector(np.array([0.0, 0.0, np.radians(5.0)]))
        sight = dataclasses.replace(sights[i].sight, axes=sights[i].sight.axes @ turn.T)
        sights[i] = dataclasses.replace(sights[i], sight=sight)
    found = fitted(sights)
    assert not found.used[wrong].any()
    assert found.used.sum() >= len(sights) - len(wrong) - 3
    assert np.abs(wrapped_rad(found.angles_rad - clean.angles_rad)).max() < 0.3 * clean.sigmas_rad.min()
    assert np.degrees(np.abs(found.residuals_rad[wrong, 0])) == pytest.approx(5.0, abs=1.0)


def test_sights_without_errors_give_the_mount_exactly() -> None:
    exact = PoseErrors(1e-6, 1e-6, 1e-6, 1e-4, 600.0)
    mount_rad = np.radians([-70.0, 2.0, 7.0])
    found = fitted(flight(4, mount_rad, errors=exact, noisier=0.0, drawn=0.0))
    assert np.degrees(wrapped_rad(found.angles_rad - mount_rad)) == pytest.approx(0.0, abs=0.01)
    assert np.abs(found.residuals_rad).max() < 1e-4


def test_nearest_sight_within_the_gate() -> None:
    sights = flight(5, BELIEVED_RAD)[:30]
    turned = []
    for one in sights:
        turn = matrix_from_rotation_vector(np.array([0.0, 0.0, np.radians(8.0)]))
        turned.append(dataclasses.replace(one, sight=dataclasses.replace(one.sight, axes=one.sight.axes @ turn.T)))
    frames = [[far, near] for far, near in zip(turned, sights, strict=True)]
    chosen = nearest_sights(frames, LANDMARK_ENU_M, np.eye(3), np.radians(20.0))
    assert all(one is near for one, near in zip(chosen, sights, strict=True))
    assert nearest_sights([[one] for one in turned], LANDMARK_ENU_M, np.eye(3), np.radians(2.0)) == []
    # a camera that looks further to the right than is believed shows everything too far to the left
    R_base_from_old = matrix_from_rotation_vector(np.array([0.0, 0.0, np.radians(8.0)]))
    chosen = nearest_sights(frames, LANDMARK_ENU_M, R_base_from_old, np.radians(20.0))
    assert all(one is far for one, far in zip(chosen, turned, strict=True))


def test_shifted_sights_have_the_pose_of_before() -> None:
    R_old = matrix_from_euler(*BELIEVED_RAD)
    rate_rps, speed = np.array([0.05, -0.02, 0.1]), np.array([10.0, 0.0, -1.0])

    def pose_at(stamp_s: float) -> CameraPose:
        R_ned_from_body = matrix_from_rotation_vector(rate_rps * stamp_s)
        return CameraPose(stamp_s, speed * stamp_s, R_cam_from_enu(R_ned_from_body, R_old))

    def sights_by(offset_s: float) -> list[LandmarkSight]:
        out = []
        for stamp_s in np.arange(1.0, 9.0, 0.3):
            pose = dataclasses.replace(pose_at(stamp_s - offset_s), stamp_s=stamp_s)
            ray = ray_of(CAMERA, pose, Detection.from_point(700.0 + 20.0 * stamp_s, 500.0, 1.0), "centre")
            out.append(landmark_sight(sight_of(ray, ERRORS, 1.0, 1500.0, None), pose, ERRORS, R_old))
        return out

    trail = PoseTrail([pose_at(stamp_s) for stamp_s in np.arange(0.0, 8.5, 0.02)])
    moved = shifted([[one] for one in sights_by(0.0)], trail, 0.2, R_old)
    expected = sights_by(0.2)
    assert len(moved) == len([one for one in expected if one.sight.stamp_s - 0.2 < 8.48])
    for (one,), other in zip(moved, expected, strict=False):
        assert one.sight.position_enu_m == pytest.approx(other.sight.position_enu_m, abs=1e-9)
        assert one.sight.axes[2] == pytest.approx(other.sight.axes[2], abs=1e-5)
        assert one.R_enu_from_base == pytest.approx(other.R_enu_from_base, abs=1e-5)


@given(st.floats(-np.pi, np.pi), st.floats(-np.pi / 2 + 1e-3, np.pi / 2 - 1e-3), st.floats(-np.pi, np.pi))
def test_angles_come_back_from_the_matrix(yaw: float, pitch: float, roll: float) -> None:
    angles = euler_from_matrix(matrix_from_euler(yaw, pitch, roll))
    assert matrix_from_euler(*angles) == pytest.approx(matrix_from_euler(yaw, pitch, roll), abs=1e-12)


@pytest.mark.parametrize("pitch", [-np.pi / 2, np.pi / 2])
def test_angles_of_a_camera_that_looks_straight_up_or_down(pitch: float) -> None:
    R = matrix_from_euler(0.3, pitch, 0.2)
    angles = euler_from_matrix(R)
    assert angles[2] == 0.0
    assert matrix_from_euler(*angles) == pytest.approx(R, abs=1e-9)


def test_chain_is_the_dense_solution() -> None:
    rng = np.random.default_rng(0)
    n, m, k = 7, 4, 3
    by_shared, by_own = rng.normal(size=(n, 5, m)), rng.normal(size=(n, 5, k))
    residual, kept, state = rng.normal(size=(n, 5)), rng.uniform(0.1, 0.99, n - 1), rng.normal(size=(n, k))
    prior = np.eye(m)
    # the whole matrix, the chain's prior by its covariance: k_i k_i+1 ... between two links
    correlation = np.array([[np.prod(kept[min(i, j) : max(i, j)]) for j in range(n)] for i in range(n)])
    chain_prior = np.kron(np.linalg.inv(correlation), np.eye(k))
    J = np.zeros((5 * n, m + n * k))
    for i in range(n):
        J[5 * i : 5 * i + 5, :m] = by_shared[i]
        J[5 * i : 5 * i + 5, m + k * i : m + k * (i + 1)] = by_own[i]
    H = J.T @ J
    H[:m, :m] += prior
    H[m:, m:] += chain_prior
    g = -J.T @ residual.ravel()
    g[m:] -= chain_prior @ state.ravel()
    step, chain_step, covariance = solve_chain(
        np.einsum("nka,nkb->ab", by_shared, by_shared) + prior,
        -np.einsum("nka,nk->a", by_shared, residual),
        np.einsum("nka,nkb->nab", by_shared, by_own),
        np.einsum("nka,nkb->nab", by_own, by_own),
        -np.einsum("nka,nk->na", by_own, residual),
        kept,
        state,
    )
    dense = np.linalg.solve(H, g)
    assert step == pytest.approx(dense[:m])
    assert chain_step.ravel() == pytest.approx(dense[m:])
    assert covariance == pytest.approx(np.linalg.inv(H)[:m, :m])


def test_what_cannot_be_fitted_is_refused() -> None:
    sights = flight(6, BELIEVED_RAD)
    with pytest.raises(ValueError, match="at least 20 sights are needed, got 19"):
        fitted(sights[:19])
    with pytest.raises(ValueError, match="finite"):
        calibrate_mount(sights, np.array([np.nan, 0.0, 0.0]), matrix_from_euler(*BELIEVED_RAD))
    rng = np.random.default_rng(0)
    scattered = []
    for one in sights[:24]:  # no two alike
        turn = matrix_from_rotation_vector(rng.uniform(-0.5, 0.5, 3))
        scattered.append(dataclasses.replace(one, sight=dataclasses.replace(one.sight, axes=one.sight.axes @ turn.T)))
    try:
        found = fitted(scattered)
    except ValueError as error:
        assert "that agree" in str(error)
    else:  # taken as very noisy sights: then it must say so
        assert found.white_scale > 20.0
