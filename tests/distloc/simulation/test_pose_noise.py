from dataclasses import replace

import numpy as np
import pytest

from distloc.geometry.rotations import matrix_from_euler
from distloc.simulation.errors import GaussMarkov
from distloc.simulation.pose_noise import CorrelatedPoseErrors, CorrelatedSigmas, NoPoseNoise, UniformPoseNoise
from distloc.types import CameraPose, FloatArray

R_TRUE: FloatArray = matrix_from_euler(0.7, -0.4, 1.1)
POSITION = np.array([120.0, -340.0, 56.0])
NO_ERRORS = CorrelatedSigmas(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 100.0)
SEEDS = 1500
PINNED = (  # made by commit bb0a625
    (0.0, [-0.25161686, -0.48898155, 0.26003362], [0.99992284, 0.01144121, -0.00483844]),
    (10.0, [-0.15523508, 0.46135925, 0.02989659], [0.99995487, -0.00925894, -0.00212651]),
)


def still(stamp_s: float) -> CameraPose:
    return CameraPose(stamp_s, POSITION, R_TRUE)


def moving(stamp_s: float) -> CameraPose:
    return CameraPose(
        stamp_s, POSITION + stamp_s * np.array([10.0, 0.0, 1.0]), matrix_from_euler(0.1 * stamp_s, 0.0, 0.0)
    )


def about(axis: int, angle: float) -> FloatArray:
    turn = np.eye(3)
    i, j = (axis + 1) % 3, (axis + 2) % 3
    turn[[i, j], [i, j]] = np.cos(angle)
    turn[i, j], turn[j, i] = -np.sin(angle), np.sin(angle)
    return turn


def rotation_vector(R: FloatArray) -> FloatArray:
    twice_sine = np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]])
    sine = np.linalg.norm(twice_sine) / 2.0
    return twice_sine / 2.0 * (np.arcsin(sine) / sine if sine > 1e-12 else 1.0)


def attitude_error(reported: CameraPose, true: CameraPose) -> FloatArray:
    """Of R_enu_from_cam, about east, north and up."""
    return rotation_vector(reported.R_cam_from_enu.T @ true.R_cam_from_enu)


def angles_and_shift(reported: CameraPose) -> FloatArray:
    """The paper's three angles and nu_t (6,) from M_nu = [N_rx N_ry N_rz R | t + nu_t]."""
    N = reported.R_cam_from_enu @ R_TRUE.T
    a, b, c = np.arctan2(-N[1, 2], N[2, 2]), np.arcsin(N[0, 2]), np.arctan2(-N[0, 1], N[0, 0])
    assert np.allclose(about(0, a) @ about(1, b) @ about(2, c), N, rtol=0.0, atol=1e-9)
    nu_t = -reported.R_cam_from_enu @ reported.position_enu_m + R_TRUE @ POSITION
    return np.array([a, b, c, *nu_t])


@pytest.fixture(scope="module")
def draws() -> FloatArray:
    noise = UniformPoseNoise(0.3, 2.0, np.random.default_rng(3))
    return np.array([angles_and_shift(noise.reported(still, float(i))) for i in range(20_000)]) / np.repeat(
        [0.3, 2.0], 3
    )


@pytest.mark.parametrize("axis", range(6))
def test_uniform_noise_is_uniform_on_each_axis(draws: FloatArray, axis: int) -> None:
    values, n = np.sort(draws[:, axis]), draws.shape[0]
    assert -1.0 <= values[0] < -0.999 and 0.999 < values[-1] <= 1.0
    assert abs(values.mean()) < 0.02
    assert values.var() == pytest.approx(1.0 / 3.0, rel=0.05)
    steps = np.arange(n + 1) / n
    uniform = (values + 1.0) / 2.0
    distance = max((steps[1:] - uniform).max(), (uniform - steps[:-1]).max())
    assert 0.35 < distance * np.sqrt(n) < 1.95  # Kolmogorov's: 0.03 and 99.9 %


