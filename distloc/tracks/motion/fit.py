"""Where targets are and how they move, by all their bearings at once, and how well priors of motion explain these.

Levenberg and Marquardt for the maximum of the posterior, Laplace's approximation for the evidence (Kass and Raftery
1995, 4.1). On one straight course a source that moves evenly looks like one that stands elsewhere: the evidence is then
as good, and the priors alone decide. `judge` calls it.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from distloc.tracks.motion.bearings import AZIMUTH, EAST, MOST, NORTH, TIME, Bearings, correlated
from distloc.types import FloatArray

SPEEDS_MPS = (1e-3, 0.4, 6.0)  # one standard deviation on each axis: it stands, creeps, is driven
_ITERATIONS = 7
_LOG_RANGE = 1.5  # one standard deviation of the range's logarithm about the cloud's
_MOST_STEP = np.array([0.3, 0.5, 5.0, 5.0])
_AIM_TURN_RAD = 0.1


@dataclass(frozen=True, slots=True)
class Fit:
    """Of k targets by 3 priors: logarithms (k, 3) of the evidence; place and velocity now (k, 3, 2); covariances.

    `place_m2` (k, 3, 2, 2) is east and north.
    """

    log_evidence: FloatArray
    place_m: FloatArray
    velocity_mps: FloatArray
    place_m2: FloatArray


def fitted(bearings: Sequence[Bearings], about_m: FloatArray, aim_rad: FloatArray) -> Fit:
    """Begin at about (k, 2); the aim errs by `aim_rad` (k,), the same way for a while."""
    rows = np.array([one.held for one in bearings])
    is_held = np.arange(MOST) < np.array([[one.count] for one in bearings])
    last = rows[np.arange(len(bearings)), [one.count - 1 for one in bearings]]
    since_s = (rows[:, :, TIME] - last[:, TIME, None])[:, None]
    cameras_m, from_m = rows[:, None, :, [EAST, NORTH]], last[:, None, [EAST, NORTH]]
    azimuth = rows[:, None, :, AZIMUTH]
    covariance: FloatArray = correlated(rows, is_held, aim_rad, _AIM_TURN_RAD)
    whiten = np.linalg.inv(np.linalg.cholesky(covariance))[:, None]
    offset_m = about_m - from_m[:, 0]
    x = np.zeros((len(bearings), len(SPEEDS_MPS), 4))
    x[:, :, 0] = np.arctan2(offset_m[:, 0], offset_m[:, 1])[:, None]
    x[:, :, 1] = np.log(np.maximum(np.hypot(*offset_m.T), 1.0))[:, None]
    start = x.copy()
    prior = np.zeros((len(SPEEDS_MPS), 4))  # of the azimuth nothing
    prior[:, 1], prior[:, 2:] = _LOG_RANGE**-2, np.array(SPEEDS_MPS)[:, None] ** -2.0
    best, damping = np.full(x.shape[:2], np.inf), np.full(x.shape[:2], 1e-3)
    kept, information, descent = x.copy(), np.zeros((*x.shape, 4)), np.zeros_like(x)
    for _ in range(_ITERATIONS):
        range_m = np.exp(x[:, :, 1, None])
        along = np.stack([np.sin(x[:, :, 0]), np.cos(x[:, :, 0])], axis=2)
        aside = np.stack([along[:, :, 1], -along[:, :, 0]], axis=2)
        place_m = from_m + range_m * along
        line_m = place_m[:, :, None] + x[:, :, None, 2:] * since_s[..., None] - cameras_m
        squared = np.maximum(np.square(line_m).sum(axis=3), 1.0)
        off = (azimuth - np.arctan2(line_m[..., 0], line_m[..., 1]) + np.pi) % (2.0 * np.pi) - np.pi
        by_place = np.stack([line_m[..., 1], -line_m[..., 0]], axis=3) / squared[..., None] * is_held[:, None, :, None]
        J = np.empty((*off.shape, 4))
        J[..., 0] = (by_place * (range_m * aside)[:, :, None]).sum(axis=3)
        J[..., 1] = (by_place * (range_m * along)[:, :, None]).sum(axis=3)
        J[..., 2:] = by_place * since_s[..., None]
        J, white = whiten @ J, (whiten @ (off * is_held[:, None])[..., None])
        apart = x - start
        cost = np.square(white).sum(axis=(2, 3)) + (prior * np.square(apart)).sum(axis=2)
        A = J.swapaxes(2, 3) @ J
        A[..., range(4), range(4)] += prior + 1e-9
        is_better = cost < best
        best = np.where(is_better, cost, best)
        kept[is_better], information[is_better] = x[is_better], A[is_better]
        descent[is_better] = ((J.swapaxes(2, 3) @ white)[..., 0] - prior * apart)[is_better]
        damping = np.where(is_better, 0.1 * damping, 30.0 * damping)
        damped = information + damping[..., None, None] * information * np.eye(4)
        step = np.linalg.solve(damped, descent[..., None])[..., 0]
        x = kept + np.clip(step, -_MOST_STEP, _MOST_STEP)
    return _result(kept, information, best, from_m, prior)


def _result(x: FloatArray, information: FloatArray, cost: FloatArray, from_m: FloatArray, prior: FloatArray) -> Fit:
    log_evidence = 0.5 * (np.log(prior[:, 2:]).sum(axis=1) - np.linalg.slogdet(information)[1] - cost)
    range_m = np.exp(x[:, :, 1, None])
    along = np.stack([np.sin(x[:, :, 0]), np.cos(x[:, :, 0])], axis=2)
    aside = np.stack([along[:, :, 1], -along[:, :, 0]], axis=2)
    by_x = np.stack([range_m * aside, range_m * along], axis=3)
    covariance = by_x @ np.linalg.inv(information)[..., :2, :2] @ by_x.swapaxes(2, 3)
    return Fit(log_evidence, from_m + range_m * along, x[:, :, 2:], covariance)
