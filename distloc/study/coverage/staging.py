"""A coverage case's flight before it is flown: path, frames, corners of the scenery and random numbers, by a seed."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from distloc.scenery.corners import Corners
from distloc.simulation.corners import corners_along
from distloc.simulation.flights import Flight, Geometry, flight_past
from distloc.simulation.mask_noise import MaskNoise
from distloc.simulation.pose_noise import CorrelatedPoseErrors
from distloc.simulation.sequences import Sample, simulate_sequence
from distloc.simulation.targets import Box
from distloc.study.coverage.cases import ERROR_CLASSES, SCENERY, CoverageCase
from distloc.study.scenes import NOISES, PAPER_CAMERA
from distloc.types import CameraPose, FloatArray

STEPS = 60
_APART_M = 300.0
_CAMERA_HEIGHT_M, _TARGET_HEIGHT_M = 120.0, 150.0
_LENGTHS: Mapping[Geometry, float] = {"head-on": 0.7, "orbit": 1.5}  # of the range; 1 for the others


@dataclass(frozen=True, slots=True)
class Run:
    """One flight of a case, seeded by `seed` alone: cases of one seed share their errors as far as they can."""

    case: CoverageCase
    seed: int
    n_particles: int = 100_000


@dataclass(frozen=True, slots=True)
class Scene:
    """What is flown past what: the targets' true places are (3, K)."""

    flight: Flight
    truths_enu_m: FloatArray


@dataclass(frozen=True, slots=True)
class Stage:
    """A flight before it is flown: frames with the scenery's corners, where the case has them; two generators."""

    scene: Scene
    frames: Iterator[tuple[Sample, Corners | None]]
    filter_rngs: tuple[np.random.Generator, np.random.Generator]


def scene_of(run: Run) -> Scene:
    """The range is the seed's."""
    case = run.case
    low, high = np.log(case.range_m)
    range_m = float(np.exp(np.random.default_rng([9, run.seed]).uniform(low, high)))
    across_m = _APART_M * (np.arange(case.targets) - (case.targets - 1) / 2.0)
    truths = np.stack([across_m, np.full(case.targets, range_m), np.full(case.targets, _TARGET_HEIGHT_M)])
    middle = np.array([0.0, range_m, _TARGET_HEIGHT_M])
    length_m = _LENGTHS.get(case.geometry, 1.0) * range_m
    step_m = length_m / STEPS
    flight = flight_past(case.geometry, middle, range_m, length_m, step_m, _CAMERA_HEIGHT_M, case.wobble_rad, run.seed)
    aside_rad = np.radians(case.aside_deg)  # about the origin, past which or from which all paths go
    clockwise = np.array([[np.cos(aside_rad), np.sin(aside_rad)], [-np.sin(aside_rad), np.cos(aside_rad)]])
    return Scene(flight, np.concatenate([clockwise @ truths[:2], truths[2:]]))


def staged(run: Run) -> Stage:
    """A flight, its frames in the order of time, and what seeds the filters."""
    scene, case = scene_of(run), run.case
    pose_rng, mask_rng, first_rng, second_rng, corner_rng = generators(run.seed)
    poses = CorrelatedPoseErrors(ERROR_CLASSES[case.error_class], pose_rng)
    masks = NOISES["pfn"].mask if case.clutter else MaskNoise()
    boxes = [Box(truth) for truth in scene.truths_enu_m.T]
    samples = simulate_sequence(PAPER_CAMERA, scene.flight, boxes, masks, poses, mask_rng)
    followed = corners_along(PAPER_CAMERA, scene.flight, corner_rng) if case.error_class in SCENERY else None
    frames = ((sample, followed.at(sample.true_pose) if followed else None) for sample in samples)
    return Stage(scene, frames, (first_rng, second_rng))


def generators(seed: int) -> list[np.random.Generator]:
    """Of a run's poses, masks, first and second filter, and corners."""
    return [np.random.Generator(np.random.SFC64(one)) for one in np.random.SeedSequence([77, seed]).spawn(5)]


def travelled_m(poses: Sequence[CameraPose]) -> FloatArray:
    """The camera's way along its path (T,)."""
    places_m = np.stack([pose.position_enu_m for pose in poses], axis=1)
    return np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(places_m, axis=1), axis=0))])