def test_uniform_noise_is_independent_between_frames_and_axes(draws: FloatArray) -> None:
    across = np.corrcoef(draws.T) - np.eye(6)
    later = np.corrcoef(draws[:-1].T, draws[1:].T)[:6, 6:]
    assert 1e-4 < np.abs(across).max() < 0.03
    assert 1e-4 < np.abs(later).max() < 0.03


def test_uniform_noise_keeps_rotations_and_the_stamp() -> None:
    noise = UniformPoseNoise(0.5, 1.0, np.random.default_rng(0))
    for i in range(200):
        reported = noise.reported(moving, 0.1 * i)
        assert reported.R_cam_from_enu @ reported.R_cam_from_enu.T == pytest.approx(np.eye(3), abs=1e-12)
        assert np.linalg.det(reported.R_cam_from_enu) == pytest.approx(1.0)
        assert reported.stamp_s == 0.1 * i


def test_no_amplitude_is_the_truth() -> None:
    rng = np.random.default_rng(0)
    for noise in (UniformPoseNoise(0.0, 0.0, rng), NoPoseNoise(), CorrelatedPoseErrors(NO_ERRORS, rng)):
        for stamp_s in (0.0, 3.0, 200.0):
            reported, true = noise.reported(moving, stamp_s), moving(stamp_s)
            assert reported.stamp_s == stamp_s
            assert reported.position_enu_m == pytest.approx(true.position_enu_m, abs=1e-9)
            assert reported.R_cam_from_enu == pytest.approx(true.R_cam_from_enu, abs=1e-12)


def test_each_amplitude_is_its_own() -> None:
    turned = angles_and_shift(UniformPoseNoise(0.1, 0.0, np.random.default_rng(0)).reported(still, 0.0))
    moved = angles_and_shift(UniformPoseNoise(0.0, 0.1, np.random.default_rng(0)).reported(still, 0.0))
    assert (np.abs(turned[:3]) > 1e-4).all() and turned[3:] == pytest.approx(0.0, abs=1e-9)
    assert (np.abs(moved[3:]) > 1e-4).all() and moved[:3] == pytest.approx(0.0, abs=1e-9)


def test_a_rotation_moves_the_camera_about_the_origin() -> None:
    reported = UniformPoseNoise(0.1, 0.0, np.random.default_rng(0)).reported(still, 0.0)
    assert np.linalg.norm(reported.position_enu_m) == pytest.approx(np.linalg.norm(POSITION))
    assert np.linalg.norm(reported.position_enu_m - POSITION) > 1.0


@pytest.mark.parametrize(("rotation_rad", "translation_m"), [(-0.1, 0.0), (0.0, -1.0), (np.nan, 0.0), (0.0, np.nan)])
def test_bad_amplitudes_raise(rotation_rad: float, translation_m: float) -> None:
    with pytest.raises(ValueError, match="amplitudes"):
        UniformPoseNoise(rotation_rad, translation_m, np.random.default_rng(0))


def test_attitude_biases_have_their_sigmas_and_forget_themselves() -> None:
    sigmas = CorrelatedSigmas(0.03, 0.01, 0.0, 0.0, 0.0, 0.0, 100.0)
    errors = np.empty((SEEDS, 3, 3))
    for seed in range(SEEDS):
        noise = CorrelatedPoseErrors(sigmas, np.random.default_rng(seed))
        for step, stamp_s in enumerate((5.0, 65.0, 155.0)):
            errors[seed, step] = attitude_error(noise.reported(still, stamp_s), still(stamp_s))
            assert np.allclose(errors[seed, step], noise.bias_rad, rtol=0.0, atol=1e-9)
    scaled = errors / np.array([0.01, 0.01, 0.03])
    assert scaled.std(axis=0) == pytest.approx(1.0, abs=0.07)
    assert np.abs(scaled.mean(axis=0)).max() < 0.1
    for first, second, lag_s in ((0, 1, 60.0), (0, 2, 150.0), (1, 2, 90.0)):
        correlation = np.mean(scaled[:, first] * scaled[:, second]) / np.mean(scaled**2)
        assert correlation == pytest.approx(np.exp(-lag_s / 100.0), abs=0.05)
    across = np.corrcoef(scaled[:, 0].T) - np.eye(3)
    assert 1e-4 < np.abs(across).max() < 0.09


