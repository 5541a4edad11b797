"""Which of several places that nobody named each platform's sightings are of, judged of all places together.

Lines of sight of towers to two things cross in more places than two, and compasses that err by degrees make most of
these crossings fit. Each place for itself can't tell; both together can: a tower's error is one for all that it sees.
So whole platforms' sightings are exchanged between two places, and what then explains all of them best is kept.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from distloc.batch.belonging.members import AGREE, least_squares, white_variance
from distloc.batch.lines import IntArray, Lines
from distloc.batch.scales import SCALES
from distloc.batch.views import Company, evidence, settled
from distloc.types import BoolArray, FloatArray

NOBODY = -1
_MOST_LINES = 96  # that judge
_ALL_WAYS = 5  # platforms but one, of which each set is exchanged; of more at most two
_MOST_PLATFORMS = 12
_ROUNDS = 4
_MOST_BUNDLED, _FIXED_M = 400, 1e-2
_MOST_PLACES = 6
_AS_GOOD = 5.0  # a logarithm by which another way may be less likely
_ELSEWHERE = 4.0  # squared standard deviations of a place
_LOG_MISSED = math.log(0.02 / 0.5)  # of a sighting of something else, as in `members`
_LOG_WHOLE = math.log(0.98) - math.log(2.0 * math.pi)


@dataclass(frozen=True, slots=True)
class Way:
    """One way to have N sightings be of places: `label` (N,) says of which, NOBODY of none.

    `points_enu_m` (M, 3) is where these are, with covariances (M, 3, 3); NaN of places that nobody sees.
    """

    label: IntArray
    points_enu_m: FloatArray
    covariance_enu_m2: FloatArray
    log_evidence: float


def associated(
    lines: Lines, label: IntArray, points_enu_m: list[FloatArray]
) -> tuple[IntArray, list[FloatArray], frozenset[int]]:
    """Labels (N,) and places of the best way found from one on, and which of these ways as good have elsewhere."""
    if not 1 < len(points_enu_m) <= _MOST_PLACES:
        return label, points_enu_m, frozenset()
    starts = np.stack(points_enu_m)
    label = _in_bundles(lines, label)
    judges = _judges(lines, label)
    few = lines.of(judges)
    best, rivals = _judged(few, label[judges], starts), []
    for _ in range(_ROUNDS):
        tried = []
        for how in _exchanges(few, best.label):
            other = _exchanged(few.platform, best.label, *how)
            if _repeats(few, other) <= _repeats(few, best.label):
                tried.append((_judged(few, other, starts), how))
        rivals = [one for one, _ in tried if one.log_evidence > best.log_evidence - _AS_GOOD]
        top, how = max(tried, key=lambda one: one[0].log_evidence, default=(best, (0, 0, ())))
        if top.log_evidence <= best.log_evidence + 1e-6:
            break
        best, label = top, _exchanged(lines.platform, label, *how)
    points = [old if np.isnan(new).any() else new for old, new in zip(points_enu_m, best.points_enu_m, strict=True)]
    return label, points, frozenset(j for one in rivals for j in _elsewhere(best, one))


def _in_bundles(lines: Lines, label: IntArray) -> IntArray:
    """What a fixed mount sees in one direction is one thing: it gets the label that most have, and no other does."""
    label = label.copy()
    for number in np.unique(lines.platform).tolist():
        own = np.flatnonzero(lines.platform == number)
        if not 1 < len(own) <= _MOST_BUNDLED or np.ptp(lines.position_enu_m[own], axis=0).max() > _FIXED_M:
            continue
        bundles = [bundle for bundle in _bundles(lines, own) if not _is_of_several(lines, bundle)]
        rest = np.setdiff1d(own, np.concatenate([[], *bundles]))
        free = set(range(int(label.max()) + 1)) - set(label[rest].tolist())
        counts = {(which, j): int((label[b] == j).sum()) for which, b in enumerate(bundles) for j in sorted(free)}
        given: set[int] = set()
        for which, j in sorted(counts, key=lambda pair: -counts[pair]):
            if which not in given and j in free:
                label[bundles[which]] = j
                given.add(which)
                free.discard(j)
    return label


def _bundles(lines: Lines, own: IntArray) -> list[IntArray]:
    """Those of a mount's lines that look the same way within white errors, or are joined by others that do."""
    middle = np.einsum("nij,nj->ni", np.repeat(lines.basis[own[:1]], len(own), axis=0), lines.direction_enu[own])
    variance = white_variance(lines)[own]
    apart = np.square(middle[:, None] - middle[None]) / (variance[:, None] + variance[None])
    is_joined = apart.sum(axis=2) < AGREE
    left, found = np.ones(len(own), np.bool_), []
    while left.any():
        bundle = np.zeros(len(own), np.bool_)
        bundle[np.flatnonzero(left)[0]] = True
        while (grown := is_joined[bundle].any(axis=0)).sum() > bundle.sum():
            bundle = grown
        left &= ~bundle
        found.append(own[bundle])
    return found


