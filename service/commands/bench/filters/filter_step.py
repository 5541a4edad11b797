"""How a filter step's cost grows with its particles, how near it is to the machine's limit, what it allocates.

One target, the calibrated filter beside the paper's. The time to beat is that of reading and writing the state once.
"""

import tracemalloc
from collections.abc import Callable

import msgspec
import numpy as np

from distloc.filter.bootstrap_filter import BootstrapFilter
from distloc.filter.calibrated_filter import CalibratedFilter
from distloc.filter.settings import LocalizerConfig
from distloc.study.scenes import PAPER_CAMERA
from distloc.types import FloatArray, PoseErrors
from service.commands.bench.machine import Machine, once_ms
from service.commands.bench.scene import SIGMA_P_M, Seen, fly
from service.commands.bench.timing import Figure, figure, median_ms, ratio

COUNTS = (1_000, 10_000, 100_000, 1_000_000)
PAPER_COUNT = 100_000
_WARM_UP = 5  # frames flown before the flight that counts, with filters of their own


class StepCost(msgspec.Struct, frozen=True):
    """One number of particles; ratios are to the calibrated step. Null where there was no such step."""

    n_particles: int
    calibrated: Figure
    calibrated_ns_per_particle: float
    bootstrap: Figure
    bootstrap_ns_per_particle: float
    with_resampling: Figure | None
    without_resampling: Figure | None


class FilterCost(msgspec.Struct, frozen=True):
    """`at_limit` compares the calibrated step with reading and writing its state once, at `limit_particles`.

    Once at the bandwidth of a big array, and once at that of an array of the state's own size, which fits into a cache.
    The peak is what a step allocates by tracemalloc, the largest of a flight's.
    """

    steps: tuple[StepCost, ...]
    limit_particles: int
    state_bytes: int
    state_once_ms: float
    by_state_once: float
    state_once_in_cache_ms: float
    by_state_once_in_cache: float
    traced_peak_kb: float
    traced_steps: int


class Calibrated:
    """Our filter as a contender; `resampled` tells for each step whether it did."""

    def __init__(self, n_particles: int, seed: int = 0, errors: PoseErrors | None = None) -> None:
        self.filter = CalibratedFilter.alone(n_particles, np.random.Generator(np.random.SFC64(seed)))
        self.resampled: list[bool] = []
        self._errors = errors or LocalizerConfig().pose_errors

    @property
    def mean_enu_m(self) -> FloatArray:
        """(3,)."""
        return self.filter.cloud.mean_enu_m

    def begin(self, seen: Seen) -> None:
        """Start along the first sight."""
        self.filter.start(seen.sight, self._errors)

    def step(self, seen: Seen) -> None:
        """Predict and update."""
        self.filter.predict(seen.pose.stamp_s, self._errors)
        self.filter.update(seen.sight)

    def note(self, seen: Seen) -> None:
        """After a step: only a cloud that was just resampled has equal weights."""
        self.resampled.append(self.filter.cloud.effective > 0.999 * self.filter.bank.particles.n)


class Bootstrap:
    """The paper's filter as a contender; it makes its chamfer map itself, about what it can reach."""

    def __init__(self, n_particles: int, seed: int = 0) -> None:
        rng = np.random.Generator(np.random.SFC64(seed))
        self.filter = BootstrapFilter(PAPER_CAMERA, n_particles, SIGMA_P_M, rng)

    @property
    def mean_enu_m(self) -> FloatArray:
        """(3,)."""
        return np.asarray(self.filter.particles_enu_m.mean(axis=1))

    def begin(self, seen: Seen) -> None:
        """Start along the ray, and match."""
        self.filter.step(seen.pose, seen.mask)

    def step(self, seen: Seen) -> None:
        """Predict and update."""
        self.filter.predict()
        self.filter.update(seen.pose, seen.mask)