def test_white_errors_have_their_sigmas_and_are_new_each_frame() -> None:
    sigmas = CorrelatedSigmas(0.0, 0.0, 0.002, 0.0, 0.3, 0.0, 100.0)
    noise = CorrelatedPoseErrors(sigmas, np.random.default_rng(1))
    reports = [noise.reported(still, 0.1 * i) for i in range(4000)]
    attitude = np.array([attitude_error(one, still(0.0)) for one in reports])
    position = np.array([one.position_enu_m - POSITION for one in reports])
    for errors, sigma in ((attitude, 0.002), (position, 0.3)):
        assert errors.std(axis=0) == pytest.approx(sigma, rel=0.05)
        assert np.abs(errors.mean(axis=0)).max() < 0.06 * sigma
        later = np.corrcoef(errors[:-1].T, errors[1:].T)[:3, 3:]
        assert 1e-4 < np.abs(later).max() < 0.06


def test_the_position_bias_stays_and_has_its_sigma() -> None:
    sigmas = CorrelatedSigmas(0.0, 0.0, 0.0, 1.5, 0.0, 0.0, 100.0)
    biases = []
    for seed in range(SEEDS):
        noise = CorrelatedPoseErrors(sigmas, np.random.default_rng(seed))
        first, last = (noise.reported(moving, t).position_enu_m - moving(t).position_enu_m for t in (0.0, 500.0))
        assert first == pytest.approx(last, abs=1e-9)
        biases.append(first)
    assert np.std(biases, axis=0) == pytest.approx(1.5, rel=0.07)
    assert np.abs(np.mean(biases, axis=0)).max() < 0.15


def test_the_reported_pose_lags_by_the_time_offset() -> None:
    sigmas = CorrelatedSigmas(0.0, 0.0, 0.0, 0.0, 0.0, 0.05, 100.0)
    offsets = []
    for seed in range(SEEDS):
        noise = CorrelatedPoseErrors(sigmas, np.random.default_rng(seed))
        offsets.append(noise.time_offset_s)
        for stamp_s in (2.0, 30.0):
            reported, lagging = noise.reported(moving, stamp_s), moving(stamp_s - offsets[-1])
            assert reported.stamp_s == stamp_s
            assert reported.position_enu_m == pytest.approx(lagging.position_enu_m, abs=1e-9)
            assert reported.R_cam_from_enu == pytest.approx(lagging.R_cam_from_enu, abs=1e-12)
    assert np.std(offsets) == pytest.approx(0.05, rel=0.07)
    assert abs(np.mean(offsets)) < 0.005


def test_a_heading_bias_turns_about_up() -> None:
    noise = CorrelatedPoseErrors(CorrelatedSigmas(0.05, 0.0, 0.0, 0.0, 0.0, 0.0, 100.0), np.random.default_rng(2))
    reported = noise.reported(still, 0.0)
    bias = float(noise.bias_rad[2])
    to_target = np.array([3000.0, 8000.0, -500.0])
    seen = reported.R_cam_from_enu.T @ (R_TRUE @ to_target)
    azimuth_rad = np.arctan2(seen[0], seen[1]) - np.arctan2(3000.0, 8000.0)
    assert abs(bias) > 0.01
    assert azimuth_rad == pytest.approx(-bias, abs=1e-9)  # positive about up is against the compass
    assert seen[2] == pytest.approx(-500.0, abs=1e-6)
    assert reported.position_enu_m == pytest.approx(POSITION)


