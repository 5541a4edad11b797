"""Runs of the methods on a scene: error and particle ratio of each against the camera's translation."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from distloc.geometry.metrics import share_inside
from distloc.simulation.sequences import simulate_sequence
from distloc.study.bound import error_bound_m, position_bound
from distloc.study.methods import MethodSpec
from distloc.study.scenes import Noise, Scene
from distloc.types import FloatArray


@dataclass(frozen=True, slots=True)
class Curve:
    """One method on one flight or, stacked, on R flights: error and ratio (T,) or (R, T); NaN where there is none.

    The error is the distance in space between the estimate (the mean of the particles) and the target's centre.
    """

    error_m: FloatArray
    ratio: FloatArray


@dataclass(frozen=True, slots=True)
class Task:
    """One flight of the methods; `key` seeds it together with what the seed is."""

    scene: Scene
    noise: Noise
    methods: tuple[MethodSpec, ...]
    key: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class Summary:
    """Over R runs: the paper's figures, the root mean square error, and the share of steps with an estimate."""

    min_m: float
    mean_m: float
    rms_m: float
    ratio: float | None
    estimated: float


def fly(task: Task) -> list[Curve]:
    """A curve for each of the methods; all see the same frames, each has its own random numbers."""
    seeds = np.random.SeedSequence(list(task.key)).spawn(2 + len(task.methods))
    pose_rng, mask_rng = (np.random.Generator(np.random.SFC64(seed)) for seed in seeds[:2])
    camera, target = task.scene.camera, task.scene.target
    methods = [
        spec.make(camera, np.random.Generator(np.random.SFC64(seed)))
        for spec, seed in zip(task.methods, seeds[2:], strict=True)
    ]
    errors_m = np.full((len(methods), task.scene.flight.stamps_s.size), np.nan)
    ratios = np.full_like(errors_m, np.nan)
    poses = task.noise.pose_noise(pose_rng)
    frames = simulate_sequence(camera, task.scene.flight, [target], task.noise.mask, poses, mask_rng)
    for frame, sample in enumerate(frames):
        stamp_s = sample.true_pose.stamp_s
        for index, method in enumerate(methods):
            position_enu_m = method.step(sample.pose, sample.mask)
            if isinstance(position_enu_m, np.ndarray):
                errors_m[index, frame] = np.linalg.norm(position_enu_m - target.centre_enu_m(stamp_s))
            particles = method.particles_enu_m
            if particles is not None:
                ratios[index, frame] = share_inside(particles, target.is_inside(particles, stamp_s))
    return [Curve(error_m, ratio) for error_m, ratio in zip(errors_m, ratios, strict=True)]


def stacked(curves: Sequence[Curve]) -> Curve:
    """R flights (T,) as one curve (R, T)."""
    return Curve(np.stack([one.error_m for one in curves]), np.stack([one.ratio for one in curves]))


def translation_m(scene: Scene) -> FloatArray:
    """The camera's true distance (T,) from its start."""
    poses = [scene.flight.pose_at(float(stamp_s)) for stamp_s in scene.flight.stamps_s]
    return np.array([np.linalg.norm(pose.position_enu_m - poses[0].position_enu_m) for pose in poses])


def bound_m(scene: Scene, noise: Noise) -> FloatArray:
    """The Cramer-Rao bound (T,) of the error's root mean square under this noise."""
    poses = [scene.flight.pose_at(float(stamp_s)) for stamp_s in scene.flight.stamps_s]
    centre_enu_m = scene.target.centre_enu_m(poses[-1].stamp_s)
    return error_bound_m(position_bound(scene.camera, poses, centre_enu_m, noise.model))


def mean_over_runs(values: FloatArray) -> FloatArray:
    """Mean (T,) over the runs of (R, T) that have a value; NaN where fewer than half of them do."""
    has = np.isfinite(values)
    count = has.sum(axis=0)
    total = np.where(has, values, 0.0).sum(axis=0)
    return np.where(2 * count >= values.shape[0], total / np.maximum(count, 1), np.nan)


def summarised(curve: Curve, counts: np.ndarray[tuple[int], np.dtype[np.bool_]]) -> Summary:
    """Figures of R flights (R, T): means over the frames that count (T,), the minimum over all frames."""
    mean = mean_over_runs(curve.error_m)
    rms = np.sqrt(mean_over_runs(np.square(curve.error_m)))
    ratio = mean_over_runs(curve.ratio)[counts]
    return Summary(
        min_m=_least(mean),
        mean_m=_mean(mean[counts]),
        rms_m=_mean(rms[counts]),
        ratio=_mean(ratio) if np.isfinite(ratio).any() else None,
        estimated=float(np.isfinite(curve.error_m[:, counts]).mean()),
    )


def _mean(values: FloatArray) -> float:
    held = values[np.isfinite(values)]
    return float(held.mean()) if held.size else float("nan")


def _least(values: FloatArray) -> float:
    held = values[np.isfinite(values)]
    return float(held.min()) if held.size else float("nan")
