"""The paper's bootstrap step written with published libraries, beside ours, at the same number of particles.

All have the same static point that diffuses, the same weight exp(-min d^2) and systematic resampling at every step.
They get their best: everything is vectorised, in float64 as they come, and each is handed the frame's chamfer map
ready-made, so that filters are compared and not distance transforms; our bootstrap filter makes its own within its
time. The extra `bench` installs them.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from importlib.metadata import version
from typing import NamedTuple, Protocol

import msgspec
import numpy as np

from distloc.filter.settings import ENOUGH_PARTICLES, LocalizerConfig
from distloc.filter.uncertainty import CHI2_95
from distloc.study.methods import BIAS_BLIND_RAD
from distloc.study.scenes import PAPER_TARGET_ENU_M
from distloc.types import FloatArray, PoseErrors
from service.commands.bench.filters.filter_step import PAPER_COUNT, Bootstrap, Calibrated
from service.commands.bench.scene import Contender, Seen, fly
from service.commands.bench.timing import Figure, figure, median_ms

LIBRARIES = ("particles", "stonesoup", "filterpy")
_WARM_UP = 3  # frames: numba compiles in the first
SIZES = (500, 1_000, 2_000, ENOUGH_PARTICLES)  # of which the least that does is enough
_SEEDS = 16
ENOUGH_HOLDS = 0.95  # of the steps


class Rival(msgspec.Struct, frozen=True):
    """One library; null where it is not installed. Ratios are to the calibrated step.

    `error_m` is how far the particles' mean ended from the truth.
    """

    library: str
    version: str | None
    step: Figure | None
    error_m: float | None


class Published(msgspec.Struct, frozen=True):
    """Ours and theirs, in turns over one flight.

    `enough` is ours with the least of `SIZES` with which it is as good, told what the others take for granted: that the
    heading and the tilt are exact. As good: it ends as near to the truth as the nearest of the rivals does, by the
    farthest of 16 seeds, `enough_worst_m`, and its 95 % ellipse holds the truth in at least as many of all their steps,
    `enough_holds`. Where none does, it is the largest.
    """

    n_particles: int
    calibrated: Figure
    calibrated_error_m: float
    bootstrap: Figure
    bootstrap_error_m: float
    rivals: tuple[Rival, ...]
    enough_particles: int
    enough: Figure
    enough_error_m: float
    enough_worst_m: float
    enough_holds: float


class Estimator(Contender, Protocol):
    """A contender that has a result."""

    @property
    def mean_enu_m(self) -> FloatArray:
        """(3,)."""
        ...


def measure_published(
    n_particles: int = PAPER_COUNT, number: int | None = None, on_step: Callable[[], None] = lambda: None
) -> Published:
    """Fly what is installed."""
    installed = {name: make for name in LIBRARIES if (make := _contender_of(name)) is not None}
    fly({name: make(n_particles) for name, make in installed.items()}, _WARM_UP)
    contenders: dict[str, Estimator] = {"calibrated": Calibrated(n_particles), "bootstrap": Bootstrap(n_particles)}
    sizes = [size for size in SIZES if size <= n_particles] or [n_particles]
    contenders |= {_few(size): Calibrated(size, errors=_exact()) for size in sizes}
    contenders |= {name: make(n_particles) for name, make in installed.items()}
    times_s = fly(contenders, number, lambda seen: on_step())
    unit_ms = median_ms(times_s["calibrated"])
    figures = {name: figure(times, unit_ms) for name, times in times_s.items()}
    errors_m = {name: _error_m(contender) for name, contender in contenders.items()}
    most_m = min((errors_m[name] for name in installed), default=errors_m["calibrated"])
    enough = _enough(sizes, most_m, number, on_step)
    return Published(
        n_particles=n_particles,
        calibrated=figures["calibrated"],
        calibrated_error_m=errors_m["calibrated"],
        bootstrap=figures["bootstrap"],
        bootstrap_error_m=errors_m["bootstrap"],
        rivals=tuple(Rival(name, _version(name), figures.get(name), errors_m.get(name)) for name in LIBRARIES),
        enough_particles=enough.size,
        enough=figures[_few(enough.size)],
        enough_error_m=errors_m[_few(enough.size)],
        enough_worst_m=enough.worst_m,
        enough_holds=enough.holds,
    )


class _Quality(NamedTuple):
    size: int
    worst_m: float
    holds: float


def _enough(sizes: Sequence[int], most_m: float, number: int | None, on_step: Callable[[], None]) -> _Quality:
    """The least size that ends within `most_m` of the truth by all seeds, and whose ellipse holds it often enough."""
    for size in sizes:
        found = _quality(size, number, on_step)
        if found.worst_m <= most_m and found.holds >= ENOUGH_HOLDS:
            break
    return found


def _quality(size: int, number: int | None, on_step: Callable[[], None]) -> _Quality:
    held: list[bool] = []
    contenders = {str(seed): Calibrated(size, seed, _exact()) for seed in range(_SEEDS)}

    def stepped(seen: Seen) -> None:
        for one in contenders.values():
            cloud = one.filter.cloud
            off_m = (PAPER_TARGET_ENU_M - cloud.mean_enu_m)[:2]
            held.append(float(off_m @ np.linalg.solve(cloud.covariance_enu_m2[:2, :2], off_m)) <= CHI2_95)
        on_step()

    fly(contenders, number, stepped)
    return _Quality(size, max(_error_m(one) for one in contenders.values()), round(float(np.mean(held)), 3))


def _exact() -> PoseErrors:
    return replace(LocalizerConfig().pose_errors, heading_bias_rad=BIAS_BLIND_RAD, tilt_bias_rad=BIAS_BLIND_RAD)


def _few(size: int) -> str:
    return f"calibrated, {size}"


def _contender_of(library: str) -> Callable[[int], Estimator] | None:
    """None where it is not installed."""
    try:
        match library:
            case "particles":
                from service.commands.bench.published import with_particles as contender
            case "stonesoup":
                from service.commands.bench.published import with_stonesoup as contender  # type: ignore[no-redef]
            case _:
                from service.commands.bench.published import with_filterpy as contender  # type: ignore[no-redef]
    except ModuleNotFoundError:
        return None
    return contender.make


def _error_m(contender: Estimator) -> float:
    return round(float(np.linalg.norm(contender.mean_enu_m - PAPER_TARGET_ENU_M)), 2)


def _version(library: str) -> str | None:
    return None if _contender_of(library) is None else version(library)
