"""The filter alone, on directions: against a Kalman filter, against many flights, and within its memory."""

import tracemalloc
from dataclasses import replace

import numpy as np
import pytest

from distloc.filter.bank import Bank
from distloc.filter.calibrated_filter import CalibratedFilter
from distloc.filter.ground import FlatGround, NoGround, ground_prior
from distloc.filter.particles import Particles
from distloc.filter.uncertainty import ellipse_holds, weighted_ellipse
from distloc.geometry.camera import Camera
from distloc.sights.sight import Sight, Sights
from distloc.simulation.flights import flight_past
from distloc.simulation.pose_noise import CorrelatedPoseErrors, CorrelatedSigmas
from distloc.types import CameraPose, FloatArray, PoseErrors

CAMERA = Camera(1920, 1080, 1200.0, 1200.0, 960.0, 540.0)
ERRORS = PoseErrors(float(np.radians(2.0)), float(np.radians(0.5)), float(np.radians(0.1)), 0.3, 300.0)
SIGMA = np.diag(np.square(np.radians([0.5, 0.5, 2.0])))  # of the bias about east, north and up
WHITE = np.diag([2.0e-6, 3.0e-6])
# the aim's error, what is left of it from sight to sight, and how it grows as the camera comes nearer
AIM_RAD, AIM_KEPT, AIM_GROWTH = np.array([0.008, 0.004]), 0.7, 1.05
NORTH = np.array([0.0, 1.0, 0.0])
ALONE = np.array([0])


