"""The curve of time to alert against false alarms: the sequences' results at one threshold, pooled."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from distloc.study.alerts.places import LEVELS
from distloc.study.alerts.watch import Watched


@dataclass(frozen=True, slots=True)
class Alerts:
    """At one threshold, None for a segmenter that has none; a value a level.

    `told` counts the fires that were told of. `after_s` is the median over all fires, those never told of counting as
    never: NaN where that is most of them. `false_per_hour` is NaN where nobody watched before an ignition.
    """

    threshold: float | None
    fires: int
    hours: float
    told: tuple[int, ...]
    after_s: tuple[float, ...]
    false: tuple[int, ...]
    false_per_hour: tuple[float, ...]


def pooled(threshold: float | None, watched: Sequence[Watched]) -> Alerts:
    """Of all sequences; those with frames after the ignition are the fires."""
    lit = np.array([one.after_s for one in watched if one.frames[1]]).reshape(-1, len(LEVELS))
    false = np.array([one.false for one in watched]).reshape(-1, len(LEVELS)).sum(axis=0)
    hours = float(sum(one.hours for one in watched))
    after_s = np.median(np.where(np.isnan(lit), np.inf, lit), axis=0) if len(lit) else np.full(len(LEVELS), np.nan)
    return Alerts(
        threshold,
        len(lit),
        hours,
        tuple(np.isfinite(lit).sum(axis=0).tolist()),
        tuple(np.where(np.isfinite(after_s), after_s, np.nan).tolist()),
        tuple(false.tolist()),
        tuple((false / hours if hours > 0.0 else np.full(len(LEVELS), np.nan)).tolist()),
    )
