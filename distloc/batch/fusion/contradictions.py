"""Two groups of claims that contradict each other about what both see: one fire of which somebody is wrong, or two?

As told they are too far apart to be one. But drones may be worse than they tell, and a second fire would have been
missed by all who looked at it: the likelier of the two it is.
"""

from collections.abc import Mapping, Sequence, Set
from dataclasses import dataclass

import numpy as np

from distloc.batch.fusion.claims import Claim
from distloc.batch.fusion.disputes import OUTVOTED, estimate, looked_at
from distloc.batch.fusion.groups import IntArray
from distloc.batch.fusion.place import PRIOR, SCALES, Estimate, squared

_DENSITY = 1e-6  # fires a square metre about another: each kilometre
_MISSED = 0.15  # a fire in the picture by a drone that has found another there
_HELD = 2.0  # of log odds: what was one before stays so


@dataclass(frozen=True, slots=True)
class _Pair:
    """Two groups that may be one, with the log odds for it."""

    first: int
    second: int
    odds: float


def reconciled(claims: Sequence[Claim], group: IntArray, before: Mapping[str, str], fresh: Set[str]) -> IntArray:
    """The groups (N,) with those made one that contradict each other and are likelier one fire than two.

    What moves together goes first: a compass that is wrong shifts all that its drone says. The same claims in any order
    give the same groups.
    """
    members = [[claims[i] for i in np.flatnonzero(group == g).tolist()] for g in range(int(group.max()) + 1)]
    places = [estimate(own) for own in members]
    pairs = [
        _Pair(first, second, odds)
        for second in range(len(members))
        for first in range(second)
        if (odds := _odds(members[first], members[second], places[first], places[second], before, fresh)) > 0.0
    ]
    support = {pair: sum(_moves_with(pair, other, members, places) for other in pairs) for pair in pairs}
    found, vehicles = np.arange(len(members)), [{one.vehicle for one in own} for own in members]
    for pair in sorted(pairs, key=lambda one: (-support[one], -one.odds, one.first, one.second)):
        first, second = int(found[pair.first]), int(found[pair.second])
        if first != second and not vehicles[first] & vehicles[second]:
            found[found == second] = first
            vehicles[first] |= vehicles[second]
    return np.unique(found[group], return_inverse=True)[1].astype(np.intp)


def _odds(
    first: Sequence[Claim],
    second: Sequence[Claim],
    place: Estimate,
    other: Estimate,
    before: Mapping[str, str],
    fresh: Set[str],
) -> float:
    """Log odds that two groups are one fire; minus infinity where a drone tells of both, or has yet to tell."""
    whole = (*first, *second)
    if {one.vehicle for one in first} & {one.vehicle for one in second} or any(one.name in fresh for one in whole):
        return -np.inf
    looked = (
        [looked_at(one, other.position_en_m) for one in first],
        [looked_at(one, place.position_en_m) for one in second],
    )
    if not (any(looked[0]) and any(looked[1])):
        return -np.inf
    away = place.position_en_m - other.position_en_m
    one_fire = 0.0
    for scale, share in zip(SCALES, PRIOR, strict=True):
        for other_scale, other_share in zip(SCALES, PRIOR, strict=True):
            S = place.covariance_m2 * scale**2 + other.covariance_m2 * other_scale**2
            likelihood = np.exp(-0.5 * squared(away, S)) / (2.0 * np.pi * np.sqrt(np.linalg.det(S)))
            one_fire += share ** len(first) * other_share ** len(second) * likelihood
    two_fires = _DENSITY * _MISSED ** (sum(looked[0]) + sum(looked[1]))
    was_one = {before.get(one.name) for one in first} & {before.get(one.name) for one in second} - {None}
    return float(np.log(max(one_fire, 1e-300)) - np.log(two_fires)) + (_HELD if was_one else 0.0)


def _moves_with(pair: _Pair, other: _Pair, members: Sequence[Sequence[Claim]], places: Sequence[Estimate]) -> bool:
    """Whether another pair of the same drones' is apart by the same."""

    def of(index: int) -> set[str]:
        return {one.vehicle for one in members[index]}

    if len({pair.first, pair.second, other.first, other.second}) < 4:
        return False
    straight = of(pair.first) & of(other.first) and of(pair.second) & of(other.second)
    crossed = of(pair.first) & of(other.second) and of(pair.second) & of(other.first)
    if not (straight or crossed):
        return False
    a, b = (other.first, other.second) if straight else (other.second, other.first)
    away = places[pair.first].position_en_m - places[pair.second].position_en_m
    away = away - (places[a].position_en_m - places[b].position_en_m)
    return squared(away, places[a].covariance_m2 + places[b].covariance_m2) < OUTVOTED
