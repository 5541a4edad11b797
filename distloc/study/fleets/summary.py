"""Many fleets' scores in one row."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from distloc.study.fleets.score import FleetScore

LONGEST_TWO_S = 30.0


@dataclass(frozen=True, slots=True)
class Summary:
    """Shares of fires and fleets, and medians of errors' ratios; not a number where there is nothing to count.

    `merged` is of the fleets with two fires, `two` of all. `wrong`, `named` and `falsely` are drones.
    """

    name: str
    fleets: int
    fires: int
    drones: int
    coverage: float
    own_coverage: float
    by_nearest: float
    by_surest: float
    merged: float
    mixed: float
    two: float
    wrong: int
    named: int
    falsely: int
    renamed: int


def summarised(name: str, scores: Sequence[FleetScore]) -> Summary:
    """Of these fleets."""
    fires = [fire for one in scores for fire in one.fires]
    pairs = [one for one in scores if one.true_fires > 1]
    return Summary(
        name=name,
        fleets=len(scores),
        fires=len(fires),
        drones=sum(one.drones for one in scores),
        coverage=_mean([fire.is_inside for fire in fires]),
        own_coverage=_mean([is_in for fire in fires for is_in in fire.own_inside]),
        by_nearest=_median([fire.error_m / fire.least_m for fire in fires]),
        by_surest=_median([fire.error_m / fire.surest_m for fire in fires]),
        merged=_mean([one.was_merged for one in pairs]),
        mixed=_mean([one.is_mixed for one in pairs]),
        two=_mean([one.longest_two_s > LONGEST_TWO_S for one in scores]),
        wrong=sum(len(one.wrong) for one in scores),
        named=sum(len(one.wrong & one.named) for one in scores),
        falsely=sum(len(one.named - one.wrong) for one in scores),
        renamed=sum(one.renamed for one in scores),
    )


def _mean(values: Sequence[float]) -> float:
    return float(np.mean(values)) if values else float("nan")


def _median(values: Sequence[float]) -> float:
    return float(np.median(values)) if values else float("nan")
