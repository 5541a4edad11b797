"""Is the stated uncertainty true? The localizer on many flights past boxes, with a compass that is wrong for minutes.

Each run is flown twice on the same frames: by the calibrated filter, told how large the errors are, and by the same
filter told that the attitude has no bias (bias-blind). `study coverage` calls it. The filter was tuned on seeds 0 to
999; the study's own start at `SEED`, so that its figures are of flights that nobody tuned on.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from distloc.localizer import Localizer, LocalizerConfig
from distloc.simulation.flights import GEOMETRIES, Flight, Geometry, flight_past
from distloc.simulation.mask_noise import MaskNoise
from distloc.simulation.pose_noise import CorrelatedPoseErrors, CorrelatedSigmas
from distloc.simulation.sequences import Sample, simulate_sequence
from distloc.simulation.targets import Box
from distloc.study.bound import NoiseModel, position_bound
from distloc.study.coverage.ledger import LIVING, Ledger, Track, in_state, of_targets
from distloc.study.methods import BIAS_BLIND_RAD, told_config
from distloc.study.runner import run_all
from distloc.study.scenes import BOX_CENTRE_PX, NOISES, PAPER_CAMERA
from distloc.types import FloatArray, PoseErrors, TargetEstimate

SEED = 60_000
STEPS = 60
POOLED: tuple[Geometry, ...] = ("perpendicular", "oblique", "head-on", "orbit")
_APART_M = 300.0
_CAMERA_HEIGHT_M, _TARGET_HEIGHT_M = 120.0, 150.0
_LENGTHS: Mapping[Geometry, float] = {"head-on": 0.7, "orbit": 1.5}  # of the range; 1 for the others
_FOR_GOOD_S = 1e5

ERROR_CLASSES: Mapping[str, CorrelatedSigmas] = {
    "constant": CorrelatedSigmas(tau_s=_FOR_GOOD_S),
    "drifting": CorrelatedSigmas(tau_s=600.0),
    "survey": CorrelatedSigmas(
        heading_bias_rad=float(np.radians(0.3)),
        tilt_bias_rad=float(np.radians(0.1)),
        attitude_white_rad=float(np.radians(0.05)),
        position_white_m=0.05,
        tau_s=_FOR_GOOD_S,
    ),
    "wandering": CorrelatedSigmas(tau_s=120.0),
    "compass": CorrelatedSigmas(
        heading_bias_rad=float(np.radians(2.0 * 0.5**0.5)),
        heading_iron_rad=float(np.radians(2.0 * 0.5**0.5)),
        tau_s=_FOR_GOOD_S,
    ),
}
_TOLD_NOTHING = ("wandering", "compass")  # the localizer takes what it flies with by default


@dataclass(frozen=True, slots=True)
class CoverageCase:
    """What is flown: `error_class` is one of `ERROR_CLASSES`, `clutter` the paper's last row of mask noise.

    The localizer is told how large the errors are and how long they last, but of those that wander or turn with the
    craft: there it takes what it flies with.

    The range is drawn log-uniform by the seed. Several `targets` stand 300 m apart across the first line of sight.
    """

    geometry: Geometry
    error_class: str = "constant"
    clutter: bool = False
    targets: int = 1
    range_m: tuple[float, float] = (700.0, 4000.0)

    def __post_init__(self) -> None:
        if self.geometry not in GEOMETRIES or self.error_class not in ERROR_CLASSES:
            raise ValueError(
                f"geometry must be one of {', '.join(GEOMETRIES)} and error_class one of {', '.join(ERROR_CLASSES)}, "
                f"got {self.geometry!r} and {self.error_class!r}"
            )
        if self.targets < 1 or not 0.0 < self.range_m[0] <= self.range_m[1]:
            raise ValueError(f"targets must be >= 1 and range_m rise above 0, got {self.targets} and {self.range_m}")

    @property
    def pose_errors(self) -> PoseErrors:
        """As the localizer is told."""
        sigmas = ERROR_CLASSES[self.error_class]
        if self.error_class in _TOLD_NOTHING:
            return replace(LocalizerConfig().pose_errors, position_m=sigmas.position_white_m)
        return PoseErrors(
            heading_bias_rad=sigmas.heading_bias_rad,
            tilt_bias_rad=sigmas.tilt_bias_rad,
            attitude_white_rad=sigmas.attitude_white_rad,
            position_m=sigmas.position_white_m,
            bias_time_constant_s=sigmas.tau_s,
        )


@dataclass(frozen=True, slots=True)
class FlightResult:
    """One run: what was flown (T,), the range that was drawn (K,), and bounds of the error on the map (K, T)."""

    travelled_m: FloatArray
    range_m: FloatArray
    bound_m: FloatArray
    calibrated: Track
    blind: Track


@dataclass(frozen=True, slots=True)
class Run:
    """One flight of a case, seeded by `seed` alone: cases of one seed share their errors as far as they can."""

    case: CoverageCase
    seed: int
    n_particles: int = 100_000


@dataclass(frozen=True, slots=True)
class ExplainedFlight:
    """One flight for a picture: the path (2, T) and what both filters said at its end, None where nothing."""

    path_en_m: FloatArray
    truth_en_m: FloatArray
    calibrated: TargetEstimate | None
    blind: TargetEstimate | None


def coverage_cases() -> list[CoverageCase]:
    """Every geometry with every class of errors, then clutter, the ranges' ends, and several fires at 2 km."""
    cases = [CoverageCase(geometry, name) for name in ERROR_CLASSES for geometry in GEOMETRIES]
    cases += [CoverageCase(geometry, clutter=True) for geometry in GEOMETRIES]
    cases += [CoverageCase("perpendicular", range_m=(range_m, range_m)) for range_m in (500.0, 10_000.0)]
    return cases + [
        CoverageCase("perpendicular", clutter=True, targets=count, range_m=(2000.0, 2000.0)) for count in range(1, 6)
    ]


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
    scene = _scene(run)
    ledgers = [Ledger(scene.truths_enu_m, scene.flight.stamps_s.size) for _ in range(2)]
    poses = []
    for sample, reports in _reports(run, scene):
        poses.append(sample.true_pose)
        for ledger, estimates in zip(ledgers, reports, strict=True):
            ledger.enter(estimates)
    places_m = np.stack([pose.position_enu_m for pose in poses], axis=1)
    travelled_m = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(places_m, axis=1), axis=0))])
    bounds = [position_bound(PAPER_CAMERA, poses, truth, _bound_noise(run.case)) for truth in scene.truths_enu_m.T]
    bounds_m = np.sqrt([np.trace(bound[:, :2, :2], axis1=1, axis2=2) for bound in bounds])
    return FlightResult(travelled_m, scene.truths_enu_m[1], bounds_m, *(ledger.closed() for ledger in ledgers))


