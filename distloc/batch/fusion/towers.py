"""Towers' bearings to the fires of others: whose they are, what each mount is off by, and how much surer the fires get.

A tower's bearings share one error of its mount. That is found from all fires that it sees, together with their places:
Gauss-Newton over the places that were fused and the towers' errors, all in one system.
"""

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from distloc.batch.fusion.claims import Bearing, FusedFire, TowerBias
from distloc.types import FloatArray

_BIASES = 81  # tried, over four standard deviations to each side
_WIDTH = 4.0
_OTHERS = 0.2  # smokes of no known fire for each radian: one round the horizon
_SURE = 0.95  # that it is of this fire and of no other
_STEPS = 4
_MOST_FIRES = 64  # in one system; what comes after is only pointed at


@dataclass(frozen=True, slots=True)
class _Sight:
    """A bearing of a fire, both by their number, and how likely it is that."""

    bearing: int
    fire: int
    share: float


def tightened(fires: Sequence[FusedFire], bearings: Sequence[Bearing]) -> tuple[list[FusedFire], tuple[TowerBias, ...]]:
    """The fires with the bearings that are surely of them, and what the towers' mounts are found to be off by."""
    fires = list(fires)
    by_tower: dict[str, list[int]] = defaultdict(list)
    for index, one in enumerate(bearings):
        by_tower[one.tower].append(index)
    sights = [
        sight for own in by_tower.values() for sight in _sights(own, [bearings[i] for i in own], fires[:_MOST_FIRES])
    ]
    if not sights:
        return fires, ()
    return _solved(fires, bearings, sights)


def _sights(numbers: Sequence[int], bearings: Sequence[Bearing], fires: Sequence[FusedFire]) -> list[_Sight]:
    """Which fire each of one tower's bearings is of: by all that its mount may be off by, weighed by how all fit."""
    if not fires:
        return []
    azimuth, range_m, spread = _seen_from(bearings[0].position_en_m, fires)
    bias_sigma = bearings[0].bias_rad
    biases = np.linspace(-_WIDTH, _WIDTH, _BIASES) * bias_sigma
    told = np.array([one.azimuth_rad for one in bearings])
    sigma = np.array([one.sigma_rad for one in bearings])
    variance = sigma[:, None] ** 2 + spread**2  # (B, F)
    away = _wrapped(told[:, None] - azimuth - biases[:, None, None])  # (biases, B, F)
    density = np.exp(-0.5 * np.minimum(away**2 / variance, 1e3)) / np.sqrt(2.0 * np.pi * variance)
    density = np.where(range_m <= bearings[0].reach_m, density, 0.0)
    likelihood = np.concatenate([density, np.full((*density.shape[:2], 1), _OTHERS)], axis=2)
    whole = likelihood.sum(axis=2)  # (biases, B): of some fire, or of none that is known
    share = np.exp(np.log(whole).sum(axis=1) - 0.5 * np.square(biases / bias_sigma))
    votes = np.einsum("k,kbf->bf", share / share.sum(), likelihood / whole[:, :, None])
    found, taken = [], set[int]()
    for b in np.argsort(sigma, kind="stable"):
        fire = int(votes[b, :-1].argmax())
        if votes[b, fire] >= _SURE and fire not in taken:
            taken.add(fire)
            found.append(_Sight(numbers[int(b)], fire, float(votes[b, fire])))
    return found


def _solved(
    fires: list[FusedFire], bearings: Sequence[Bearing], sights: Sequence[_Sight]
) -> tuple[list[FusedFire], tuple[TowerBias, ...]]:
    used = sorted({one.fire for one in sights})
    towers = sorted({bearings[one.bearing].tower for one in sights})
    column = {fire: 2 * index for index, fire in enumerate(used)}
    bias_column = {tower: 2 * len(used) + index for index, tower in enumerate(towers)}
    size = 2 * len(used) + len(towers)
    prior = np.concatenate([fires[one].position_en_m for one in used] + [np.zeros(len(towers))])
    information = np.zeros((size, size))
    for fire, at in column.items():
        information[at : at + 2, at : at + 2] = np.linalg.inv(fires[fire].covariance_m2)
    for one in bearings:
        if one.tower in bias_column:
            information[bias_column[one.tower], bias_column[one.tower]] = one.bias_rad**-2
    state = prior.copy()
    for _ in range(_STEPS):
        H, r, weight = _linear(state, bearings, sights, column, bias_column)
        total = information + (H.T * weight) @ H
        state = prior + np.linalg.solve(total, (H.T * weight) @ (r + H @ (state - prior)))
    covariance = np.linalg.inv(total)
    names: dict[int, list[str]] = defaultdict(list)
    for sight in sights:
        names[sight.fire].append(bearings[sight.bearing].name)
    shares = {fire: float(np.prod([one.share for one in sights if one.fire == fire])) for fire in used}
    for fire, at in column.items():
        P = np.asarray(covariance[at : at + 2, at : at + 2], np.float64)
        found_there = _mixed(fires[fire], state[at : at + 2], P, shares[fire])
        fires[fire] = replace(found_there, bearings=tuple(sorted(names[fire])))
    found = tuple(
        TowerBias(
            tower,
            float(state[at]),
            float(np.sqrt(covariance[at, at])),
            sum(bearings[one.bearing].tower == tower for one in sights),
        )
        for tower, at in bias_column.items()
    )
    return fires, found


def _mixed(fire: FusedFire, position_en_m: FloatArray, covariance_m2: FloatArray, share: float) -> FusedFire:
    """The mean and covariance of both: where the bearings are of it, at (2,) with (2, 2), and where they are not."""
    away = position_en_m - fire.position_en_m
    P = share * covariance_m2 + (1.0 - share) * fire.covariance_m2 + share * (1.0 - share) * np.outer(away, away)
    return replace(fire, position_en_m=fire.position_en_m + share * away, covariance_m2=0.5 * (P + P.T))


def _linear(
    state: FloatArray,
    bearings: Sequence[Bearing],
    sights: Sequence[_Sight],
    column: dict[int, int],
    bias_column: dict[str, int],
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """The azimuths' Jacobian (S, states), their residuals (S,) and weights (S,) at a state."""
    H, r, weight = np.zeros((len(sights), state.size)), np.zeros(len(sights)), np.zeros(len(sights))
    for row, sight in enumerate(sights):
        one, at = bearings[sight.bearing], column[sight.fire]
        east, north = state[at : at + 2] - one.position_en_m
        square = max(east * east + north * north, 1.0)
        H[row, at : at + 2] = north / square, -east / square
        H[row, bias_column[one.tower]] = 1.0
        r[row] = _wrapped(one.azimuth_rad - np.arctan2(east, north) - state[bias_column[one.tower]])
        weight[row] = one.sigma_rad**-2
    return H, r, weight


def _seen_from(place_en_m: FloatArray, fires: Sequence[FusedFire]) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Azimuth, range and the azimuth's standard deviation (F,) of fires."""
    away = np.array([one.position_en_m for one in fires]) - place_en_m
    square = np.maximum(np.square(away).sum(axis=1), 1.0)
    across = np.stack([away[:, 1], -away[:, 0]], axis=1) / square[:, None]
    P = np.array([one.covariance_m2 for one in fires])
    spread = np.sqrt(np.einsum("fi,fij,fj->f", across, P, across))
    return np.arctan2(away[:, 0], away[:, 1]), np.sqrt(square), spread


def _wrapped(angle_rad: FloatArray) -> FloatArray:
    return np.asarray((angle_rad + np.pi) % (2.0 * np.pi) - np.pi)
