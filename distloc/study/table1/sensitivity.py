"""Error and particle ratio against one setting at a time, the others as the paper has them: what a user must choose."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from distloc.simulation.flights import flight_past
from distloc.simulation.targets import Box
from distloc.study.curves import Summary, Task, bound_m, fly, stacked, summarised, translation_m
from distloc.study.methods import MethodSpec, bootstrap_spec, paper_methods, told_spec
from distloc.study.runner import run_all
from distloc.study.scenes import NOISES, PAPER_CAMERA, PAPER_TARGET_ENU_M, Noise, Scene, paper_scene
from distloc.study.table1.cells import is_counted


@dataclass(frozen=True, slots=True)
class SweepPoint:
    """What is flown at one value of one setting."""

    sweep: str
    unit: str
    value: float
    scene: Scene
    noise: Noise
    methods: tuple[MethodSpec, ...]


@dataclass(frozen=True, slots=True)
class SweepResult:
    """One method at one point, over the runs; the bound is the mean over the frames that count."""

    sweep: str
    unit: str
    value: float
    method: str
    summary: Summary
    bound_mean_m: float


def sweep_points() -> list[SweepPoint]:
    """All sweeps. Noise is the paper's last row, but for sigma_p, which is swept noiseless as well."""
    noise, paper = NOISES["pfn"], paper_methods()
    points = [
        SweepPoint("particles", "", n, paper_scene(), noise, (bootstrap_spec("PF", n), told_spec("RBPF", noise, n)))
        for n in (1_000, 3_000, 10_000, 30_000, 100_000, 300_000)
    ]
    for title, row in (("particle sigma", "pfn"), ("particle sigma, noiseless", "none")):
        points += [
            SweepPoint(
                title, "m", sigma_m, paper_scene(), NOISES[row], (bootstrap_spec("PF", particle_sigma_m=sigma_m),)
            )
            for sigma_m in (1.0, float(np.sqrt(5.0)), 5.0, 10.0, 20.0)
        ]
    points += [
        SweepPoint("step distance", "m", step_m, paper_scene(step_m), noise, paper)
        for step_m in (5.0, 10.0, 20.0, 50.0)
    ]
    points += [
        SweepPoint("range", "m", range_m, _at_range(range_m), noise, paper)
        for range_m in (500.0, 1000.0, 2000.0, 4000.0, 7000.0, 10_000.0)
    ]
    points += [
        SweepPoint("rotation noise", "deg", amplitude_deg, paper_scene(), _turned(noise, amplitude_deg), paper)
        for amplitude_deg in (0.0, 0.1, 0.25, 0.5, 1.0, 2.0)
    ]
    return points


def sensitivity(
    points: Sequence[SweepPoint],
    runs: int,
    jobs: int,
    seed: int,
    on_done: Callable[[int], None] = lambda done: None,
) -> list[SweepResult]:
    """Fly every point `runs` times; `on_done` gets how many of the points x runs flights are done."""
    tasks = [Task(point.scene, point.noise, point.methods, (seed, run)) for point in points for run in range(runs)]
    flights = run_all(fly, tasks, jobs, on_done)
    results = []
    for number, point in enumerate(points):
        counted = is_counted(translation_m(point.scene))
        mean_bound_m = float(bound_m(point.scene, point.noise)[counted].mean())
        of_point = flights[number * runs : (number + 1) * runs]
        for index, spec in enumerate(point.methods):
            summary = summarised(stacked([curves[index] for curves in of_point]), counted)
            results.append(SweepResult(point.sweep, point.unit, point.value, spec.name, summary, mean_bound_m))
    return results


def _at_range(range_m: float) -> Scene:
    target_enu_m = np.array([PAPER_TARGET_ENU_M[0], range_m, PAPER_TARGET_ENU_M[2]])
    flight = flight_past("perpendicular", target_enu_m, range_m, length_m=1000.0)
    return Scene(PAPER_CAMERA, flight, Box(target_enu_m))


def _turned(noise: Noise, amplitude_deg: float) -> Noise:
    return replace(noise, rotation_rad=float(np.radians(amplitude_deg)))