def sight(ray_enu: FloatArray, position_enu_m: FloatArray | None = None, stamp_s: float = 0.0) -> Sight:
    ray = ray_enu / np.linalg.norm(ray_enu)
    right = np.cross(ray, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    axes = np.stack([right, np.cross(right, ray), ray])
    return Sight(stamp_s, np.zeros(3) if position_enu_m is None else position_enu_m, axes, WHITE)


def started(n: int = 40_000, seed: int = 0, range_m: tuple[float, float] = (50.0, 30_000.0)) -> CalibratedFilter:
    one = CalibratedFilter.alone(n, np.random.default_rng(seed), range_m)
    one.start(sight(NORTH), ERRORS)
    return one


def moments(values: FloatArray, weights: FloatArray) -> tuple[FloatArray, FloatArray]:
    mean = values @ weights
    centred = values - mean[:, None]
    return mean, centred * weights @ centred.T


def weighted_positions(one: CalibratedFilter) -> tuple[FloatArray, FloatArray]:
    """A sample's positions (3, n) in ENU and weights (n,)."""
    x, weights = one.bank.particles.sampled(ALONE)
    return x[0, :3] + one.bank.particles.origin_enu_m[0, :, None], weights[0]


def nuisances(one: CalibratedFilter) -> FloatArray:
    """Means of bias and aim (5, N)."""
    return one.bank.particles.x[0][3:] * one.bank.particles.scale[0][:, None]


def is_resampled(one: CalibratedFilter) -> bool:
    """Only a cloud that was just drawn anew has equal weights."""
    return one.cloud.effective > 0.999 * one.bank.particles.n


def tangents_and_depth(one: CalibratedFilter) -> FloatArray:
    """Right, up and logarithm of the depth (3, N), looking north from the origin."""
    east, north, up = one.bank.particles.x[0][:3].astype(np.float64) + one.bank.particles.origin_enu_m[0][:, None]
    return np.stack([east / north, up / north, np.log(north)])


def test_starts_along_the_ray_with_the_bias_conditional_on_the_offset() -> None:
    one = started()
    right, up, log_depth = tangents_and_depth(one)
    low, high = np.log([50.0, 30_000.0])
    ranks = np.sort((log_depth - low) / (high - low)) - (np.arange(40_000) + 0.5) / 40_000
    assert 0.0 < np.abs(ranks).max() < 5e-5  # one in each stratum of 1 / N, and not in its middle
    # a heading bias of 2 degrees moves what is ahead in the north sideways, one about east moves it up
    expected = np.array([np.radians(2.0) ** 2 + 2.0e-6, np.radians(0.5) ** 2 + 3.0e-6])
    offsets = np.stack([right, up])
    covariance = np.cov(offsets)
    assert np.diag(covariance) == pytest.approx(expected, rel=5 * np.sqrt(2 / 40_000))
    assert abs(np.corrcoef(offsets)[0, 1]) < 5 / np.sqrt(40_000)
    assert abs(np.corrcoef(right, log_depth)[0, 1]) < 5 / np.sqrt(40_000)
    # truth to the right of the measured ray: the report is turned to the left, anticlockwise, so the bias about up is +
    slopes = np.stack([np.linalg.lstsq(offsets.T, m, rcond=None)[0] for m in nuisances(one)])
    share = np.array([np.radians(2.0) ** 2, np.radians(0.5) ** 2]) / expected
    assert slopes == pytest.approx(
        np.array([[0.0, -share[1]], [0.0, 0.0], [share[0], 0.0], [0.0, 0.0], [0.0, 0.0]]), abs=1e-5
    )


def test_start_turns_with_the_ray() -> None:
    one = CalibratedFilter.alone(20_000, np.random.default_rng(1))
    ray = np.array([3.0, -2.0, -0.5])
    camera_m = np.array([1000.0, -5000.0, 120.0])
    one.start(sight(ray, camera_m), ERRORS)
    particles = one.bank.particles
    offsets_m = particles.x[0, :3].astype(np.float64) + (particles.origin_enu_m[0] - camera_m)[:, None]
    along = ray / np.linalg.norm(ray) @ offsets_m
    assert (along > 49.0).all() and (along < 30_001.0).all()
    lateral = np.linalg.norm(np.cross(offsets_m.T, ray / np.linalg.norm(ray)), axis=1) / along
    assert np.degrees(np.sqrt(np.mean(lateral**2))) == pytest.approx(2.06, abs=0.1)
    assert one.cloud.effective == pytest.approx(20_000, rel=1e-3)


def kalman(measured: FloatArray, stamps_s: FloatArray, shifts: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Mean (7,) and covariance of (right, up, bias, aim) at a range, to the north: 0 = u - shift - y - H x - n."""
    H = np.array([[0.0, 0.0, 1.0, 1.0, 0.0], [-1.0, 0.0, 0.0, 0.0, 1.0]])
    unknown = np.diag([*np.diag(SIGMA), *np.square(AIM_RAD)])
    mean = np.zeros(7)
    covariance = np.block([[H @ unknown @ H.T + WHITE, H @ unknown], [unknown @ H.T, unknown]])
    A = np.hstack([np.eye(2), -H])
    for step, (y, waited_s, shift) in enumerate(zip(measured, np.diff(stamps_s, prepend=0.0), shifts, strict=True)):
        kept = np.exp(-waited_s / 300.0)
        F = np.diag([1.0, 1.0, kept, kept, kept, AIM_KEPT * AIM_GROWTH, AIM_KEPT * AIM_GROWTH])
        mean, covariance = F @ mean, F @ covariance @ F.T
        unknown[3:, 3:] = np.diag(np.square(AIM_RAD * AIM_GROWTH ** (step + 1)))
        new = np.array([1.0 - kept**2] * 3 + [1.0 - AIM_KEPT**2] * 2)
        covariance[2:, 2:] += np.diag(new) @ unknown
        gain = covariance @ A.T @ np.linalg.inv(A @ covariance @ A.T + WHITE)
        mean = mean + gain @ (y + shift - A @ mean)
        covariance = covariance - gain @ A @ covariance
    return mean, covariance


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_with_the_range_known_it_is_a_kalman_filter(seed: int) -> None:
    n, range_m = 60_000, 2000.0
    rng = np.random.default_rng(seed)
    stamps_s = np.cumsum(rng.uniform(100.0, 500.0, 15))
    # the camera sidles to and fro by metres, with a bias that wanders by degrees
    shifts = np.stack([np.linspace(0.0, 0.005, 15), np.zeros(15)], axis=1)
    measured = rng.normal(0.0, [0.005, 0.002], (15, 2)) - shifts
    one = CalibratedFilter.alone(n, np.random.default_rng(seed), (range_m, range_m * 1.0001))
    one.start(sight(NORTH), ERRORS, aim_sigma_rad=AIM_RAD)
    resampled = 0
    for step, (y, stamp_s, shift) in enumerate(zip(measured, stamps_s, shifts, strict=True)):
        one.predict(stamp_s, ERRORS)
        one.turn(np.full(2, AIM_KEPT), AIM_RAD * AIM_GROWTH ** (step + 1))
        one.update(sight(np.array([y[0], 1.0, y[1]]), np.array([shift[0] * range_m, 0.0, 0.0]), stamp_s))
        resampled += is_resampled(one)
    mean, covariance = kalman(measured, stamps_s, shifts)
    assert resampled >= 1  # the comparison includes the regularisation
    weights = one.bank.particles.weights[0].astype(np.float64)
    values = np.vstack([tangents_and_depth(one)[:2], nuisances(one)])
    found_mean, found_covariance = moments(values, weights / weights.sum())
    found_covariance[2:, 2:] += one.bank.P[0]
    sigmas = np.sqrt(np.diag(covariance))
    # 15 updates and their resampling each leave errors of some standard deviations / sqrt(N)
    assert np.abs((found_mean - mean) / sigmas).max() < 0.04
    assert (found_covariance / np.outer(sigmas, sigmas)) == pytest.approx(
        covariance / np.outer(sigmas, sigmas), abs=0.05
    )
    assert one.cloud.bias_rad == pytest.approx(found_mean[2:5], abs=1e-6)


def test_resampling_and_regularisation_keep_mean_and_covariance() -> None:
    one = started(60_000)
    # a cloud that is bent: half the range is favoured, and one side
    right, _, log_depth = tangents_and_depth(one)
    weights = np.exp(-0.5 * np.square((log_depth - np.log(2000.0)) / 0.3) + 20.0 * right)
    one.bank.particles.weights[0][:] = weights / weights.sum()
    weights = one.bank.particles.weights[0].astype(np.float64) / one.bank.particles.weights[0].sum(dtype=np.float64)
    effective = 1.0 / float(weights @ weights)
    before = moments(np.vstack([tangents_and_depth(one), nuisances(one)]), weights)
    one.bank.particles.measure(ALONE)
    one.bank.particles.resample_where_few(ALONE, np.stack([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], NORTH])[None], np.zeros(3))
    assert is_resampled(one)
    after = moments(np.vstack([tangents_and_depth(one), nuisances(one)]), np.full(60_000, 1.0 / 60_000))
    sigmas = np.sqrt(np.diag(before[1])) + 1e-12
    assert np.abs((after[0] - before[0]) / sigmas).max() < 4.0 / np.sqrt(effective)
    correlation = before[1] / np.outer(sigmas, sigmas)
    assert after[1] / np.outer(sigmas, sigmas) == pytest.approx(correlation, abs=6.0 / np.sqrt(effective))
    weights = one.bank.particles.weights[0]
    assert (weights == weights[0]).all() and weights.sum(dtype=np.float64) == pytest.approx(1.0, abs=1e-5)
    # and copies are spread: no two particles are in one place
    assert np.unique(one.bank.particles.x[0][:3], axis=1).shape[1] > 59_900


def test_a_bias_forgets_itself_and_its_marginal_stays() -> None:
    one = started()
    m, P = nuisances(one), one.bank.P[0].copy()
    one.predict(300.0, ERRORS)  # one time constant
    assert nuisances(one) == pytest.approx(m * np.exp(-1.0), abs=1e-7)
    assert np.abs(one.bank.P[0][:3, :3] - (P[:3, :3] * np.exp(-2.0) + (1.0 - np.exp(-2.0)) * SIGMA)).max() < 1e-12
    marginal = (np.cov(nuisances(one)) + one.bank.P[0])[:3, :3]
    assert marginal == pytest.approx(SIGMA, abs=2e-5)  # 2 degrees squared are 122e-5
    one.predict(200.0, ERRORS)  # time does not run backwards
    one.predict(300.0, ERRORS)
    assert nuisances(one) == pytest.approx(m * np.exp(-1.0), abs=1e-7)
    one.predict(1e6, ERRORS)
    assert np.abs(nuisances(one)).max() == 0.0
    assert np.abs(one.bank.P[0][:3, :3] - SIGMA).max() < 1e-12


def test_errors_that_change_widen_at_once_and_once() -> None:
    one = started()
    before = one.bank.P[0].copy()
    poor = replace(ERRORS, heading_bias_rad=float(np.radians(10.0)))
    one.predict(0.0, poor)
    added = one.bank.P[0] - before
    assert added[2, 2] == pytest.approx(np.radians(10.0) ** 2 - np.radians(2.0) ** 2, rel=1e-6)
    assert added[:2, :2] == pytest.approx(np.zeros((2, 2)), abs=1e-15)
    widened = one.bank.P[0].copy()
    one.predict(0.0, poor)
    assert np.abs(one.bank.P[0] - widened).max() < 1e-15
    one.predict(0.0, ERRORS)  # sizes that go up and down with every message add nothing more
    one.predict(0.0, poor)
    assert np.abs(one.bank.P[0] - widened).max() < 1e-15


def test_memory_does_not_grow_with_the_particles() -> None:
    one = started(100_000)

    def arrays() -> dict[int, int]:
        values = [*vars(one.bank).values(), *vars(one.bank.particles).values()]
        return {id(value): value.nbytes for value in values if isinstance(value, np.ndarray)}

    before_all = arrays()
    resampled, peaks = [], []
    one.update(sight(NORTH))
    tracemalloc.start()
    try:
        for k in range(1, 25):
            tracemalloc.reset_peak()
            held, _ = tracemalloc.get_traced_memory()
            camera_m = np.array([20.0 * k, 0.0, 0.0])
            one.predict(float(k), ERRORS)
            one.update(sight(np.array([0.0, 2000.0, 0.0]) - camera_m, camera_m, float(k)))
            peaks.append(tracemalloc.get_traced_memory()[1] - held)
            resampled.append(is_resampled(one))
    finally:
        tracemalloc.stop()
    assert 1 < sum(resampled) < 24  # steps of both kinds
    assert max(peaks) < 256 * 1024, max(peaks)
    large = {key for key, size in before_all.items() if size >= 100_000}
    assert len(large) == 4  # the particles, weights, a row that is drawn, and which are
    assert {key: size for key, size in arrays().items() if size >= 100_000} == {key: before_all[key] for key in large}


def test_same_seed_same_answer() -> None:
    def run(seed: int) -> FloatArray:
        one = started(2000, seed)
        for k in range(1, 20):
            camera_m = np.array([20.0 * k, 0.0, 0.0])
            one.predict(float(k), ERRORS)
            one.update(sight(np.array([0.0, 2000.0, 0.0]) - camera_m, camera_m, float(k)))
        return one.cloud.mean_enu_m

    assert run(3).tolist() == run(3).tolist()
    assert run(3).tolist() != run(4).tolist()


def test_what_is_behind_the_camera_gets_no_weight() -> None:
    one = started(20_000)
    camera_m = np.array([0.0, 1000.0, 0.0])  # among the particles, still looking north
    one.update(sight(NORTH, camera_m))
    points_enu_m, weights = weighted_positions(one)
    assert (weights[points_enu_m[1] < 1000.0] == 0.0).all()
    assert weights.sum() == pytest.approx(1.0)
    assert one.cloud.mean_enu_m[1] > 1000.0
    assert one.log_likelihood(sight(-NORTH, np.array([0.0, -100.0, 0.0]))) == -np.inf  # all are behind that one


@pytest.mark.parametrize("n", [500, 4096])
def test_a_sight_that_hardly_any_particle_expects_does_not_raise(n: int) -> None:
    for seed in range(40):
        rng, one = np.random.default_rng(seed), started(n, seed)
        for k in range(1, 4):
            camera_m = np.array([100.0 * k, 0.0, 0.0])
            ray = np.array([rng.uniform(-600.0, 100.0), 2000.0, rng.uniform(-60.0, 60.0)])
            one.predict(float(k), ERRORS)
            one.update(replace(sight(ray, camera_m, float(k)), covariance=1e-7 * np.eye(2)))
            assert np.isfinite(one.cloud.mean_enu_m).all()


def test_log_likelihood_is_the_density_of_what_comes() -> None:
    one = started(20_000, range_m=(2000.0, 2000.1))
    # the same camera again: two rays' difference has twice the white variance, for the bias is common
    spread = 2.0 * WHITE
    for right, up in [(0.0, 0.0), (0.002, 0.0), (0.0, -0.003)]:
        squared = right**2 / spread[0, 0] + up**2 / spread[1, 1]
        expected = -0.5 * squared - np.log(2.0 * np.pi) - 0.5 * np.log(np.linalg.det(spread))
        assert one.log_likelihood(sight(np.array([right, 1.0, up]))) == pytest.approx(expected, abs=0.15)


def test_flat_ground_gives_the_range_from_the_first_frame() -> None:
    height_m, angle = 150.0, 0.08
    camera_m = np.array([400.0, -300.0, height_m])
    ray = np.array([np.sin(0.7) * np.cos(angle), np.cos(0.7) * np.cos(angle), -np.sin(angle)])
    tight = PoseErrors(ERRORS.heading_bias_rad, float(np.radians(0.02)), 1e-4, 0.3, 300.0)
    exact = replace(sight(ray, camera_m), covariance=1e-8 * np.eye(2))
    one = CalibratedFilter.alone(20_000, np.random.default_rng(0))
    one.start(exact, tight, ground_prior(FlatGround(0.0, 3.0, slope=0.0), camera_m, 0.0))
    distance_m = float(np.hypot(*(one.cloud.mean_enu_m - camera_m)[:2]))
    assert distance_m == pytest.approx(height_m / np.tan(angle), rel=0.02)
    assert one.cloud.mean_enu_m[2] == pytest.approx(0.0, abs=1.0)
    # 3 m of relief and 0.02 degrees of tilt, seen under 0.08 rad
    sigma_m = float(np.hypot(3.0, distance_m * np.radians(0.02)) / np.tan(angle))
    points, weights = weighted_positions(one)
    off_m = np.abs(np.hypot(*(points - camera_m[:, None])[:2]) - height_m / np.tan(angle))
    # one in five may stand anywhere, and the regularisation of the few that are left spreads them by a tenth of all
    assert 0.3 < weights[off_m < 2.0 * sigma_m].sum() < 0.9
    assert weights[off_m < 8.0 * sigma_m].sum() > 0.7
    # what stands on the ground: the aim is above the foot by 0.01 of the distance
    above = CalibratedFilter.alone(20_000, np.random.default_rng(0))
    above.start(exact, tight, ground_prior(FlatGround(0.0, 3.0, slope=0.0), camera_m, 0.01))
    distance_m = float(np.hypot(*(above.cloud.mean_enu_m - camera_m)[:2]))
    assert distance_m == pytest.approx(height_m / (np.tan(angle) + 0.01), rel=0.02)
    assert ground_prior(NoGround(), camera_m, 0.0) is None


# the wrong compass: what the filter is for


def reported(seed: int) -> tuple[FloatArray, list[Sight]]:
    """A point, and the sights of 60 steps past it: a pixel noise of 2 px, errors that last."""
    sights = []
    rng = np.random.default_rng([5, seed])
    range_m = float(np.exp(rng.uniform(np.log(700.0), np.log(4000.0))))
    point_m = np.array([0.0, range_m, 100.0])
    flight = flight_past("perpendicular", point_m, range_m, 0.5 * range_m, step_m=0.5 * range_m / 60.0)
    noise = CorrelatedPoseErrors(CorrelatedSigmas(), rng)
    variance = (2.0 / 1200.0) ** 2 + ERRORS.attitude_white_rad**2 + (0.3 / range_m) ** 2
    for stamp_s in flight.stamps_s:
        true: CameraPose = flight.pose_at(float(stamp_s))
        pose = noise.reported(flight.pose_at, float(stamp_s))
        pixel = CAMERA.project((true.R_cam_from_enu @ (point_m - true.position_enu_m))[:, None])[0]
        ray = pose.R_cam_from_enu.T @ CAMERA.rays(pixel + 2.0 * rng.standard_normal((2, 1)))[:, 0]
        base = sight(ray, pose.position_enu_m, float(stamp_s))
        sights.append(replace(base, covariance=variance * np.eye(2)))
    return point_m, sights


def end_of_flight(seed: int, errors: PoseErrors) -> tuple[float, float, bool]:
    """Error as a share of the range, NEES on the map, and whether the 95 % ellipse holds the point."""
    one = CalibratedFilter.alone(5000, np.random.default_rng([6, seed]))
    point_m, sights = reported(seed)
    one.start(sights[0], errors)
    for seen in sights[1:]:
        one.predict(seen.stamp_s, errors)
        one.update(seen)
    offset_m = (point_m - one.cloud.mean_enu_m)[:2]
    covariance_m2 = one.cloud.covariance_enu_m2[:2, :2]
    points_m, weights = weighted_positions(one)
    ellipse = weighted_ellipse(points_m[:2] - one.cloud.mean_enu_m[:2, None], weights, covariance_m2, 0.95)
    nees = float(offset_m @ np.linalg.solve(covariance_m2, offset_m))
    return float(np.linalg.norm(offset_m) / point_m[1]), nees, ellipse_holds(ellipse, offset_m)


def test_the_ellipse_is_true_under_a_wrong_compass_and_a_filter_blind_to_it_is_not() -> None:
    seeds = range(100)
    errors, nees, holds = np.array([end_of_flight(seed, ERRORS) for seed in seeds]).T
    # the bounds are 3 standard errors: of a mean of chi-squares with 2 degrees of freedom (each 2), of a binomial
    assert 2.0 - 3 * 0.2 < nees.mean() < 2.0 + 3.5 * 0.2
    assert 0.95 - 3.5 * np.sqrt(0.95 * 0.05 / 100) < holds.mean() < 1.0
    # the Cramer-Rao bound of these flights, distloc.study.bound: 6.3 % of the range
    assert 0.9 * 0.063 < np.sqrt(np.mean(errors**2)) < 1.35 * 0.063
    blind = replace(ERRORS, heading_bias_rad=1e-6, tilt_bias_rad=1e-6)
    blind_errors, blind_nees, blind_holds = np.array([end_of_flight(seed, blind) for seed in seeds[:40]]).T
    assert blind_holds.mean() < 0.1
    assert np.median(blind_nees) > 100.0
    assert np.median(blind_errors) > 1.2 * np.median(errors)


SHIFTS_M = (0.0, 150.0, 300.0, 450.0)


def from_bank(place: int, seed: int, n: int) -> list[FloatArray]:
    """Means of a filter alone that has the random numbers of one at a place of a bank."""
    bank = Bank(1, n, np.random.default_rng(0), (50.0, 30_000.0))
    rng = np.random.default_rng(seed).spawn(len(SHIFTS_M))[place]
    bank._rngs[0] = bank.particles._rngs[0] = rng
    return flown(CalibratedFilter(bank, 0), SHIFTS_M[place])


def flown(one: CalibratedFilter, shift_m: float) -> list[FloatArray]:
    one.start(seen_from(0, shift_m), ERRORS, aim_sigma_rad=AIM_RAD)
    means = []
    for k in range(1, 20):
        one.predict(float(k), ERRORS)
        one.turn(np.full(2, 0.9), AIM_RAD)
        one.update(seen_from(k, shift_m))
        means.append(one.cloud.mean_enu_m)
    return means


def seen_from(k: int, shift_m: float) -> Sight:
    camera_m = np.array([25.0 * k, 0.0, 0.0])
    return sight(np.array([shift_m, 2000.0, 0.0]) - camera_m, camera_m, float(k))


@pytest.mark.parametrize(("n", "places"), [(1000, [0, 1, 2, 3]), (4096, [0, 1, 3]), (20_000, [1, 2])])
def test_targets_of_a_bank_do_not_disturb_one_another(n: int, places: list[int]) -> None:
    """Stepped together, with free places between them, they are what each is alone."""
    bank = Bank(len(SHIFTS_M), n, np.random.default_rng(7), (50.0, 30_000.0))
    at = np.array(places)
    for place in places:
        bank.start(place, seen_from(0, SHIFTS_M[place]), ERRORS, aim_sigma_rad=AIM_RAD)
    means = []
    for k in range(1, 20):
        bank.predict(at, float(k), ERRORS)
        bank.turn(at, np.full((at.size, 2), 0.9), np.tile(AIM_RAD, (at.size, 1)))
        bank.update(at, Sights.of([seen_from(k, SHIFTS_M[place]) for place in places]))
        means.append(bank.particles.clouds.mean_enu_m[at])
    for index, place in enumerate(places):
        for together, alone in zip(means, from_bank(place, 7, n), strict=True):
            assert together[index] == pytest.approx(alone, rel=1e-6, abs=1e-3)
    free = [place for place in range(len(SHIFTS_M)) if place not in places]
    assert not bank.particles.x[free].any() and not bank.particles.weights[free].any()


def test_of_each_aims_error_a_share_of_its_own_is_kept_and_grows_or_not() -> None:
    bank, at = Bank(3, 500, np.random.default_rng(7), (50.0, 30_000.0)), np.array([0, 2])
    for place in (0, 2):
        bank.start(place, seen_from(0, 0.0), ERRORS, aim_sigma_rad=np.array([0.008, 0.004]))
    P, scale = bank.P.copy(), bank.particles.scale.copy()
    kept = np.array([[0.5, 0.9], [0.2, 0.9]])
    bank.turn(at, kept, np.full((2, 2), 0.008), np.array([[True, True], [True, False]]))
    share = np.array([[0.5, 0.9 * 2.0], [0.2, 0.9]])  # the second twice as large, where it grows
    assert bank.particles.scale[at, 3:] == pytest.approx(share * scale[at, 3:])
    new = 0.008**2 - np.square(share * [0.008, 0.004])
    assert np.diagonal(bank.P[at, 3:, 3:], axis1=1, axis2=2) == pytest.approx(
        np.square(share) * np.diagonal(P[at, 3:, 3:], axis1=1, axis2=2) + new
    )
    assert (bank.aim_sigma_rad[at] == 0.008).all()


def test_in_a_step_few_are_drawn_anew_and_others_wait_unless_few_particles_are_left() -> None:
    n = 20_000
    particles = Particles(3, n, np.random.default_rng(0).spawn(3))
    axes = np.tile(np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, 1.0, 0.0]]), (3, 1, 1))

    def drawn(*shares: float) -> list[bool]:
        """Which are drawn in one step, where so large a share of the particles has all of the weight."""
        particles.begin_step()
        particles.x[:] = np.random.default_rng(0).normal(0.0, 5.0, particles.x.shape)
        particles.x[:, 1] += 2000.0
        particles.weights[:] = np.arange(n) < n * np.array(shares)[:, None]
        particles.measure(np.arange(3))
        particles.resample_where_few(np.arange(3), axes, np.zeros(3))
        return [bool((one == one[0]).all()) for one in particles.weights]

    assert drawn(0.6, 0.4, 0.4) == [False, True, False]
    assert drawn(0.6, 0.6, 0.4) == [False, False, True]
    assert drawn(0.4, 0.1, 0.2) == [True, True, False]
