"""What many advised flights come to: are the promises met, and is the advice better than chance?"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from distloc.study.advice.flights import AdviceResult

MET = 0.3  # within so much of the promise, either way


@dataclass(frozen=True, slots=True)
class AdviceSummary:
    """Of `runs` flights `seen` had a target that was reported, `advised` an advice, `promised` one with a half-length.

    `met` is the share of the promised ones whose half-length came within 30 % of it, `at_most` that came to no more
    than 1.3 of it. `ratio` are the 10, 50 and 90 % quantiles of half-length over promise. `advised_m` and `by_chance_m`
    are the median half-lengths after the advised way and after a leg by chance, as long; `paired` is the median of
    their ratios. `inside` is how often the ellipse held the truth after the advised way. NaN where there are none.
    """

    name: str
    runs: int
    seen: int
    advised: int
    promised: int
    met: float
    at_most: float
    ratio: tuple[float, float, float]
    before_m: float
    advised_m: float
    by_chance_m: float
    paired: float
    inside: float


def summarised(name: str, results: Sequence[AdviceResult]) -> AdviceSummary:
    """Of some of the flights."""
    flown = [(one, one.advice, one.advised, one.by_chance) for one in results]
    both = [(one, advice, way, chance) for one, advice, way, chance in flown if advice and way and chance]
    promised = [(advice.half_length_m, way) for _, advice, way, _ in both if advice.half_length_m is not None]
    ratio = np.array([way.half_length_m / half_m for half_m, way in promised])
    advised_m = np.array([way.half_length_m for *_, way, _ in both])
    chance_m = np.array([chance.half_length_m for *_, chance in both])
    with np.errstate(invalid="ignore"):
        paired = advised_m / chance_m
    return AdviceSummary(
        name=name,
        runs=len(results),
        seen=sum(one.is_seen for one in results),
        advised=len(both),
        promised=len(promised),
        met=_mean(np.abs(ratio - 1.0) <= MET),
        at_most=_mean(ratio <= 1.0 + MET),
        ratio=(_quantile(ratio, 0.1), _quantile(ratio, 0.5), _quantile(ratio, 0.9)),
        before_m=_quantile(np.array([one.half_before_m for one, *_ in both]), 0.5),
        advised_m=_quantile(advised_m, 0.5),
        by_chance_m=_quantile(chance_m, 0.5),
        paired=_quantile(paired[~np.isnan(paired)], 0.5),
        inside=_mean(np.array([way.is_inside for _, _, way, _ in both])),
    )


def _mean(values: NDArray[Any]) -> float:
    return float(values.mean()) if values.size else float("nan")


def _quantile(values: NDArray[Any], share: float) -> float:
    return float(np.quantile(values, share, method="inverted_cdf")) if values.size else float("nan")
