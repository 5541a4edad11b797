"""The localizer on the same flights with and without the scenery's corners, told nothing but its defaults.

`study scenery` calls it. The filter and the compass were tuned on seeds under 1000; the study's own start at `SEED`.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from distloc.localizer import Localizer
from distloc.scenery.compass import CompassState
from distloc.simulation.corners import corners_along
from distloc.simulation.flights import Geometry
from distloc.simulation.sequences import Sample
from distloc.study.bound import position_bound
from distloc.study.coverage.cases import CoverageCase, bound_noise
from distloc.study.coverage.ledger import Ledger, Track
from distloc.study.coverage.staging import Run, generators, scene_of, staged, travelled_m
from distloc.study.methods import told_config
from distloc.study.runner import run_all
from distloc.study.scenery.bound import followed_on, scenery_bound
from distloc.study.scenes import PAPER_CAMERA
from distloc.types import FloatArray

SEED = 62_000
PARTICLES = 10_000
DRAWN_RANGE_M = 2000.0
GEOMETRIES_FLOWN: tuple[Geometry, ...] = ("perpendicular", "oblique", "orbit", "lawnmower")
_RANGES_M = (1000.0, DRAWN_RANGE_M, 4000.0)
_WOBBLE_RAD = 0.02
_BOUND_FLIGHTS = 2  # a bound is of one flight's corners; it differs little from one to the next


@dataclass(frozen=True, slots=True)
class SceneryFlight:
    """One flight of one target: the camera's way (T,), and what the localizer said of it without and with the corners.

    The heading's error (T,) is what was still wrong of it after the compass's correction, beside its told sigma (T,);
    NaN where the compass has none.
    """

    travelled_m: FloatArray
    range_m: float
    without: Track
    scenery: Track
    heading_error_rad: FloatArray
    heading_sigma_rad: FloatArray


@dataclass(frozen=True, slots=True)
class Bounds:
    """Least covariances on the map (T, 2, 2), of smoke alone and with the corners."""

    without_m2: FloatArray
    scenery_m2: FloatArray


def scenery_cases() -> list[CoverageCase]:
    """Every geometry at each range, and at the drawn one with a heading that is worse than told."""
    cases = [
        CoverageCase(geometry, "scenery", range_m=(range_m, range_m), wobble_rad=_WOBBLE_RAD)
        for geometry in GEOMETRIES_FLOWN
        for range_m in _RANGES_M
    ]
    drawn = (DRAWN_RANGE_M, DRAWN_RANGE_M)
    return cases + [
        CoverageCase(geometry, "scenery_worse", range_m=drawn, wobble_rad=_WOBBLE_RAD) for geometry in GEOMETRIES_FLOWN
    ]


def fly_all(
    cases: Sequence[CoverageCase],
    runs: int,
    jobs: int,
    seed: int = SEED,
    on_done: Callable[[int], None] = lambda done: None,
    n_particles: int = PARTICLES,
) -> list[list[SceneryFlight]]:
    """Each case's runs, seeded `seed`, `seed` + 1 and so on; `on_done` gets how many flights are done."""
    tasks = [Run(case, seed + number, n_particles) for case in cases for number in range(runs)]
    results = run_all(fly, tasks, jobs, on_done)
    return [results[index * runs : (index + 1) * runs] for index in range(len(cases))]


def bounds_of_all(cases: Sequence[CoverageCase], jobs: int, seed: int = SEED) -> list[Bounds]:
    """The mean of each case's bounds over its first flights."""
    tasks = [Run(case, seed + number) for case in cases for number in range(_BOUND_FLIGHTS)]
    found = run_all(bounds, tasks, jobs, lambda done: None)
    of_cases = (found[start : start + _BOUND_FLIGHTS] for start in range(0, len(found), _BOUND_FLIGHTS))
    return [
        Bounds(np.mean([one.without_m2 for one in ones], axis=0), np.mean([one.scenery_m2 for one in ones], axis=0))
        for ones in of_cases
    ]


def fly(run: Run) -> SceneryFlight:
    """One flight by both; with the corners by the first."""
    stage = staged(run)
    config = told_config(run.case.pose_errors, run.n_particles)
    with_corners, without = (Localizer(PAPER_CAMERA, config, rng=rng) for rng in stage.filter_rngs)
    steps = stage.scene.flight.stamps_s.size
    scenery_ledger, without_ledger = (Ledger(stage.scene.truths_enu_m, steps) for _ in range(2))
    poses, headings = [], []
    for sample, corners in stage.frames:
        poses.append(sample.true_pose)
        scenery_ledger.enter(with_corners.step(sample.pose, sample.mask, corners))
        without_ledger.enter(without.step(sample.pose, sample.mask))
        headings.append(_heading(sample, with_corners.compass.state))
    error_rad, sigma_rad = np.array(headings).T
    range_m = float(stage.scene.truths_enu_m[1, 0])
    return SceneryFlight(
        travelled_m(poses), range_m, without_ledger.closed(), scenery_ledger.closed(), error_rad, sigma_rad
    )


def bounds(run: Run) -> Bounds:
    """Of one flight, with the corners that it follows."""
    scene = scene_of(run)
    poses = [scene.flight.pose_at(float(stamp_s)) for stamp_s in scene.flight.stamps_s]
    *_, corner_rng = generators(run.seed)
    followed = followed_on(poses, corners_along(PAPER_CAMERA, scene.flight, corner_rng))
    truth, noise = scene.truths_enu_m[:, 0], bound_noise(run.case)
    without_m2 = position_bound(PAPER_CAMERA, poses, truth, noise)
    scenery_m2 = scenery_bound(PAPER_CAMERA, poses, truth, noise, followed)
    return Bounds(without_m2[:, :2, :2], scenery_m2[:, :2, :2])


def _heading(sample: Sample, state: CompassState | None) -> tuple[float, float]:
    """What is still wrong of the heading, and its told sigma, in radians."""
    if state is None:
        return np.nan, np.nan
    wrong, _ = cv2.Rodrigues(sample.pose.R_cam_from_enu.T @ sample.true_pose.R_cam_from_enu)
    return float(wrong[2, 0] - state.error_rad[2]), float(state.sigma_rad[2])
