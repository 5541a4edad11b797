"""The figures of scenes: a scene's line of the table, and a group's."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from distloc.geometry.metrics import wilson_interval
from distloc.study.fires.ledger import SceneTrack
from distloc.types import BoolArray, FloatArray

THIRDS = 3


@dataclass(frozen=True, slots=True)
class SceneSummary:
    """Of one scene's flights; words are those of the ledger, and a figure of nothing is NaN.

    `confirmed_runs`: share of flights with a confirmed report of a fire. `confirmed_steps`: of the steps since a fire's
    smoke was first in the picture, the share with anything confirmed. `coverage`: share of the fires' confirmed
    `reports` whose 95 % ellipse holds the fire's place, a second target's too; also in each third of the flight's time.
    `coverage_low` and `coverage_high` are Wilson's 95 % interval of it, to which a seed counts once: its flights share
    their errors, and a flight's reports do. `mean_nees` of the same reports is 2 where the covariance is true.
    `held_share`: share of fires with a confirmed target at the end, and `held_coverage` the share of these whose
    ellipse holds the fire then. Error and half-length: medians over the fires, each at its last confirmed report, as
    shares of the range then. `ids_a_fire`: mean number of confirmed targets that were a fire's. `switches_a_run`: how
    often a fire's target became another than the one before, gaps between them or not. `false_a_run`: confirmed targets
    that were nobody's. `ids_a_run`: targets reported in any state. `told_after_s` and `confirmed_after_s`: medians over
    the fires from their smoke's first sight to the first living report that points at it, and to the first confirmed
    one; infinite where most never were.
    """

    runs: int
    fires: int
    confirmed_runs: float
    confirmed_steps: float
    reports: int
    coverage: float
    coverage_low: float
    coverage_high: float
    mean_nees: float
    third_coverages: tuple[float, float, float]
    held_share: float
    held_coverage: float
    median_error_share: float
    median_half_share: float
    ids_a_fire: float
    switches_a_run: float
    false_a_run: float
    ids_a_run: float
    told_after_s: float
    confirmed_after_s: float


@dataclass(frozen=True, slots=True)
class _FiresEnd:
    """Of each fire of a flight (K,): its last confirmed report, NaN where it has none."""

    error_share: FloatArray
    half_share: FloatArray
    is_held: BoolArray
    is_inside: BoolArray


def summarised(tracks: Sequence[SceneTrack], scenes: int = 1) -> SceneSummary:
    """Of the flights of one scene, or of several one after the other, each by the same seeds."""
    inside = np.concatenate([one.reports.is_inside for one in tracks])
    third = np.concatenate([THIRDS * one.reports.step // one.stamps_s.size for one in tracks])
    ends = [_fires_end(one) for one in tracks]
    held = np.concatenate([one.is_held for one in ends])
    error, half = (np.concatenate([getattr(one, name) for one in ends]) for name in ("error_share", "half_share"))
    first, second, last = (_mean(inside[third == number]) for number in range(THIRDS))
    told_s, confirmed_s = (
        np.concatenate([_after_s(one.seen_s, getattr(one, name)) for one in tracks])
        for name in ("told_s", "confirmed_s")
    )
    coverage, seeds = _mean(inside), _told_seeds(tracks, scenes)
    low, high = wilson_interval(coverage * seeds if seeds else 0.0, seeds)
    return SceneSummary(
        runs=len(tracks),
        fires=max(one.held.shape[0] for one in tracks),
        confirmed_runs=float(np.mean([one.reports.step.size > 0 for one in tracks])),
        confirmed_steps=_mean(np.concatenate([one.has_confirmed[one.stamps_s >= one.seen_s.min()] for one in tracks])),
        reports=inside.size,
        coverage=coverage,
        coverage_low=low,
        coverage_high=high,
        mean_nees=_mean(np.concatenate([one.reports.nees for one in tracks])),
        third_coverages=(first, second, last),
        held_share=float(held.mean()),
        held_coverage=_mean(np.concatenate([one.is_inside for one in ends])[held]),
        median_error_share=_median(error[np.isfinite(error)]),
        median_half_share=_median(half[np.isfinite(half)]),
        ids_a_fire=float(np.mean(np.concatenate([_ids_of_fires(one) for one in tracks]))),
        switches_a_run=float(np.mean([_switches(one) for one in tracks])),
        false_a_run=float(np.mean([one.false_ids for one in tracks])),
        ids_a_run=float(np.mean([one.ids_given for one in tracks])),
        told_after_s=_median(told_s),
        confirmed_after_s=_median(confirmed_s),
    )


def pooled(groups: Mapping[str, Sequence[str]], tracks: Mapping[str, Sequence[SceneTrack]]) -> dict[str, SceneSummary]:
    """A line a group of several scenes by name, of those groups whose scenes were all flown."""
    whole = {group: names for group, names in groups.items() if len(names) > 1 and set(names) <= tracks.keys()}
    return {
        group: summarised([one for name in names for one in tracks[name]], len(names)) for group, names in whole.items()
    }


def _fires_end(track: SceneTrack) -> _FiresEnd:
    """A fire's last report is its most seen target's, where two are confirmed."""
    count = track.held.shape[0]
    error, half = np.full(count, np.nan), np.full(count, np.nan)
    is_inside = np.zeros(count, dtype=np.bool_)
    reports = track.reports
    for index in np.flatnonzero(track.held[reports.fire, reports.step] == reports.target):
        fire = reports.fire[index]
        error[fire], half[fire] = reports.error_share[index], reports.half_share[index]
        is_inside[fire] = reports.is_inside[index]
    return _FiresEnd(error, half, track.held[:, -1] > 0, is_inside)


def _told_seeds(tracks: Sequence[SceneTrack], scenes: int) -> int:
    """Seeds with a confirmed report of a fire."""
    is_told = np.array([one.reports.step.size > 0 for one in tracks]).reshape(scenes, -1)
    return int(is_told.any(axis=0).sum())


def _ids_of_fires(track: SceneTrack) -> FloatArray:
    """Confirmed targets of each fire (K,)."""
    reports = track.reports
    return np.array(
        [np.unique(reports.target[reports.fire == fire]).size for fire in range(track.held.shape[0])], float
    )


def _switches(track: SceneTrack) -> int:
    of_fires = [ids[ids > 0] for ids in track.held]
    return sum(int(np.count_nonzero(np.diff(ids))) for ids in of_fires)


def _after_s(seen_s: FloatArray, stamp_s: FloatArray) -> FloatArray:
    """From first sight, of the fires that were seen; 0 for what was known of before, infinite where never."""
    was_seen = np.isfinite(seen_s)
    return np.maximum(stamp_s[was_seen] - seen_s[was_seen], 0.0)


def _mean(values: FloatArray | BoolArray) -> float:
    return float(values.mean()) if values.size else float("nan")


def _median(values: FloatArray) -> float:
    return float(np.median(values)) if values.size else float("nan")