def test_the_same_seed_gives_the_same_errors() -> None:
    first, same, other = (CorrelatedPoseErrors(CorrelatedSigmas(), np.random.default_rng(seed)) for seed in (1, 1, 2))
    one, two, three = (noise.reported(moving, 5.0) for noise in (first, same, other))
    assert np.array_equal(one.position_enu_m, two.position_enu_m)
    assert np.array_equal(one.R_cam_from_enu, two.R_cam_from_enu)
    assert not np.allclose(one.R_cam_from_enu, three.R_cam_from_enu, atol=1e-6)


@pytest.mark.parametrize("step_s", [0.0, 1.0, 30.0, 1000.0])
def test_a_gauss_markov_process_keeps_its_variance(step_s: float) -> None:
    process = GaussMarkov(np.full(20_000, 2.0), 30.0, np.random.default_rng(0))
    start = process.value.copy()
    for i in range(40):
        process.advance(i * step_s)
        assert process.value.std() == pytest.approx(2.0, rel=0.03)
    process.advance(1e6)
    process.advance(1e6 + 30.0)
    before = process.value.copy()
    process.advance(1e6 + 30.0 + 15.0)
    assert np.corrcoef(before, process.value)[0, 1] == pytest.approx(np.exp(-0.5), abs=0.02)
    assert abs(np.corrcoef(start, process.value)[0, 1]) < 0.03


def test_stamps_that_fall_keep_the_value() -> None:
    process = GaussMarkov(np.array([2.0, 0.0]), 30.0, np.random.default_rng(0))
    process.advance(100.0)
    held = process.value.copy()
    for stamp_s in (90.0, 0.0, 99.9, 100.0):
        process.advance(stamp_s)
        assert np.array_equal(process.value, held)
    process.advance(130.0)
    assert process.value[0] != held[0] and process.value[1] == 0.0


@pytest.mark.parametrize(
    ("sigma", "tau_s"), [([1.0], 0.0), ([1.0], -1.0), ([1.0], np.nan), ([-1.0], 1.0), ([np.nan], 1.0), ([np.inf], 1.0)]
)
def test_a_bad_gauss_markov_process_raises(sigma: list[float], tau_s: float) -> None:
    with pytest.raises(ValueError, match=r"tau_s|standard deviations"):
        GaussMarkov(np.array(sigma), tau_s, np.random.default_rng(0))


def test_the_position_drifts_and_leaves_the_other_errors_as_they_were() -> None:
    drifts = np.empty((SEEDS, 2, 3))
    for seed in range(SEEDS):
        sigmas = CorrelatedSigmas(tau_s=120.0)
        with_drift, without = (
            CorrelatedPoseErrors(one, np.random.default_rng(seed))
            for one in (replace(sigmas, position_drift_m=1.5), sigmas)
        )
        for step, stamp_s in enumerate((5.0, 65.0)):
            drifting, steady = with_drift.reported(still, stamp_s), without.reported(still, stamp_s)
            assert np.array_equal(drifting.R_cam_from_enu, steady.R_cam_from_enu)
            drifts[seed, step] = drifting.position_enu_m - steady.position_enu_m
    assert drifts.std(axis=0) == pytest.approx(1.5, rel=0.07)
    assert np.abs(drifts.mean(axis=0)).max() < 0.15
    correlation = np.mean(drifts[:, 0] * drifts[:, 1]) / np.mean(drifts**2)
    assert correlation == pytest.approx(np.exp(-60.0 / 120.0), abs=0.05)


def test_errors_without_a_drift_are_those_of_before_there_was_one() -> None:
    noise = CorrelatedPoseErrors(CorrelatedSigmas(tau_s=120.0), np.random.Generator(np.random.SFC64(900)))
    for stamp_s, position_m, row in PINNED:
        reported = noise.reported(lambda t: CameraPose(t, np.zeros(3), np.eye(3)), stamp_s)
        assert reported.position_enu_m == pytest.approx(position_m, abs=1e-7)
        assert reported.R_cam_from_enu[0] == pytest.approx(row, abs=1e-7)
