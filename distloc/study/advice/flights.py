"""Flights past a fire that go on as advised, and once more in a direction drawn by chance; what came of both.

The first part is the same in both: same seed, same errors, same filter. `study advice` calls it. The advice was tuned
on seeds under 1000; the study's own start at `SEED`.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from distloc.advice.advise import Advice, advise
from distloc.advice.ways import Craft, Ways, ways_along
from distloc.filter.uncertainty import ellipse_holds
from distloc.localizer import Localizer
from distloc.simulation.corners import corners_along
from distloc.simulation.mask_noise import MaskNoise
from distloc.simulation.pose_noise import CorrelatedPoseErrors
from distloc.simulation.sequences import simulate_sequence
from distloc.simulation.targets import Box
from distloc.study.advice.paths import STEP_S, LookingFlight, end_s
from distloc.study.coverage.cases import ERROR_CLASSES, SCENERY, CoverageCase
from distloc.study.coverage.staging import generators
from distloc.study.methods import told_config
from distloc.study.runner import run_all
from distloc.study.scenes import PAPER_CAMERA
from distloc.types import FloatArray, TargetEstimate

SEED = 72_000
KINDS = ("nose", "gimbal", "course")  # how the camera is kept on the target, or not
ERRORS = ("drifting", "wandering", "compass", "scenery")
_HEIGHT_M, _TARGET_HEIGHT_M = 120.0, 150.0
_FIRST_S = (20.0, 40.0)  # of flight before the advice
_RANGE_M = (700.0, 4000.0)
_HALF_VIEW_RAD = float(np.arctan2(0.4 * PAPER_CAMERA.width, PAPER_CAMERA.fx))


@dataclass(frozen=True, slots=True)
class AdviceRun:
    """One case, drawn by its seed alone."""

    seed: int
    n_particles: int = 4096

    @property
    def kind(self) -> str:
        """How the camera looks."""
        return KINDS[self.seed % len(KINDS)]

    @property
    def error_class(self) -> str:
        """Of the poses' errors."""
        return ERRORS[self.seed // len(KINDS) % len(ERRORS)]

    @property
    def craft(self) -> Craft:
        """That flies it."""
        craft = Craft(half_view_rad=_HALF_VIEW_RAD, keeps_target=self.kind != "course")
        return replace(craft, has_gimbal=self.kind == "gimbal")


@dataclass(frozen=True, slots=True)
class Flown:
    """A target's half-length after a way, infinite where it was lost, and whether the ellipse held the truth."""

    half_length_m: float
    is_inside: bool


@dataclass(frozen=True, slots=True)
class AdviceResult:
    """One case. `advice` is None where nothing was worth flying, or no target was reported by then (`is_seen`)."""

    run: AdviceRun
    range_m: float
    is_seen: bool
    half_before_m: float = np.inf
    advice: Advice | None = None
    advised: Flown | None = None
    by_chance: Flown | None = None


def fly_all(runs: int, jobs: int, seed: int, on_done: Callable[[int], None] = lambda _: None) -> list[AdviceResult]:
    """Seeded `seed`, `seed` + 1 and so on."""
    return run_all(fly, [AdviceRun(seed + number) for number in range(runs)], jobs, on_done)


def fly(run: AdviceRun) -> AdviceResult:
    """One case: the first part, the advice, then the whole again with either way after it."""
    rng = np.random.default_rng([31, run.seed])
    range_m = float(np.exp(rng.uniform(*np.log(_RANGE_M))))
    truth = np.array([0.0, range_m, _TARGET_HEIGHT_M])
    craft, first_s = run.craft, float(rng.uniform(*_FIRST_S))
    widest = _HALF_VIEW_RAD if run.kind == "course" else np.pi
    course_rad = float(rng.choice([-1.0, 1.0]) * rng.uniform(0.3 * _HALF_VIEW_RAD, 0.9 * widest))
    first_m = round(first_s) * craft.speed_mps
    corners = np.array([[0.0, 0.0], [first_m * np.sin(course_rad), first_m * np.cos(course_rad)]])
    localizer, estimate = _fly_on(run, corners, truth, round(first_s))
    if estimate is None:
        return AdviceResult(run, range_m, False)
    outlook = localizer.outlook(estimate.id)
    half_m = estimate.ellipse95.semi_major_m
    advice = None if outlook is None else advise(outlook, craft, half_m)
    if advice is None or outlook is None:
        return AdviceResult(run, range_m, True, half_m)
    about_en_m = float(np.median(outlook.ranges_m)) * outlook.axes[2, :2]
    turned = np.array([_side(advice) * advice.length_m / max(float(np.hypot(*about_en_m)), 1.0)])
    way = ways_along(np.array([advice.heading_rad]), np.array([advice.length_m]), turned, about_en_m)
    chance = ways_along(np.array([rng.uniform(0.0, 2.0 * np.pi)]), np.array([advice.length_m]), np.zeros(1), about_en_m)
    flown = [_after(run, corners, truth, one, estimate) for one in (way, chance)]
    return AdviceResult(run, range_m, True, half_m, advice, *flown)


def _side(advice: Advice) -> float:
    if advice.kind == "leg":
        return 0.0
    return 1.0 if advice.turns_right else -1.0


def _after(run: AdviceRun, corners: FloatArray, truth: FloatArray, way: Ways, before: TargetEstimate) -> Flown:
    """What is told of the target after a way more."""
    whole = np.concatenate([corners, corners[-1] + way.places_m[0]])
    craft = run.craft
    _, estimate = _fly_on(run, whole, truth, end_s(craft, whole), before.id)
    if estimate is None:
        return Flown(np.inf, False)
    offset = (truth - estimate.position_enu_m)[:2]
    return Flown(estimate.ellipse95.semi_major_m, ellipse_holds(estimate.ellipse95, offset))


def _fly_on(
    run: AdviceRun, corners: FloatArray, truth: FloatArray, until_s: float, wanted: int | None = None
) -> tuple[Localizer, TargetEstimate | None]:
    """The flight from its start; what is told at its end of the target of a number, else of that seen first."""
    case = CoverageCase("perpendicular", run.error_class)
    stamps_s = np.arange(0.0, until_s + 0.5 * STEP_S, STEP_S)
    flight = LookingFlight(run.craft, corners, _HEIGHT_M, truth, stamps_s)
    pose_rng, mask_rng, filter_rng, _, corner_rng = generators(run.seed)
    errors = CorrelatedPoseErrors(ERROR_CLASSES[run.error_class], pose_rng)
    localizer = Localizer(PAPER_CAMERA, told_config(case.pose_errors, run.n_particles), rng=filter_rng)
    # about its start alone: a landscape must not tell where it will fly
    about = replace(flight, stamps_s=stamps_s[:1])
    followed = corners_along(PAPER_CAMERA, about, corner_rng) if run.error_class in SCENERY else None
    estimates: list[TargetEstimate] = []
    for sample in simulate_sequence(PAPER_CAMERA, flight, [Box(truth)], MaskNoise(), errors, mask_rng):
        estimates = localizer.step(
            sample.pose, sample.mask, followed.at(sample.true_pose) if followed is not None else None
        )
    if wanted is not None:
        return localizer, next((one for one in estimates if one.id == wanted), None)
    return localizer, min(estimates, key=lambda one: one.first_seen_s, default=None)
