from collections.abc import Sequence

import numpy as np
import pytest

from distloc.geometry.camera import Camera
from distloc.simulation.flights import paper_flight
from distloc.simulation.mask_noise import MaskNoise
from distloc.simulation.plume import Plume
from distloc.simulation.pose_noise import CorrelatedPoseErrors, CorrelatedSigmas, NoPoseNoise, UniformPoseNoise
from distloc.simulation.sequences import Sample, simulate_sequence
from distloc.simulation.targets import Box, DriftingPlume, Target
from distloc.types import CameraPose
from tests.support.cube_samples import CUBE_ENU_M, cube_mask, pose_at

CAMERA = Camera(480, 270, 300.0, 300.0, 239.5, 134.5)
FLIGHT = paper_flight(100.0)
CUBE = Box(CUBE_ENU_M)
SMOKE = DriftingPlume(Plume(np.array([0.0, 2000.0, -300.0]), 150.0, 80.0, np.array([4.0, 0.0, 0.0])))
NOISE = MaskNoise(0.5, 0.2, 3, 0.1, 0.3, 0.2)


def clean(*targets: Target) -> list[Sample]:
    return list(simulate_sequence(CAMERA, FLIGHT, targets, MaskNoise(), NoPoseNoise(), np.random.default_rng(0)))


def noisy(seed: int) -> list[Sample]:
    rng = np.random.default_rng(seed)
    return list(simulate_sequence(CAMERA, FLIGHT, [CUBE], NOISE, UniformPoseNoise(0.01, 1.0, rng), rng))


def same_pose(one: CameraPose, other: CameraPose) -> bool:
    return (
        one.stamp_s == other.stamp_s
        and np.array_equal(one.position_enu_m, other.position_enu_m)
        and np.array_equal(one.R_cam_from_enu, other.R_cam_from_enu)
    )


def same(one: Sequence[Sample], other: Sequence[Sample]) -> bool:
    return all(
        same_pose(a.pose, b.pose) and np.array_equal(a.mask, b.mask) and same_pose(a.true_pose, b.true_pose)
        for a, b in zip(one, other, strict=True)
    )


@pytest.mark.parametrize("target", [CUBE, SMOKE], ids=["cube", "smoke"])
def test_without_noise_a_sample_is_the_truth(target: Target) -> None:
    samples = clean(target)
    assert [sample.pose.stamp_s for sample in samples] == FLIGHT.stamps_s.tolist()
    for sample in samples:
        expected = np.zeros((270, 480), dtype=np.uint8)
        target.draw(expected, CAMERA, sample.true_pose)
        assert np.count_nonzero(expected) > 50
        assert np.array_equal(sample.mask, expected)
        assert same_pose(sample.pose, sample.true_pose)
        assert same_pose(sample.true_pose, FLIGHT.pose_at(sample.pose.stamp_s))


def test_the_papers_sequence_has_the_papers_masks() -> None:
    full = Camera(1920, 1080, 1200.0, 1200.0, 959.5, 539.5)
    samples = simulate_sequence(full, FLIGHT, [CUBE], MaskNoise(), NoPoseNoise(), np.random.default_rng(0))
    for step, sample in enumerate(samples):
        assert np.array_equal(sample.mask, cube_mask(pose_at(100.0 * step)))


def test_with_noise_the_true_pose_stays_the_truth() -> None:
    samples = noisy(0)
    assert len(samples) == 11
    for sample in samples:
        assert same_pose(sample.true_pose, FLIGHT.pose_at(sample.true_pose.stamp_s))
        assert sample.pose.stamp_s == sample.true_pose.stamp_s
        assert 1e-3 < np.linalg.norm(sample.pose.position_enu_m - sample.true_pose.position_enu_m) < 30.0
    wrong = [not np.array_equal(one.mask, perfect.mask) for one, perfect in zip(samples, clean(CUBE), strict=True)]
    assert 5 <= sum(wrong) <= 11


def test_a_time_offset_moves_the_pose_and_not_the_mask() -> None:
    sigmas = CorrelatedSigmas(0.0, 0.0, 0.0, 0.0, 0.0, 0.5)
    errors = CorrelatedPoseErrors(sigmas, np.random.default_rng(0))
    samples = list(simulate_sequence(CAMERA, FLIGHT, [CUBE], MaskNoise(), errors, np.random.default_rng(0)))
    for sample, perfect in zip(samples, clean(CUBE), strict=True):
        assert np.array_equal(sample.mask, perfect.mask)
        late_m = sample.true_pose.position_enu_m - sample.pose.position_enu_m
        assert late_m == pytest.approx([10.0 * errors.time_offset_s, 0.0, 0.0], abs=1e-9)


def test_the_same_seed_gives_the_same_sequence() -> None:
    assert same(noisy(3), noisy(3))
    assert not same(noisy(3), noisy(4))


def test_two_targets_both_appear() -> None:
    for both, cube, smoke in zip(clean(CUBE, SMOKE), clean(CUBE), clean(SMOKE), strict=True):
        assert cube.mask.any() and smoke.mask.any() and not (cube.mask & smoke.mask).any()
        assert np.array_equal(both.mask, cube.mask | smoke.mask)


def test_without_targets_the_masks_are_empty() -> None:
    assert not any(sample.mask.any() for sample in clean())


def test_masks_are_the_callers_to_keep() -> None:
    sequence = simulate_sequence(CAMERA, FLIGHT, [CUBE], MaskNoise(), NoPoseNoise(), np.random.default_rng(0))
    first = next(sequence)
    first.mask[:] = 255
    second = next(sequence)
    assert not np.shares_memory(first.mask, second.mask) and np.array_equal(second.mask, clean(CUBE)[1].mask)