def explained_flight(seed: int = SEED, n_particles: int = 100_000) -> ExplainedFlight:
    """The perpendicular flight with errors that stay of this seed."""
    run = Run(CoverageCase("perpendicular"), seed, n_particles)
    scene = _scene(run)
    path: list[FloatArray] = []
    last: tuple[list[TargetEstimate], ...] = ([], [])
    for sample, reports in _reports(run, scene):
        path.append(sample.true_pose.position_enu_m[:2])
        last = reports
    calibrated, blind = (of_targets(in_state(reports, LIVING), scene.truths_enu_m)[0] for reports in last)
    return ExplainedFlight(np.stack(path, axis=1), scene.truths_enu_m[:2, 0], calibrated, blind)


@dataclass(frozen=True, slots=True)
class _Scene:
    flight: Flight
    truths_enu_m: FloatArray  # (3, K)


def _scene(run: Run) -> _Scene:
    case = run.case
    low, high = np.log(case.range_m)
    range_m = float(np.exp(np.random.default_rng([9, run.seed]).uniform(low, high)))
    across_m = _APART_M * (np.arange(case.targets) - (case.targets - 1) / 2.0)
    truths = np.stack([across_m, np.full(case.targets, range_m), np.full(case.targets, _TARGET_HEIGHT_M)])
    middle = np.array([0.0, range_m, _TARGET_HEIGHT_M])
    length_m = _LENGTHS.get(case.geometry, 1.0) * range_m
    flight = flight_past(case.geometry, middle, range_m, length_m, length_m / STEPS, _CAMERA_HEIGHT_M)
    return _Scene(flight, truths)


def _reports(run: Run, scene: _Scene) -> Iterator[tuple[Sample, tuple[list[TargetEstimate], ...]]]:
    """Each frame with what the calibrated and the bias-blind filter say after it."""
    seeds = np.random.SeedSequence([77, run.seed]).spawn(4)
    pose_rng, mask_rng, *filter_rngs = (np.random.Generator(np.random.SFC64(seed)) for seed in seeds)
    told = told_config(run.case.pose_errors, run.n_particles)
    localizers = [
        Localizer(PAPER_CAMERA, config, rng=rng)
        for config, rng in zip((told, _blinded(told)), filter_rngs, strict=True)
    ]
    poses = CorrelatedPoseErrors(ERROR_CLASSES[run.case.error_class], pose_rng)
    masks = NOISES["pfn"].mask if run.case.clutter else MaskNoise()
    boxes = [Box(truth) for truth in scene.truths_enu_m.T]
    for sample in simulate_sequence(PAPER_CAMERA, scene.flight, boxes, masks, poses, mask_rng):
        yield sample, tuple(localizer.step(sample.pose, sample.mask) for localizer in localizers)


def _blinded(config: LocalizerConfig) -> LocalizerConfig:
    return replace(config, heading_bias_sigma_rad=BIAS_BLIND_RAD, tilt_bias_sigma_rad=BIAS_BLIND_RAD)


def _bound_noise(case: CoverageCase) -> NoiseModel:
    sigmas = ERROR_CLASSES[case.error_class]
    return NoiseModel(
        pixel_px=BOX_CENTRE_PX,
        rotation_white_rad=sigmas.attitude_white_rad,
        translation_white_m=sigmas.position_white_m,
        heading_bias_rad=float(np.hypot(sigmas.heading_bias_rad, sigmas.heading_iron_rad)),
        tilt_bias_rad=sigmas.tilt_bias_rad,
        tau_s=sigmas.tau_s,
        missed=NOISES["pfn"].mask.false_negative_rate if case.clutter else 0.0,
    )
