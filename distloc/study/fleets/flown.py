"""Fleets whose drones are flown: the real localizer on simulated flights from several sides, fused as drawn ones are.

It shows whether the drawn reports are a fair model. Each drone flies a case of `study coverage` about the same middle.
One in eight has a compass that is worse than its localizer is told.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from distloc.batch.fusion.claims import Claim
from distloc.batch.fusion.shared import shared_part
from distloc.filter.settings import ENOUGH_PARTICLES
from distloc.filter.uncertainty import CHI2_95
from distloc.localizer import Localizer
from distloc.simulation.flights import Geometry
from distloc.study.coverage.cases import CoverageCase
from distloc.study.coverage.staging import STEPS, Run, staged
from distloc.study.fleets.fleet import SHARED_M, STEP_S, WORSE, WORSE_BY
from distloc.study.fleets.score import FleetScore, score
from distloc.study.methods import told_config
from distloc.study.runner import run_all
from distloc.study.scenes import PAPER_CAMERA
from distloc.types import Ellipse, FloatArray, TargetEstimate, TargetState

_GEOMETRIES: tuple[Geometry, ...] = ("perpendicular", "oblique", "orbit")
_SURE = (TargetState.CONFIRMED, TargetState.COASTING)
_LATE = 15  # frames by which one drone may begin after another
_RANGE_M = (1_000.0, 3_000.0)


@dataclass(frozen=True, slots=True)
class _Said:
    """A claim and the true fire that it is of."""

    claim: Claim
    fire: int


def fly_all(fleets: int, jobs: int, seed: int, on_done: Callable[[int], None] = lambda done: None) -> list[FleetScore]:
    """Fleets seeded `seed`, `seed` + 1 and so on."""
    return run_all(flown, range(seed, seed + fleets), jobs, on_done)


def flown(seed: int) -> FleetScore:
    """One fleet of two to four, about one fire or, every other seed, two that are 300 m apart."""
    rng = np.random.default_rng([seed, 22])
    count = 1 + seed % 2
    shared = SHARED_M * rng.normal(size=2)
    by_step: list[list[_Said]] = [[] for _ in range(STEPS + _LATE + 1)]
    turns = rng.uniform(0.0, 2.0 * np.pi, int(rng.integers(2, 5)))
    if count > 1:  # the fires of a case stand across its first line of sight: from there or from behind
        turns = np.where(turns < np.pi, 0.0, np.pi)
    has_worse = False
    for number, turn in enumerate(turns, start=1):
        worse = float(rng.uniform(*WORSE_BY)) if rng.random() < WORSE else 1.0
        has_worse |= worse > 1.0
        classes = ("constant", "scenery") if worse == 1.0 else ("constant",)  # the scenery would tell
        case = CoverageCase(
            geometry=_GEOMETRIES[int(rng.integers(len(_GEOMETRIES)))],
            error_class=classes[int(rng.integers(len(classes)))],
            targets=count,
            range_m=_RANGE_M,
        )
        run = Run(case, 1000 * seed + number, ENOUGH_PARTICLES)
        own = _fly(f"drone{number}", run, worse, float(turn), shared)
        late = int(rng.integers(_LATE))
        for index in range(late, len(by_step)):
            by_step[index] += own[min(index - late, len(own) - 1)]
    truths = np.zeros((1, 2)) if count == 1 else np.array([[-150.0, 0.0], [150.0, 0.0]])
    truth = {said.claim.name: said.fire for step in by_step for said in step}
    told = [(index * STEP_S, [said.claim for said in step]) for index, step in enumerate(by_step) if step]
    return score(told, truth, truths, has_worse)


def _fly(name: str, run: Run, worse: float, turn_rad: float, shared_m: FloatArray) -> list[list[_Said]]:
    """What it has confirmed at each step; its compass errs `worse` times as much as its localizer is told."""
    stage = staged(run)
    errors = run.case.pose_errors
    told = told_config(replace(errors, heading_bias_rad=errors.heading_bias_rad / worse), run.n_particles)
    localizer = Localizer(PAPER_CAMERA, told, rng=stage.filter_rngs[0])
    middle = stage.scene.truths_enu_m[:2].mean(axis=1)
    c, s = math.cos(turn_rad), math.sin(turn_rad)
    R = np.array([[c, -s], [s, c]])
    truths = (R @ (stage.scene.truths_enu_m[:2] - middle[:, None])).T
    truths = truths[np.argsort(truths[:, 0])]  # the fires' order in the fleet's frame
    steps = []
    for sample, corners in stage.frames:
        found = localizer.step(sample.pose, sample.mask, corners)
        steps.append([_said(name, one, R, middle, shared_m, truths) for one in found if one.state in _SURE])
    return steps


def _said(
    name: str, one: TargetEstimate, R: FloatArray, middle: FloatArray, shared_m: FloatArray, truths: FloatArray
) -> _Said:
    position = R @ (one.position_enu_m[:2] - middle)
    fire = int(np.linalg.norm(truths - position, axis=1).argmin())
    covariance = R @ _covariance(one.ellipse95) @ R.T
    shared = shared_part(covariance)
    bearing_rad = one.bearing_rad - math.atan2(R[1, 0], R[0, 0])
    claim = Claim(f"{name}/{one.id}", name, position + shared_m, covariance, shared, bearing_rad, one.range_m)
    return _Said(claim, fire)


def _covariance(ellipse: Ellipse) -> FloatArray:
    along = np.array([math.sin(ellipse.azimuth_rad), math.cos(ellipse.azimuth_rad)])
    major, minor = ellipse.semi_major_m**2, ellipse.semi_minor_m**2
    return np.asarray((minor * np.eye(2) + (major - minor) * np.outer(along, along)) / CHI2_95)
