"""The drawn study's figures: a scene's line of the table, without and with the scenery, and whether the bounds hold."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from distloc.study.drawn.flights import DrawnFlight
from distloc.study.drawn.ledger import FireTrack
from distloc.types import FloatArray

SETTLED_S = 10.0  # of the flight: from there on the attitude is judged
LEAST_COVERAGE, MOST_LESS = 0.93, 0.02  # where smoke alone has the first; less than smoke alone, anywhere
_AXES = 3
_AT_END = ("error_m", "half_length_m")


@dataclass(frozen=True, slots=True)
class FireSummary:
    """Of the believed reports (confirmed or coasting); lengths are shares of each flight's range, NaN where none was.

    `coverage` is of all `reports`; error and half-length are medians over the flights that end with one.
    `confirmed_at_share` is the median way flown until the first, infinite where most flights have none.
    """

    confirmed_share: float
    confirmed_at_share: float
    median_error_share: float
    median_half_share: float
    reports: int
    coverage: float
    lost: int
    withdrawn: int


@dataclass(frozen=True, slots=True)
class DrawnSummary:
    """One scene. The attitude's figures are of the keyframes after `SETTLED_S` that went by the scenery.

    `heading_rms_rad` is what was left of the heading's error, `heading_told_rad` the root mean square of the told
    sigma; `attitude_nees` is a degree of freedom's: 1 where the told covariance is true.
    """

    runs: int
    used_share: float
    heading_rms_rad: float
    heading_told_rad: float
    attitude_nees: float
    without: FireSummary
    scenery: FireSummary

    @property
    def misses(self) -> list[str]:
        """Which bounds the scenery does not keep: it must not make the reports less true, nor lose a target."""
        without, scenery = self.without, self.scenery
        missed = {
            f"coverage over {MOST_LESS:g} less": scenery.coverage < without.coverage - MOST_LESS,
            f"coverage under {LEAST_COVERAGE:g}": scenery.coverage < LEAST_COVERAGE <= without.coverage,
            "more lost": scenery.lost > without.lost,
        }
        return [name for name, is_missed in missed.items() if is_missed]


def summarised(flights: Sequence[DrawnFlight]) -> DrawnSummary:
    """Of one scene's flights."""
    settled = np.concatenate([one.stamps_s >= SETTLED_S for one in flights])
    error_rad, sigma_rad, squared = (
        np.concatenate([getattr(one, name) for one in flights])[settled]
        for name in ("heading_error_rad", "heading_sigma_rad", "attitude_nees")
    )
    return DrawnSummary(
        runs=len(flights),
        used_share=float(np.concatenate([one.is_used for one in flights]).mean()),
        heading_rms_rad=_root_mean_square(error_rad),
        heading_told_rad=_root_mean_square(sigma_rad),
        attitude_nees=_mean(squared[np.isfinite(squared)]) / _AXES,
        without=_of_fire(flights, [one.without for one in flights]),
        scenery=_of_fire(flights, [one.scenery for one in flights]),
    )


def _of_fire(flights: Sequence[DrawnFlight], tracks: Sequence[FireTrack]) -> FireSummary:
    ranges_m = np.array([one.range_m for one in flights])
    at_share = [
        flight.travelled_m[np.argmax(track.believed > 0.0)] / flight.range_m if track.believed.any() else np.inf
        for flight, track in zip(flights, tracks, strict=True)
    ]
    error, half = (np.array([getattr(one, name)[-1] for one in tracks]) / ranges_m for name in _AT_END)
    reports, held = (int(sum(getattr(one, name).sum() for one in tracks)) for name in ("believed", "held"))
    return FireSummary(
        confirmed_share=float(np.isfinite(error).mean()),
        confirmed_at_share=float(np.median(at_share)),
        median_error_share=_median(error[np.isfinite(error)]),
        median_half_share=_median(half[np.isfinite(half)]),
        reports=reports,
        coverage=held / reports if reports else float("nan"),
        lost=sum(one.lost for one in tracks),
        withdrawn=sum(one.withdrawn for one in tracks),
    )


def _median(values: FloatArray) -> float:
    return float(np.median(values)) if values.size else float("nan")


def _mean(values: FloatArray) -> float:
    return float(values.mean()) if values.size else float("nan")


def _root_mean_square(values: FloatArray) -> float:
    return float(np.sqrt(_mean(np.square(values[np.isfinite(values)]))))
