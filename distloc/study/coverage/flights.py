"""Is the stated uncertainty true? The localizer on many flights past boxes, with a compass that is wrong for minutes.

Each run is flown twice on the same frames: by the calibrated filter, told how large the errors are, and by the same
filter told that the attitude has no bias (bias-blind). `study coverage` calls it. The filter was tuned on seeds 0 to
999; the study's own start at `SEED`, so that its figures are of flights that nobody tuned on.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from distloc.localizer import Localizer, LocalizerConfig
from distloc.simulation.sequences import Sample
from distloc.study.bound import position_bound
from distloc.study.coverage.cases import CoverageCase, bound_noise
from distloc.study.coverage.ledger import LIVING, Ledger, Track, in_state, of_targets
from distloc.study.coverage.staging import Run, Stage, staged, travelled_m
from distloc.study.methods import BIAS_BLIND_RAD, told_config
from distloc.study.runner import run_all
from distloc.study.scenes import PAPER_CAMERA
from distloc.types import FloatArray, TargetEstimate

SEED = 60_000


@dataclass(frozen=True, slots=True)
class FlightResult:
    """One run: what was flown (T,), the range that was drawn (K,), and bounds of the error on the map (K, T)."""

    travelled_m: FloatArray
    range_m: FloatArray
    bound_m: FloatArray
    calibrated: Track
    blind: Track


@dataclass(frozen=True, slots=True)
class ExplainedFlight:
    """One flight for a picture: the path (2, T) and what both filters said at its end, None where nothing."""

    path_en_m: FloatArray
    truth_en_m: FloatArray
    calibrated: TargetEstimate | None
    blind: TargetEstimate | None


def fly_all(
    cases: Sequence[CoverageCase],
    runs: int,
    jobs: int,
    seed: int = SEED,
    on_done: Callable[[int], None] = lambda done: None,
    n_particles: int = 100_000,
) -> list[list[FlightResult]]:
    """Each case's runs, seeded `seed`, `seed` + 1 and so on; `on_done` gets how many flights are done."""
    tasks = [Run(case, seed + number, n_particles) for case in cases for number in range(runs)]
    results = run_all(fly, tasks, jobs, on_done)
    return [results[index * runs : (index + 1) * runs] for index in range(len(cases))]


def fly(run: Run) -> FlightResult:
    """One flight by both filters."""
    stage = staged(run)
    scene = stage.scene
    ledgers = [Ledger(scene.truths_enu_m, scene.flight.stamps_s.size) for _ in range(2)]
    poses = []
    for sample, reports in _reports(run, stage):
        poses.append(sample.true_pose)
        for ledger, estimates in zip(ledgers, reports, strict=True):
            ledger.enter(estimates)
    bounds = [position_bound(PAPER_CAMERA, poses, truth, bound_noise(run.case)) for truth in scene.truths_enu_m.T]
    bounds_m = np.sqrt([np.trace(bound[:, :2, :2], axis1=1, axis2=2) for bound in bounds])
    return FlightResult(travelled_m(poses), scene.truths_enu_m[1], bounds_m, *(ledger.closed() for ledger in ledgers))


def explained_flight(seed: int = SEED, n_particles: int = 100_000) -> ExplainedFlight:
    """The perpendicular flight with errors that stay of this seed."""
    run = Run(CoverageCase("perpendicular"), seed, n_particles)
    stage = staged(run)
    truths_enu_m = stage.scene.truths_enu_m
    path: list[FloatArray] = []
    last: tuple[list[TargetEstimate], ...] = ([], [])
    for sample, reports in _reports(run, stage):
        path.append(sample.true_pose.position_enu_m[:2])
        last = reports
    calibrated, blind = (of_targets(in_state(reports, LIVING), truths_enu_m)[0] for reports in last)
    return ExplainedFlight(np.stack(path, axis=1), truths_enu_m[:2, 0], calibrated, blind)


def _reports(run: Run, stage: Stage) -> Iterator[tuple[Sample, tuple[list[TargetEstimate], ...]]]:
    """Each frame with what the calibrated and the bias-blind filter say after it; the corners are the first one's."""
    told = told_config(run.case.pose_errors, run.n_particles)
    calibrated, blind = (
        Localizer(PAPER_CAMERA, config, rng=rng)
        for config, rng in zip((told, _blinded(told)), stage.filter_rngs, strict=True)
    )
    for sample, corners in stage.frames:
        yield sample, (calibrated.step(sample.pose, sample.mask, corners), blind.step(sample.pose, sample.mask))


def _blinded(config: LocalizerConfig) -> LocalizerConfig:
    return replace(config, heading_bias_sigma_rad=BIAS_BLIND_RAD, tilt_bias_sigma_rad=BIAS_BLIND_RAD)
