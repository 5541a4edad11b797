"""All claims to one picture: which are of one fire, where it is, who is outvoted. The ground calls it each second."""

from collections.abc import Mapping, Sequence, Set
from dataclasses import replace

import numpy as np

from distloc.batch.fusion.claims import Bearing, Claim, FusedFire, Outvoted, Picture
from distloc.batch.fusion.contradictions import reconciled
from distloc.batch.fusion.disputes import (
    OUTVOTED,
    arrays,
    estimate,
    is_outvoted,
    moved_together,
    outvoted_of,
    squares_from,
)
from distloc.batch.fusion.groups import IntArray, grouped, undecided
from distloc.batch.fusion.place import PRIOR, doubted
from distloc.batch.fusion.towers import tightened

SETTLED_S = 12.0  # a drone that has one fire in its picture has a second one by then


def fuse(
    claims: Sequence[Claim],
    bearings: Sequence[Bearing] = (),
    before: Mapping[str, str] | None = None,
    fresh: Set[str] = frozenset(),
) -> Picture:
    """Every claim is in one fire, as one that is used, undecided or, where it is alone as well, outvoted by another.

    `claims` are of one place: a component of what may meet. `before` names the fire of each claim as it was, which
    holds what is one together; those in `fresh` have been known for less than `SETTLED_S`. An outvoted claim stays a
    fire of its own, too: the others may look past a second one.
    """
    claims = sorted(claims, key=lambda one: one.name)
    if not claims:
        return Picture(())
    if len(claims) == 1 and not bearings:
        return Picture((_fire(claims),))
    group = reconciled(claims, grouped(claims, before or {}, fresh), before or {}, fresh)
    alone = _moved(claims, group, fresh)
    for one, _ in alone:  # they are of no group
        group[claims.index(one)] = group.max() + 1
    group = np.unique(group, return_inverse=True)[1]
    is_open = undecided(claims, group)
    fires = list[FusedFire]()
    apart = {one.name for one, _ in alone}
    for number in range(int(group.max()) + 1):
        rows = np.flatnonzero(group == number)
        if claims[rows[0]].name in apart:
            continue
        sure = [claims[i] for i in rows if not is_open[i]] or [claims[i] for i in rows]
        beside = tuple(claims[i].name for i in rows if claims[i] not in sure)
        odd = outvoted_of(sure)
        sure = [one for one in sure if one not in odd]
        alone += [(one, sure[0].name) for one in odd]
        fires.append(_fire(sure, beside, odd))
    by_name = {one.name: one for one in claims}
    index_of = {name: index for index, one in enumerate(fires) for name in (*one.used, *one.undecided)}
    words = [(index_of[by], _word(one, fires[index_of[by]])) for one, by in alone if by in index_of]
    words += _outvoted(fires, by_name, fresh)
    fires = [
        replace(one, outvoted=tuple(word for by, word in words if by == index)) for index, one in enumerate(fires)
    ] + [_fire([one]) for one, _ in alone]
    fires, towers = tightened(fires, sorted(bearings, key=lambda one: one.name))
    return Picture(tuple(sorted(fires, key=lambda one: one.used)), towers)


def _moved(claims: Sequence[Claim], group: IntArray, fresh: Set[str]) -> list[tuple[Claim, str]]:
    """Claims of vehicles whose compass shifts all that they say, each with a claim of the fire that it means."""
    found = []
    for vehicle in sorted({one.vehicle for one in claims}):
        own = [i for i, one in enumerate(claims) if one.vehicle == vehicle and one.name not in fresh]
        sizes = np.bincount(group, minlength=len(claims))
        if len(own) < 2 or all(sizes[group[i]] > 1 for i in own):
            continue
        rows = [
            [i for i in np.flatnonzero(group == g).tolist() if claims[i].vehicle != vehicle] for g in np.unique(group)
        ]
        rows = [one for one in rows if len(one) > 1]
        places = [estimate([claims[i] for i in one]) for one in rows]
        for i, place in zip(own, moved_together([claims[i] for i in own], places), strict=False):
            if place >= 0:
                found.append((claims[i], claims[rows[place][0]].name))
    return found


def _fire(claims: Sequence[Claim], beside: tuple[str, ...] = (), odd: Sequence[Claim] = ()) -> FusedFire:
    """Of these, and of `odd` that are outvoted: as far as they may be right yet, the ellipse is larger for them."""
    whole = (*claims, *odd)
    found = doubted(*arrays(whole), np.tile(PRIOR, (len(whole), 1)))
    used = tuple(one.name for one in claims)
    return FusedFire(used, found.position_en_m, found.covariance_m2, found.larger, beside)


def _outvoted(fires: Sequence[FusedFire], claims: Mapping[str, Claim], fresh: Set[str]) -> list[tuple[int, Outvoted]]:
    """What one vehicle alone has, put to the nearest fire of others that outvotes it, by its index."""
    found = []
    for one in fires:
        claim = claims[one.used[0]]
        if len(one.used) > 1 or claim.name in fresh:
            continue
        words = [
            (word.away_m, index, word)
            for index, other in enumerate(fires)
            if (word := _word(claim, other)).sigmas ** 2 > OUTVOTED
            and all(claims[name].vehicle != claim.vehicle for name in (*other.used, *other.undecided))
            and is_outvoted(claim, [claims[name] for name in other.used], other.position_en_m)
        ]
        if words:
            found.append(min(words, key=lambda one: one[:2])[1:])
    return found


def _word(claim: Claim, fire: FusedFire) -> Outvoted:
    """How far a claim is off a fire that it has no part in, by errors as they are told."""
    away_m = float(np.linalg.norm(claim.position_en_m - fire.position_en_m))
    sigmas = squares_from(claim, fire.position_en_m, fire.covariance_m2 / fire.larger) ** 0.5
    return Outvoted(claim.name, away_m, sigmas)