def measure_filter(
    machine: Machine,
    counts: tuple[int, ...] = COUNTS,
    number: int | None = None,
    on_step: Callable[[], None] = lambda: None,
) -> FilterCost:
    """Fly each count of particles, the paper's 100,000 (or else the largest) also against the machine's limit."""
    steps = tuple(_step_cost(count, number, on_step) for count in counts)
    limit_particles = PAPER_COUNT if PAPER_COUNT in counts else max(counts)
    at_limit = next(one.calibrated.median_ms for one in steps if one.n_particles == limit_particles)
    state = state_bytes(limit_particles)
    once, cached = once_ms(state, machine.memory_gb_per_s), once_ms(state, machine.state_sized_gb_per_s)
    peaks = _traced_peaks(limit_particles, number, on_step)
    return FilterCost(
        steps=steps,
        limit_particles=limit_particles,
        state_bytes=state,
        state_once_ms=once,
        by_state_once=ratio(at_limit, once),
        state_once_in_cache_ms=cached,
        by_state_once_in_cache=ratio(at_limit, cached),
        traced_peak_kb=round(max(peaks) / 1024.0, 1),
        traced_steps=len(peaks),
    )


def state_bytes(n_particles: int) -> int:
    """Of the calibrated filter's positions, nuisances and weights."""
    return CalibratedFilter.alone(n_particles, np.random.default_rng(0)).bank.particles.state_bytes


def _step_cost(n_particles: int, number: int | None, on_step: Callable[[], None]) -> StepCost:
    fly({"ours": Calibrated(n_particles), "bootstrap": Bootstrap(n_particles)}, _WARM_UP)
    ours, bootstrap = Calibrated(n_particles), Bootstrap(n_particles)

    def stepped(seen: Seen) -> None:
        ours.note(seen)
        on_step()

    times_s = fly({"ours": ours, "bootstrap": bootstrap}, number, stepped)
    unit_ms = median_ms(times_s["ours"])
    calibrated, other = figure(times_s["ours"], unit_ms), figure(times_s["bootstrap"], unit_ms)
    split: dict[bool, list[float]] = {True: [], False: []}
    for resampled, time_s in zip(ours.resampled, times_s["ours"], strict=True):
        split[resampled].append(time_s)
    return StepCost(
        n_particles=n_particles,
        calibrated=calibrated,
        calibrated_ns_per_particle=round(calibrated.median_ms / n_particles * 1e6, 2),
        bootstrap=other,
        bootstrap_ns_per_particle=round(other.median_ms / n_particles * 1e6, 2),
        with_resampling=figure(split[True], unit_ms) if split[True] else None,
        without_resampling=figure(split[False], unit_ms) if split[False] else None,
    )


def _traced_peaks(n_particles: int, number: int | None, on_step: Callable[[], None]) -> list[int]:
    """Bytes that each step has allocated at its peak; steps of their own, as tracing slows them down."""
    ours, peaks = Calibrated(n_particles), list[int]()
    fly({"ours": Calibrated(n_particles)}, _WARM_UP)  # what is made once is made now
    was_tracing = tracemalloc.is_tracing()
    tracemalloc.start()
    try:
        fly({"ours": Traced(ours, peaks)}, number, lambda seen: on_step())
    finally:
        if not was_tracing:
            tracemalloc.stop()
    return peaks


class Traced:
    """A contender whose steps' peaks of allocated bytes go to `peaks`."""

    def __init__(self, contender: Calibrated | Bootstrap, peaks: list[int]) -> None:
        self._contender, self._peaks = contender, peaks

    def begin(self, seen: Seen) -> None:
        """Not traced."""
        self._contender.begin(seen)

    def step(self, seen: Seen) -> None:
        """One step, traced."""
        before = tracemalloc.get_traced_memory()[0]
        tracemalloc.reset_peak()
        self._contender.step(seen)
        self._peaks.append(tracemalloc.get_traced_memory()[1] - before)
