"""One place from several claims whose errors are partly their own and partly shared, by split covariance intersection.

Julier and Uhlmann (2001), "General decentralized data fusion with covariance intersection", section 12.4: the shared
part of each covariance is divided by the claim's weight, the weights sum to 1, and so whatever the shared errors have
in common the result's covariance is no smaller than its error's.
"""

import itertools
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from distloc.filter.uncertainty import CHI2_95, LEVEL
from distloc.types import FloatArray

SCALES = (1.0, 2.0, 4.0, 8.0)  # by which a drone's errors may be larger than it tells
PRIOR = (0.80, 0.11, 0.06, 0.03)  # of each: chosen by seeds under 2000 of `study fleets`
_STEPS = 12
_MOST_PAIRED = 6  # claims of which two at once may be worse than told; of more one at a time
_LEAST_SHARE = 1e-3
_RINGS, _RAYS = 24, 12  # of a Gaussian, to find how much of a mixture an ellipse holds


@dataclass(frozen=True, slots=True)
class Estimate:
    """A place (2,), its covariance (2, 2), and chi squared of the claims about it by their whole covariances."""

    position_en_m: FloatArray
    covariance_m2: FloatArray
    chi2: float


@dataclass(frozen=True, slots=True)
class Doubted:
    """A place (2,) whose covariance (2, 2) makes the 95 % ellipse that holds 95 % of what the place may be.

    `larger` is by how much that is larger than if all erred as they tell; `scales` (N, S) is how likely each claim is
    that of a drone whose errors are `SCALES` times what it tells.
    """

    position_en_m: FloatArray
    covariance_m2: FloatArray
    larger: float
    scales: FloatArray


def intersected(positions_en_m: FloatArray, covariances_m2: FloatArray, shared_m2: FloatArray) -> Estimate:
    """Of positions (N, 2), covariances (N, 2, 2) and the parts of these that are shared (N, 2, 2)."""
    if len(positions_en_m) == 1:
        return Estimate(positions_en_m[0], covariances_m2[0], 0.0)
    position, covariance = _intersected(positions_en_m, (covariances_m2 - shared_m2)[None], shared_m2)
    chi2 = _chi2(positions_en_m, position, covariances_m2[None])
    return Estimate(position[0], covariance[0], float(chi2[0]))


def doubted(
    positions_en_m: FloatArray, covariances_m2: FloatArray, shared_m2: FloatArray, prior: FloatArray
) -> Doubted:
    """The place where each drone may be worse than it tells: `prior` (N, S) has the shares of `SCALES` for each.

    Every way in which none, one or two of the drones are worse gives a place of its own, weighed by how well the claims
    fit it then (the likelihood of all but their common place). The result has the mixture's mean; of two that
    contradict each other its ellipse holds both. Nothing is surer than with all as told.
    """
    count = len(positions_en_m)
    if count == 1:
        return Doubted(positions_en_m[0], covariances_m2[0], 1.0, prior)
    ways = _ways(count)
    scale = np.square(np.asarray(SCALES)[ways])[:, :, None, None]
    own = (covariances_m2 - shared_m2) * scale
    places, covariances = _intersected(positions_en_m, own, shared_m2)
    whole = own + shared_m2
    log = -0.5 * (_chi2(positions_en_m, places, whole) + np.log(np.linalg.det(whole)).sum(axis=1))
    log += 0.5 * np.log(np.linalg.det(covariances)) + np.log(prior[np.arange(count), ways]).sum(axis=1)
    share = np.exp(log - log.max())
    share /= share.sum()
    scales = np.stack([(share[:, None] * (ways == s)).sum(axis=0) for s in range(len(SCALES))], axis=1)
    position = share @ places
    away = places - position
    covariance = np.einsum("m,mij->ij", share, covariances + away[:, :, None] * away[:, None, :])
    covariance = covariance * _holding(share, away, covariances, covariance)
    larger = float(np.sqrt(np.linalg.det(covariance) / np.linalg.det(covariances[0])))
    if larger < 1.0:
        covariance, larger = covariance / larger, 1.0
    return Doubted(np.asarray(position), 0.5 * (covariance + covariance.T), larger, scales)


def _ways(count: int) -> NDArray[np.intp]:
    """Which scale (ways, N) each claim has: all as told first, then one worse, then two."""
    worse = range(1, len(SCALES))
    found = [np.zeros(count, np.intp)]
    for rows in [(i,) for i in range(count)] + (
        list(itertools.combinations(range(count), 2)) if count <= _MOST_PAIRED else []
    ):
        for scales in itertools.product(worse, repeat=len(rows)):
            way = np.zeros(count, np.intp)
            way[list(rows)] = scales
            found.append(way)
    return np.array(found)


def _intersected(
    positions_en_m: FloatArray, own_m2: FloatArray, shared_m2: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Places (M, 2) and covariances (M, 2, 2) by M ways in which the claims' own parts (M, N, 2, 2) may be.

    The weights are those with the least trace. By A-optimality's multiplicative step: at the best weights, each one's
    square is in proportion to what its shared part adds to the trace.
    """
    weights = np.full(own_m2.shape[:2], 1.0 / own_m2.shape[1])
    for _ in range(_STEPS):
        information = np.linalg.inv(own_m2 + shared_m2 / weights[..., None, None])
        gains = np.linalg.inv(information.sum(axis=1))[:, None] @ information
        added = ((gains @ shared_m2) * gains).sum(axis=(2, 3))
        roots = np.sqrt(np.maximum(added, 0.0)) + 1e-12
        weights = np.maximum(roots / roots.sum(axis=1, keepdims=True), 1e-6)
        weights /= weights.sum(axis=1, keepdims=True)
    information = np.linalg.inv(own_m2 + shared_m2 / weights[..., None, None])
    covariance = np.linalg.inv(information.sum(axis=1))
    position = (covariance @ (information @ positions_en_m[:, :, None]).sum(axis=1))[:, :, 0]
    return position, 0.5 * (covariance + covariance.swapaxes(1, 2))


def _chi2(positions_en_m: FloatArray, places_en_m: FloatArray, whole_m2: FloatArray) -> FloatArray:
    """Of the claims about each of M places, by covariances (M, N, 2, 2)."""
    away = positions_en_m - places_en_m[:, None]
    return np.asarray((away * np.linalg.solve(whole_m2, away[..., None])[..., 0]).sum(axis=(1, 2)))


def _holding(share: FloatArray, away_m: FloatArray, covariances_m2: FloatArray, whole_m2: FloatArray) -> float:
    """By how much a covariance is to be scaled for its 95 % ellipse to hold 95 % of a mixture about its middle."""
    rows = np.flatnonzero(share > _LEAST_SHARE)
    level = (np.arange(_RINGS) + 0.5) / _RINGS
    radius, angle = np.sqrt(-2.0 * np.log1p(-level)), 2.0 * np.pi * np.arange(_RAYS) / _RAYS
    points = (radius[:, None, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)).reshape(-1, 2)
    spread = away_m[rows][:, None] + points @ np.linalg.cholesky(covariances_m2[rows]).swapaxes(1, 2)
    squares = np.einsum("mki,ij,mkj->mk", spread, np.linalg.inv(whole_m2), spread).ravel()
    weight = np.repeat(share[rows], len(points))
    order = np.argsort(squares)
    held = np.cumsum(weight[order])
    return float(np.interp(LEVEL * held[-1], held, squares[order]) / CHI2_95)


def squared(away_m: FloatArray, covariance_m2: FloatArray) -> float:
    """Mahalanobis' distance, squared, of an offset (2,)."""
    return float(away_m @ np.linalg.solve(covariance_m2, away_m))