def _is_of_several(lines: Lines, bundle: IntArray) -> bool:
    """Whether a picture shows it twice."""
    pictures = lines.picture[bundle][~np.isnan(lines.stamp_s[bundle])]
    return len(np.unique(pictures)) < len(pictures)


def _judged(lines: Lines, label: IntArray, points_enu_m: FloatArray) -> Way:
    """A way with its places settled and its likelihood."""
    is_of_any = label != NOBODY
    seen = np.unique(label[is_of_any])
    starts = []
    for j in seen.tolist():
        own = lines.of(label == j)
        start = least_squares(own, np.ones(len(own))) if len(np.unique(own.platform)) > 1 else None
        starts.append(points_enu_m[j] if start is None else start)
    which = np.searchsorted(seen, label[is_of_any]).astype(np.intp)
    company = settled(Company(lines.of(is_of_any), which, np.stack(starts), np.zeros(len(seen))), SCALES[0])
    log, covariance = evidence(company)
    points, whole = np.full((len(points_enu_m), 3), np.nan), np.full((len(points_enu_m), 3, 3), np.nan)
    points[seen], whole[seen] = company.points_enu_m, covariance
    log += _LOG_WHOLE * float(is_of_any.sum()) + _LOG_MISSED * float((~is_of_any).sum())
    return Way(label, points, whole, log)


def _exchanges(lines: Lines, label: IntArray) -> Iterator[tuple[int, int, tuple[int, ...]]]:
    """Two places each, and the platforms whose sightings of them are exchanged."""
    for j, k in combinations(np.unique(label).tolist(), 2):
        platforms = np.unique(lines.platform[(label == j) | (label == k)]).tolist()[:_MOST_PLATFORMS]
        if j != NOBODY:  # all of them exchanged is the same way with other names
            platforms = platforms[1:]
        most = len(platforms) if len(platforms) <= _ALL_WAYS and j != NOBODY else min(len(platforms), 2)
        for count in range(1, most + 1):
            for chosen in combinations(platforms, count):
                yield j, k, chosen


def _exchanged(platform: IntArray, label: IntArray, j: int, k: int, chosen: tuple[int, ...]) -> IntArray:
    is_theirs = np.isin(platform, chosen)
    return np.where(is_theirs & (label == j), k, np.where(is_theirs & (label == k), j, label)).astype(np.intp)


def _repeats(lines: Lines, label: IntArray) -> int:
    """How many sightings are of a place that their picture shows already."""
    told = (label != NOBODY) & ~np.isnan(lines.stamp_s)
    pairs = np.stack([lines.picture[told], label[told]])
    return int(pairs.shape[1] - np.unique(pairs, axis=1).shape[1])


def _elsewhere(best: Way, other: Way) -> Iterator[int]:
    """The places of the best way that another one has nowhere."""
    for j, point in enumerate(best.points_enu_m):
        if np.isnan(point).any():
            continue
        off_m = other.points_enu_m[~np.isnan(other.points_enu_m).any(axis=1)] - point
        squared = np.einsum("ki,ik->k", off_m, np.linalg.solve(best.covariance_enu_m2[j], off_m.T))
        if squared.min() > _ELSEWHERE:
            yield j


def _judges(lines: Lines, label: IntArray) -> BoolArray:
    """At most so many lines, evenly of each platform's of each place."""
    if len(lines) <= _MOST_LINES:
        return np.ones(len(lines), np.bool_)
    _, group = np.unique(np.stack([lines.platform, label]), axis=1, return_inverse=True)
    group = group.reshape(-1)
    most = max(_MOST_LINES // (int(group.max()) + 1), 1)
    chosen = np.zeros(len(lines), np.bool_)
    for number in range(int(group.max()) + 1):
        own = np.flatnonzero(group == number)
        chosen[own[np.unique(np.linspace(0, len(own) - 1, min(most, len(own))).astype(np.intp))]] = True
    return chosen
