"""The scenery study's figures: each case's lines of the table without and with the corners, and the curves."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from distloc.filter.uncertainty import LEVEL
from distloc.study.coverage.ledger import Track
from distloc.study.scenery.flights import Bounds, SceneryFlight
from distloc.types import FloatArray

_SETTLED_SHARE = 0.25  # of the flight: from there on the compass is judged
_HALF_LENGTH_SIGMAS = float(np.sqrt(-2.0 * np.log(1.0 - LEVEL)))  # of two dimensions
_LEAST_SHARE = 0.5  # of the flights have an estimate, for a median over them


@dataclass(frozen=True, slots=True)
class TargetSummary:
    """Of the reports that were believed (confirmed or coasting); lengths are shares of the range, NaN where none was.

    `coverage` is of the reports of all steps; `end_coverage`, `mean_nees`, errors and half-lengths are of the last one.
    `confirmed_at_share` is the median way flown until the first of them, infinite where most flights have none.
    """

    confirmed_share: float
    confirmed_at_share: float
    median_error_share: float
    median_half_share: float
    coverage: float
    end_coverage: float
    mean_nees: float


@dataclass(frozen=True, slots=True)
class BoundShares:
    """Root mean square error and half-length of the ellipse (T,) of who attains the bound, as shares of the range."""

    error: FloatArray
    half_length: FloatArray


@dataclass(frozen=True, slots=True)
class CaseSummary:
    """One case; the heading's root mean square error after correction, and its told sigma, are from a quarter on."""

    runs: int
    without: TargetSummary
    scenery: TargetSummary
    heading_rms_rad: float
    heading_told_rad: float


@dataclass(frozen=True, slots=True)
class TargetCurves:
    """Medians (T,) as shares of the range over the flights that have an estimate, NaN where most have none."""

    error: FloatArray
    half_length: FloatArray


@dataclass(frozen=True, slots=True)
class CaseCurves:
    """Against the way flown (T,), as a share of the range."""

    travelled_share: FloatArray
    without: TargetCurves
    scenery: TargetCurves
    without_bound: BoundShares
    scenery_bound: BoundShares


def summarised(flights: Sequence[SceneryFlight]) -> CaseSummary:
    """Of one case's flights."""
    first = int(_SETTLED_SHARE * flights[0].travelled_m.size)
    errors = np.stack([one.heading_error_rad for one in flights])[:, first:]
    sigmas = np.stack([one.heading_sigma_rad for one in flights])[:, first:]
    return CaseSummary(
        runs=len(flights),
        without=_of_target(flights, [one.without for one in flights]),
        scenery=_of_target(flights, [one.scenery for one in flights]),
        heading_rms_rad=_root_mean_square(errors),
        heading_told_rad=_root_mean_square(sigmas),
    )


def curves(flights: Sequence[SceneryFlight], bounds: Bounds) -> CaseCurves:
    """Of one case's flights, which all have the same range."""
    range_m = flights[0].range_m
    travelled = np.stack([one.travelled_m for one in flights]) / range_m
    return CaseCurves(
        travelled_share=np.median(travelled, axis=0),
        without=_curves_of([one.without for one in flights], range_m),
        scenery=_curves_of([one.scenery for one in flights], range_m),
        without_bound=bound_shares(bounds.without_m2, range_m),
        scenery_bound=bound_shares(bounds.scenery_m2, range_m),
    )


def bound_shares(covariance_m2: FloatArray, range_m: float) -> BoundShares:
    """Of covariances on the map (T, 2, 2); infinite ones give infinity."""
    finite = np.asarray(np.isfinite(covariance_m2).all(axis=(1, 2)))
    held_m2 = np.where(finite[:, None, None], covariance_m2, 0.0)
    error_m = np.sqrt(np.trace(held_m2, axis1=1, axis2=2))
    half_m = _HALF_LENGTH_SIGMAS * np.sqrt(np.linalg.eigvalsh(held_m2)[:, -1])
    error, half_length = (np.where(finite, one, np.inf) / range_m for one in (error_m, half_m))
    return BoundShares(error, half_length)


def _of_target(flights: Sequence[SceneryFlight], tracks: Sequence[Track]) -> TargetSummary:
    is_believed = np.stack([one.is_believed[0] for one in tracks])
    inside = np.stack([one.is_inside[0] for one in tracks])
    at_end = is_believed[:, -1]
    range_m = flights[0].range_m
    travelled_m = np.stack([one.travelled_m for one in flights])
    first_m = np.take_along_axis(travelled_m, is_believed.argmax(axis=1)[:, None], axis=1)[:, 0]
    begun_m = np.where(is_believed.any(axis=1), first_m, np.inf)
    return TargetSummary(
        confirmed_share=float(at_end.mean()),
        confirmed_at_share=_median(begun_m) / range_m,
        median_error_share=_median(np.array([one.error_m[0, -1] for one in tracks])[at_end]) / range_m,
        median_half_share=_median(np.array([one.half_length_m[0, -1] for one in tracks])[at_end]) / range_m,
        coverage=_mean(inside[is_believed]),
        end_coverage=_mean(inside[at_end, -1]),
        mean_nees=_mean(np.array([one.nees[0, -1] for one in tracks])[at_end]),
    )


def _curves_of(tracks: Sequence[Track], range_m: float) -> TargetCurves:
    errors_m, halves_m = (np.stack([getattr(one, name)[0] for one in tracks]) for name in ("error_m", "half_length_m"))
    enough = np.isfinite(errors_m).mean(axis=0) >= _LEAST_SHARE
    found = np.full((2, errors_m.shape[1]), np.nan)
    found[:, enough] = [np.nanmedian(values[:, enough], axis=0) / range_m for values in (errors_m, halves_m)]
    return TargetCurves(*found)


def _median(values: FloatArray) -> float:
    return float(np.median(values)) if values.size else float("nan")


def _mean(values: FloatArray) -> float:
    return float(values.mean()) if values.size else float("nan")


def _root_mean_square(values: FloatArray) -> float:
    return float(np.sqrt(_mean(np.square(values[np.isfinite(values)]))))
