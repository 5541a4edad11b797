"""What became of one fleet's reports: are the fused fires where the fires are, as many, and is who is wrong named?"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from distloc.batch.fusion.claims import Claim, FusedFire
from distloc.batch.fusion.fuse import SETTLED_S, fuse
from distloc.batch.fusion.names import Names
from distloc.batch.fusion.place import squared
from distloc.filter.uncertainty import CHI2_95
from distloc.study.fleets.fleet import Fleet, drawn, reports
from distloc.study.runner import run_all
from distloc.types import FloatArray

FAR = 3.5  # of its told standard deviations: a drone that is off by more is confidently wrong


@dataclass(frozen=True, slots=True)
class FireScore:
    """One true fire at the end: fused of how many drones, the error, and whether the 95 % ellipse holds it.

    `least_m` is the smallest true error of a drone's own, `surest_m` the error of the one with the smallest ellipse;
    `own_inside` whether each drone's own ellipse holds it.
    """

    used: int
    error_m: float
    is_inside: bool
    least_m: float
    surest_m: float
    area_ratio: float
    own_inside: tuple[bool, ...]


@dataclass(frozen=True, slots=True)
class FleetScore:
    """One fleet. `longest_two_s`: how long one fire was two after both were confirmed, at most.

    What is outvoted counts for none there. `was_merged`: at some time two fires that were confirmed were told as one;
    `is_mixed`: at the end a fire is made of what belongs to two. `wrong` are crafts that are off by over 3.5 of their
    told standard deviations where two others see the same; `named` who was outvoted at the end, `ever` at any time.
    `renamed` counts how often a true fire's name changed after it had one of two drones or more.
    """

    drones: int
    true_fires: int
    has_worse: bool
    fires: tuple[FireScore, ...]
    longest_two_s: float
    was_merged: bool
    is_mixed: bool
    wrong: frozenset[str]
    named: frozenset[str]
    ever: frozenset[str]
    renamed: int


def score_all(
    fleets: int, jobs: int, seed: int, on_done: Callable[[int], None] = lambda done: None
) -> list[FleetScore]:
    """Fleets seeded `seed`, `seed` + 1 and so on."""
    return run_all(scored, range(seed, seed + fleets), jobs, on_done)


def scored(seed: int) -> FleetScore:
    """One drawn fleet."""
    fleet = drawn(seed)
    has_worse = any(craft.worse > 1.0 for craft in fleet.crafts)
    return score(reports(fleet), truths_of(fleet), fleet.fires_en_m, has_worse)


def truths_of(fleet: Fleet) -> dict[str, int]:
    """Which fire each claim is of."""
    return {f"{craft.name}/{fire}": fire for craft in fleet.crafts for fire in range(len(fleet.fires_en_m))}


def score(
    told: Iterable[tuple[float, Sequence[Claim]]], truth: Mapping[str, int], fires_en_m: FloatArray, has_worse: bool
) -> FleetScore:
    """`told` has what all have confirmed by each time, `truth` which fire (F, 2) each claim is of."""
    names, since, ever = Names(), dict[str, float](), set[str]()
    two_s, longest_s, before_s = np.zeros(len(fires_en_m)), 0.0, 0.0
    was_merged, is_mixed, renamed, called = False, False, 0, dict[int, str]()
    claims: Sequence[Claim] = ()
    fused: Sequence[FusedFire] = ()
    for time_s, claims in told:
        for one in claims:
            since.setdefault(one.name, time_s)
        fresh = {one.name for one in claims if time_s - since[one.name] < SETTLED_S}
        fused = fuse(claims, before=names.fire_of, fresh=fresh).fires
        given = names.name(fused, since)
        wrong = {word.name for one in fused for word in one.outvoted}
        ever |= {name.partition("/")[0] for name in wrong}
        apart = [one for one in fused if not (len(one.used) == 1 and one.used[0] in wrong)]
        was_merged |= len({truth[one.name] for one in claims}) > len(apart)
        is_mixed = any(len({truth[name] for name in one.used}) > 1 for one in fused)
        for fire in range(len(fires_en_m)):
            mine = [(one, name) for one, name in zip(fused, given, strict=True) if _is_of(one, fire, truth, wrong)]
            two_s[fire] = two_s[fire] + time_s - before_s if len(mine) > 1 else 0.0
            largest = max(mine, key=lambda one: len(one[0].used), default=None)
            if largest is not None and len(largest[0].used) > 1:
                renamed += called.get(fire, largest[1]) != largest[1]
                called[fire] = largest[1]
        longest_s, before_s = max(longest_s, float(two_s.max())), time_s
    by_name = {one.name: one for one in claims}
    scores = [_fire_score(fire, fused, by_name, truth, fires_en_m) for fire in range(len(fires_en_m))]
    found = tuple(score for score in scores if score is not None)
    named = frozenset(word.name.partition("/")[0] for one in fused for word in one.outvoted)
    drones = len({one.vehicle for one in claims})
    return FleetScore(
        drones=drones,
        true_fires=len(fires_en_m),
        has_worse=has_worse,
        fires=found,
        longest_two_s=longest_s,
        was_merged=was_merged,
        is_mixed=is_mixed,
        wrong=_wrong(claims, truth, fires_en_m),
        named=named,
        ever=frozenset(ever),
        renamed=renamed,
    )


def _is_of(one: FusedFire, fire: int, truth: Mapping[str, int], outvoted: set[str]) -> bool:
    return truth[one.used[0]] == fire and not (len(one.used) == 1 and one.used[0] in outvoted)


def _fire_score(
    fire: int, fused: Sequence[FusedFire], claims: Mapping[str, Claim], truth: Mapping[str, int], fires_en_m: FloatArray
) -> FireScore | None:
    """Of the fused fire that most of its claims went to; None where no two did."""
    mine = [one for one in fused if any(truth[name] == fire for name in one.used)]
    best = max(mine, key=lambda one: sum(truth[name] == fire for name in one.used), default=None)
    if best is None or len(best.used) < 2:
        return None
    place = fires_en_m[fire]
    own = [claims[name] for name in claims if truth[name] == fire]
    errors = [float(np.linalg.norm(one.position_en_m - place)) for one in own]
    areas = [float(np.sqrt(np.linalg.det(one.covariance_m2))) for one in own]
    return FireScore(
        used=len(best.used),
        error_m=float(np.linalg.norm(best.position_en_m - place)),
        is_inside=squared(best.position_en_m - place, best.covariance_m2) <= CHI2_95,
        least_m=min(errors),
        surest_m=errors[int(np.argmin(areas))],
        area_ratio=float(np.sqrt(np.linalg.det(best.covariance_m2))) / min(areas),
        own_inside=tuple(squared(one.position_en_m - place, one.covariance_m2) <= CHI2_95 for one in own),
    )


def _wrong(claims: Sequence[Claim], truth: Mapping[str, int], fires_en_m: FloatArray) -> frozenset[str]:
    """Vehicles far off, where two others tell of the same fire."""
    seen: dict[int, set[str]] = {}
    for one in claims:
        seen.setdefault(truth[one.name], set()).add(one.vehicle)
    return frozenset(
        one.vehicle
        for one in claims
        if len(seen[truth[one.name]]) > 2
        and squared(one.position_en_m - fires_en_m[truth[one.name]], one.covariance_m2) > FAR**2
    )
