"""The coverage study's figures: each case's line of the table, the pooled line, and what its plots show."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from distloc.geometry.metrics import wilson_interval
from distloc.study.coverage.cases import CoverageCase, main_cases
from distloc.study.coverage.flights import FlightResult
from distloc.study.coverage.ledger import Track
from distloc.types import FloatArray


@dataclass(frozen=True, slots=True)
class Coverage:
    """How often the 95 % ellipse held the truth, of `trials`; `low` and `high` are Wilson's 95 % interval.

    Where several cases are pooled a seed counts once to the interval: its flights share their errors.
    """

    share: float
    low: float
    high: float
    trials: int


@dataclass(frozen=True, slots=True)
class FilterSummary:
    """One filter at the flights' ends; shares of the range are of the one that was drawn.

    `lost` targets have no estimate then; they count as outside the ellipse, and errors and `mean_nees` leave them out.
    `reports_coverage` is that of all confirmed and coasting reports of the flights, not of their ends; NaN of none.
    """

    coverage: Coverage
    reports_coverage: float
    lost: int
    mean_nees: float
    median_error_share: float
    rms_error_share: float
    median_half_share: float
    believed_share: float
    false_believed_a_run: float
    switches: int
    clean_share: float
    mean_gospa_m: float


@dataclass(frozen=True, slots=True)
class CaseSummary:
    """A line of the table; the bound is that of the root mean square error, its median over the runs."""

    runs: int
    targets: int
    bound_share: float
    calibrated: FilterSummary
    blind: FilterSummary


@dataclass(frozen=True, slots=True)
class FilterCurves:
    """Against the steps (T,), of the targets that have an estimate; NaN where fewer than half of them have one."""

    coverage: FloatArray
    low: FloatArray
    high: FloatArray
    median_error_share: FloatArray
    mean_nees: FloatArray


@dataclass(frozen=True, slots=True)
class CaseCurves:
    """Against the steps (T,): the camera's travel and the bound, medians over the runs as shares of the range."""

    travelled_share: FloatArray
    bound_share: FloatArray
    calibrated: FilterCurves
    blind: FilterCurves


def summarised(flights: Sequence[FlightResult], cases: int = 1) -> CaseSummary:
    """Of one case's flights, or of several cases', each by the same seeds."""
    ranges_m = np.concatenate([one.range_m for one in flights])
    bounds_m = np.concatenate([one.bound_m[:, -1] for one in flights])
    return CaseSummary(
        runs=len(flights),
        targets=flights[0].range_m.size,
        bound_share=float(np.median(bounds_m / ranges_m)),
        calibrated=_of_filter([one.calibrated for one in flights], ranges_m, cases),
        blind=_of_filter([one.blind for one in flights], ranges_m, cases),
    )


def pooled(
    cases: Sequence[CoverageCase], flights: Sequence[Sequence[FlightResult]], clutter: bool | None
) -> CaseSummary | None:
    """Perpendicular, oblique, head-on and orbit together, with errors that stay; None if one of them is not there.

    With clutter, without, or where it is None both.
    """
    wanted = {case for case in main_cases() if clutter in (None, case.clutter)}
    chosen = [one for case, of_case in zip(cases, flights, strict=True) if case in wanted for one in of_case]
    return summarised(chosen, len(wanted)) if wanted <= set(cases) else None


def curves(flights: Sequence[FlightResult]) -> CaseCurves:
    """Of one case's flights, whose steps are the same shares of the range."""
    ranges_m = np.concatenate([one.range_m for one in flights])
    bounds_m = np.concatenate([one.bound_m for one in flights])
    travelled = np.stack([one.travelled_m / one.range_m.mean() for one in flights])
    return CaseCurves(
        travelled_share=np.median(travelled, axis=0),
        bound_share=np.median(bounds_m / ranges_m[:, None], axis=0),
        calibrated=_curves_of([one.calibrated for one in flights], ranges_m),
        blind=_curves_of([one.blind for one in flights], ranges_m),
    )


def _of_filter(tracks: Sequence[Track], ranges_m: FloatArray, cases: int) -> FilterSummary:
    inside = np.concatenate([one.is_inside[:, -1] for one in tracks])
    has = np.isfinite(inside)
    shares = (np.concatenate([one.error_m[:, -1] for one in tracks]) / ranges_m)[has]
    squared = np.concatenate([one.nees[:, -1] for one in tracks])[has]
    halves = (np.concatenate([one.half_length_m[:, -1] for one in tracks]) / ranges_m)[has]
    reported = np.concatenate([one.is_inside[one.is_believed] for one in tracks])
    targets = tracks[0].error_m.shape[0]
    is_clean = [one.believed == targets and not one.false_believed and not one.switches for one in tracks]
    return FilterSummary(
        coverage=_coverage(int(np.nansum(inside)), inside.size, cases),
        reports_coverage=float(reported.mean()) if reported.size else float("nan"),
        lost=int((~has).sum()),
        mean_nees=float(squared.mean()) if squared.size else float("nan"),
        median_error_share=float(np.median(shares)) if shares.size else float("nan"),
        rms_error_share=float(np.sqrt(np.square(shares).mean())) if shares.size else float("nan"),
        median_half_share=float(np.median(halves)) if halves.size else float("nan"),
        believed_share=sum(one.believed for one in tracks) / inside.size,
        false_believed_a_run=sum(one.false_believed for one in tracks) / len(tracks),
        switches=sum(one.switches for one in tracks),
        clean_share=float(np.mean(is_clean)),
        mean_gospa_m=float(np.mean([one.gospa_m for one in tracks])),
    )


def _coverage(hits: int, trials: int, cases: int = 1) -> Coverage:
    return Coverage(hits / trials, *wilson_interval(hits / cases, trials / cases), trials)


def _curves_of(tracks: Sequence[Track], ranges_m: FloatArray) -> FilterCurves:
    inside = np.concatenate([one.is_inside for one in tracks])
    shares = np.concatenate([one.error_m for one in tracks]) / ranges_m[:, None]
    squared = np.concatenate([one.nees for one in tracks])
    steps = inside.shape[1]
    found = np.full((5, steps), np.nan)
    for step in range(steps):
        has = np.isfinite(inside[:, step])
        if 2 * int(has.sum()) >= has.size:
            coverage = _coverage(int(inside[has, step].sum()), int(has.sum()))
            median, mean = np.median(shares[has, step]), squared[has, step].mean()
            found[:, step] = coverage.share, coverage.low, coverage.high, median, mean
    return FilterCurves(*found)
