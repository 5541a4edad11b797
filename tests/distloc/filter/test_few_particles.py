"""A few thousand particles are enough: they follow into the tail, and a narrow prior leaves enough of them."""

from dataclasses import replace

import numpy as np
import pytest

from distloc.filter.calibrated_filter import CalibratedFilter
from distloc.filter.ground import FlatGround, ground_prior
from distloc.filter.regularise import Kernel, bandwidth_of
from distloc.filter.settings import ENOUGH_PARTICLES
from distloc.geometry.rotations import matrix_from_rotation_vector
from distloc.sights.sight import Sight
from distloc.types import FloatArray, PoseErrors
from tests.distloc.filter.test_calibrated_filter import sight

LASTING = PoseErrors(float(np.radians(2.0)), float(np.radians(0.5)), float(np.radians(0.1)), 0.3, 1e6)
TARGET_M = np.array([0.0, 2000.0, 50.0])


def orbit(heading_sigmas: float, rng: np.random.Generator) -> list[Sight]:
    """Sights from 60 places on three quarters of a circle, with a heading that errs by so many of what is told."""
    R = matrix_from_rotation_vector(np.array([0.0, 0.0, heading_sigmas * LASTING.heading_bias_rad]))
    sights = []
    for k, angle in enumerate(np.linspace(0.0, 1.5 * np.pi, 60)):
        camera_m = TARGET_M + 2000.0 * np.array([-np.sin(angle), -np.cos(angle), 0.03])
        ray = R @ (TARGET_M - camera_m) / 2000.0 + 0.002 * rng.standard_normal(3)
        sights.append(replace(sight(ray, camera_m, float(k)), covariance=0.002**2 * np.eye(2)))
    return sights


def normalised_error(heading_sigmas: float, seed: int) -> float:
    """Squared, on the map, at the end: of two degrees of freedom where all is well."""
    sights = orbit(heading_sigmas, np.random.default_rng(seed))
    one = CalibratedFilter.alone(ENOUGH_PARTICLES, np.random.default_rng([1, seed]))
    one.start(sights[0], LASTING)
    for seen in sights[1:]:
        one.predict(seen.stamp_s, LASTING)
        one.update(seen)
    off_m = (one.cloud.mean_enu_m - TARGET_M)[:2]
    return float(off_m @ np.linalg.solve(one.cloud.covariance_enu_m2[:2, :2], off_m))


@pytest.mark.parametrize("heading_sigmas", [0.0, 2.0, -2.5])
def test_a_target_in_the_clouds_tail_is_found(heading_sigmas: float) -> None:
    found = [normalised_error(heading_sigmas, seed) for seed in range(6)]
    assert max(found) < 14.0  # more in one of 1,000 by chance


def test_the_kernel_is_the_wider_the_fewer_there_are() -> None:
    assert bandwidth_of(ENOUGH_PARTICLES) == pytest.approx(1.4 * 0.2952, abs=0.001)  # 0.9686 n^(-1/7)
    assert bandwidth_of(100_000) == pytest.approx(1.4 * 0.1870, abs=0.001)


def spread_by_kernel(tangents: FloatArray) -> FloatArray:
    """Right, up and logarithm of the depth (3, n) north of the origin, before and after a kernel."""
    north = np.exp(tangents[2])
    x = np.concatenate([[tangents[0] * north, north, tangents[1] * north], np.zeros((5, north.size))])
    particles = x.astype(np.float32)
    axes = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, 1.0, 0.0]])
    n = north.size
    scratch = tuple(np.empty((rows, n), np.float32) for rows in (3, 3, 5))
    kernel = Kernel.of(particles, axes, np.zeros(3), bandwidth_of(n))
    kernel.spread(particles, np.zeros(3), np.random.default_rng(0), (scratch[0], scratch[1], scratch[2]))
    east, north, up = particles[:3].astype(np.float64)
    return np.stack([east / north, up / north, np.log(north)])


def test_the_kernel_keeps_what_is_in_one_place_where_the_rest_is_anywhere() -> None:
    rng, n = np.random.default_rng(3), 8000
    tangents = np.stack([rng.normal(0.0, 0.02, n), rng.normal(0.0, 0.01, n), rng.normal(7.6, 0.02, n)])
    tangents[2, ::5] = rng.uniform(4.0, 10.0, n // 5)  # one in five
    after = spread_by_kernel(tangents)
    middle = np.percentile(after[2], [25, 75])
    assert np.diff(middle) < 1.3 * np.diff(np.percentile(tangents[2], [25, 75]))
    assert after.mean(axis=1) == pytest.approx(tangents.mean(axis=1), abs=0.03)
    assert after.std(axis=1) == pytest.approx(tangents.std(axis=1), rel=0.05)


def test_a_narrow_prior_leaves_enough_particles() -> None:
    camera_m = np.array([0.0, 0.0, 120.0])
    seen = replace(sight(np.array([0.0, 1000.0, -70.0]), camera_m), covariance=1e-6 * np.eye(2))
    known = replace(LASTING, heading_bias_rad=float(np.radians(0.1)), tilt_bias_rad=float(np.radians(0.1)))
    prior = ground_prior(FlatGround(50.0, 1.0, slope=0.0), camera_m, 0.0)
    distinct, ranges_m = [], []
    for seed in range(5):
        one = CalibratedFilter.alone(ENOUGH_PARTICLES, np.random.default_rng(seed))
        one.start(seen, known, prior)
        x, weights = one.bank.particles.sampled(np.array([0]), ENOUGH_PARTICLES)
        distinct.append(1.0 / float(np.square(weights).sum()))
        near = np.abs(x[0, 1] + one.bank.particles.origin_enu_m[0, 1] - 1000.0) < 100.0
        ranges_m.append(
            float(np.average((x[0, 1] + one.bank.particles.origin_enu_m[0, 1])[near], weights=weights[0, near]))
        )
    assert min(distinct) > 500
    assert np.std(ranges_m) < 3.0  # its own standard deviation is 28 m: no start is of a few particles
