"""Who is wrong where drones contradict each other: with two nobody knows, of three or more one is outvoted."""

import math
from collections.abc import Sequence

import numpy as np

from distloc.batch.fusion.claims import Claim
from distloc.batch.fusion.place import Estimate, intersected, squared
from distloc.tracks.assignment.matching import best_pairs
from distloc.types import FloatArray

OUTVOTED = 11.8  # chi squared, two degrees of freedom: 0.1 % of true claims are farther from the others
_AGREE = 2.4  # chi squared over its degrees of freedom of those that outvote: 95 % of three true ones are under it
_ASIDE_RAD = math.radians(25.0)  # a compass may be off by so much; and what is so near a target was in the picture too
_MOST_RATIO = 2.0  # of ranges


def odd_one(claims: Sequence[Claim]) -> int | None:
    """The claim that the others, two at least, outvote: without it they agree, and it is far from them."""
    if len(claims) < 3:
        return None
    best: tuple[float, int] | None = None
    for i in range(len(claims)):
        rest = [one for j, one in enumerate(claims) if j != i]
        among = estimate(rest)
        chi2 = among.chi2 / (2 * len(rest) - 2)
        if chi2 <= _AGREE and squares_from(claims[i], among.position_en_m, among.covariance_m2) > OUTVOTED:
            best = min(best or (math.inf, i), (chi2, i))
    return None if best is None else best[1]


def outvoted_of(claims: Sequence[Claim]) -> list[Claim]:
    """Claims of one fire that the others outvote, the one without which they agree best first."""
    left, found = list(claims), list[Claim]()
    while (odd := odd_one(left)) is not None:
        found.append(left.pop(odd))
    return found


def is_outvoted(claim: Claim, others: Sequence[Claim], place_en_m: FloatArray) -> bool:
    """Whether one vehicle alone has a fire beside that of others, two at least, and may mean the same.

    It lies in nearly the same direction from the vehicle, which says nothing of the others' place though that was in
    its picture; and two of the others, which looked there, say nothing of its.
    """
    if len(others) < 2 or not looked_at(claim, place_en_m):
        return False
    return sum(looked_at(one, claim.position_en_m) for one in others) >= 2


def moved_together(own: Sequence[Claim], others: Sequence[Estimate]) -> list[int]:
    """The place of others, by its number, that each of a vehicle's claims means; -1 for none, empty where all is well.

    Its compass is wrong where its claims fit more places of others once all are moved together, by more than they err.
    `others` are places that two other vehicles at least agree on.
    """
    as_told = sum(place >= 0 for place in _fitting(own, others, np.zeros(2)))
    best: list[int] = []
    for claim in own:
        for place in others:
            if not looked_at(claim, place.position_en_m):
                continue
            if squares_from(claim, place.position_en_m, place.covariance_m2) <= OUTVOTED:
                continue
            found = _fitting(own, others, place.position_en_m - claim.position_en_m)
            if sum(one >= 0 for one in found) > max(as_told, sum(one >= 0 for one in best)):
                best = found
    return best


def _fitting(own: Sequence[Claim], others: Sequence[Estimate], shift_en_m: FloatArray) -> list[int]:
    """The place that each claim fits once it is moved, no two the same."""
    squares = np.array(
        [
            [
                squared(one.position_en_m + shift_en_m - place.position_en_m, one.covariance_m2 + place.covariance_m2)
                for place in others
            ]
            for one in own
        ]
    ).reshape(len(own), len(others))
    found = [-1] * len(own)
    rows, columns = np.nonzero(squares < OUTVOTED)
    for pair in best_pairs(1.0 - squares[rows, columns] / OUTVOTED, rows, columns):
        found[int(rows[pair])] = int(columns[pair])
    return found


def squares_from(claim: Claim, place_en_m: FloatArray, covariance_m2: FloatArray) -> float:
    """How far a claim is from a place that it had no part in, in squared standard deviations."""
    return squared(claim.position_en_m - place_en_m, claim.covariance_m2 + covariance_m2)


def looked_at(claim: Claim, place_en_m: FloatArray) -> bool:
    east, north = place_en_m - claim.vehicle_en_m
    aside = (math.atan2(east, north) - claim.bearing_rad + math.pi) % (2.0 * math.pi) - math.pi
    ratio = math.hypot(east, north) / max(claim.range_m, 1e-9)
    return abs(aside) <= _ASIDE_RAD and 1.0 / _MOST_RATIO <= ratio <= _MOST_RATIO


def estimate(claims: Sequence[Claim]) -> Estimate:
    """What they agree on."""
    return intersected(*arrays(claims))


def arrays(claims: Sequence[Claim]) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Positions (N, 2), covariances and shared parts (N, 2, 2)."""
    return (
        np.array([one.position_en_m for one in claims]),
        np.array([one.covariance_m2 for one in claims]),
        np.array([one.shared_m2 for one in claims]),
    )
