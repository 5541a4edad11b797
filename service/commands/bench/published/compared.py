"""The paper's bootstrap step written with published libraries, beside ours, at the same number of particles.

All have the same static point that diffuses, the same weight exp(-min d^2) and systematic resampling at every step.
They get their best: everything is vectorised, in float64 as they come, and each is handed the frame's chamfer map
ready-made, so that filters are compared and not distance transforms; our bootstrap filter makes its own within its
time. The extra `bench` installs them.
"""

from collections.abc import Callable
from dataclasses import replace
from importlib.metadata import version
from typing import Protocol

import msgspec
import numpy as np

from distloc.localizer_config import ENOUGH_PARTICLES, LocalizerConfig
from distloc.study.methods import BIAS_BLIND_RAD
from distloc.study.scenes import PAPER_TARGET_ENU_M
from distloc.types import FloatArray
from service.commands.bench.filters.filter_step import PAPER_COUNT, Bootstrap, Calibrated
from service.commands.bench.scene import Contender, fly
from service.commands.bench.timing import Figure, figure, median_ms

LIBRARIES = ("particles", "stonesoup", "filterpy")
_WARM_UP = 3  # frames: numba compiles in the first


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

    `enough` is ours with as many particles as it flies with, told what the others take for granted: that the heading
    and the tilt are exact.
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
    enough = min(ENOUGH_PARTICLES, n_particles)
    contenders: dict[str, Estimator] = {"calibrated": Calibrated(n_particles), "bootstrap": Bootstrap(n_particles)}
    exact = replace(LocalizerConfig().pose_errors, heading_bias_rad=BIAS_BLIND_RAD, tilt_bias_rad=BIAS_BLIND_RAD)
    contenders["enough"] = Calibrated(enough, errors=exact)
    contenders |= {name: make(n_particles) for name, make in installed.items()}
    times_s = fly(contenders, number, lambda seen: on_step())
    unit_ms = median_ms(times_s["calibrated"])
    figures = {name: figure(times, unit_ms) for name, times in times_s.items()}
    errors_m = {name: _error_m(contender) for name, contender in contenders.items()}
    return Published(
        n_particles=n_particles,
        calibrated=figures["calibrated"],
        calibrated_error_m=errors_m["calibrated"],
        bootstrap=figures["bootstrap"],
        bootstrap_error_m=errors_m["bootstrap"],
        rivals=tuple(Rival(name, _version(name), figures.get(name), errors_m.get(name)) for name in LIBRARIES),
        enough_particles=enough,
        enough=figures["enough"],
        enough_error_m=errors_m["enough"],
    )


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
