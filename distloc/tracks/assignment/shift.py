"""What a frame has in common: its attitude's own error moves all that is expected in it by the same angle.

By itself each track must allow for that error, and where fires stand closer in the picture than it is large any track
may take its neighbour's segment. Together they tell the error: under one shift most of them are where they are
expected, and by that each is then looked for closely. Where more than one shift explains the frame, as when only the
first of several fires has come back into the picture, nobody knows yet which track a segment is of.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from distloc.filter.bank import Bank, Fit
from distloc.filter.particles import Places
from distloc.filter.platforms import kept_until
from distloc.sights.sight import NUISANCES
from distloc.types import BoolArray, CameraPose, FloatArray, PoseErrors

_TRIED = 32  # pairs whose shift is tried, the surest
LEAST_RAD = 1e-3  # one standard deviation of what else moves each by itself: roll, for one
_ROUNDING = 1e-12  # squared radians
_WHOLLY = 1.0  # of what is expected: what saw more of late than the others is not moved with them
_MISSING = math.log(0.3)  # of how likely it is that what must be in the picture shows no segment
DECIDED = math.log(50.0)  # odds of one shift against another


@dataclass(frozen=True, slots=True)
class Pairs:
    """p pairs of tracks and rays: their fit and the logarithms (p,) of how much likelier they are than false ones."""

    track: NDArray[np.intp]
    ray: NDArray[np.intp]
    fit: Fit
    scores: FloatArray


def drift_of(before_s: float, pose: CameraPose, errors: PoseErrors) -> FloatArray:
    """The covariance (3, 3), about east, north and up, of what is new of the attitude's slow error since a time."""
    if pose.attitude is not None:  # what is found of it is known to all targets already
        return pose.attitude.new if pose.attitude.found_rad is None else np.zeros((3, 3))
    kept = float(kept_until(pose.stamp_s, np.array([before_s]), errors.bias_time_constant_s)[0])
    return (1.0 - kept**2) * errors.bias_variance


@dataclass(frozen=True, slots=True)
class Carried:
    """By how much the attitude's slow error is another (3,), and how much surer that makes it (3, 3)."""

    turn_rad: FloatArray
    variance: FloatArray

    def give(self, bank: Bank, places: Places) -> None:
        """To targets that this frame did not show, and that have seen nothing of it; not to those that are surer."""
        P = bank.P[places]
        P[:, :3, :3] -= self.variance
        is_less = np.linalg.eigvalsh(P[:, :NUISANCES, :NUISANCES])[:, 0] > -_ROUNDING
        places, particles = places[is_less], bank.particles
        if places.size:
            particles.x[places, 3:6] += (self.turn_rad / particles.scale[places, :3]).astype(np.float32)[:, :, None]
            bank.P[places] = P[is_less]
            particles.measure(places)


@dataclass(frozen=True, slots=True)
class Judged:
    """The scores (p,) by what the other tracks tell of the shift; of which pairs (p,) another shift says otherwise.

    And what each pair tells of the shift: its information (p, 2, 2), and that times the shift (p, 2).
    """

    scores: FloatArray
    is_open: BoolArray
    information: FloatArray
    weighed: FloatArray


def carried(judged: Judged, chosen: list[int], common: FloatArray, drift: FloatArray, by_bias: FloatArray) -> Carried:
    """What the chosen pairs tell of the attitude's slow error, of which so much (3, 3) is new.

    `by_bias` (2, 3) is where the truth lies, right and up of what is measured, by that error.
    """
    by_common = _inverse(common)
    told = _inverse(by_common + judged.information[chosen].sum(axis=0))
    gain = drift @ by_bias.T @ by_common
    turn = gain @ told @ judged.weighed[chosen].sum(axis=0)
    return Carried(turn, gain @ (common - told) @ gain.T)


def judged(pairs: Pairs, common: FloatArray, room: FloatArray) -> Judged:
    """By h shifts that are tried.

    `common` (2, 2) is the covariance of the shift, right and up. `room` (tracks, 2, 2) is how far what is expected of
    each is from the picture's lower left corner and its upper right one, in tangents; NaN of what need not show. A
    track's own pairs have no say in the shift that is assumed for it, so a lone one is judged as before.
    """
    fit, values = pairs.fit, pairs.fit.innovation
    whole = fit.covariance
    is_moved = _largest_share(common, whole) < _WHOLLY
    own: FloatArray = whole - is_moved[:, None, None] * common + LEAST_RAD**2 * np.eye(2)
    by_own, by_common, size = _inverse(own), _inverse(common), _log_det(own)
    votes = is_moved[:, None, None] * by_own
    weighed = (votes @ values[:, :, None])[:, :, 0]
    alone = pairs.scores + 0.5 * (_squared(values, _inverse(whole)) + _log_det(whole))

    def scores_by(shifts: FloatArray) -> FloatArray:
        return np.asarray(alone - 0.5 * (_squared(values - is_moved[:, None] * shifts[:, None], by_own) + size))

    shifts = values[np.argsort(size + 1e3 * ~is_moved, kind="stable")[:_TRIED]]
    for _ in range(2):
        is_best, sums = _best(scores_by(shifts), pairs)
        told = by_common + np.tensordot(is_best, votes, axes=1)
        shifts = (_inverse(told) @ (is_best @ weighed)[:, :, None])[:, :, 0]
    is_best, sums = _best(scores_by(shifts), pairs)
    likely = sums - 0.5 * (_squared(shifts, by_common) + _log_det(told) + _log_det(common))
    is_found = np.zeros((len(shifts), len(room)), np.bool_)
    np.logical_or.at(is_found.T, pairs.track, is_best.T)
    with np.errstate(invalid="ignore"):
        is_inside = (room[:, 0] - shifts[:, None] > 0.0).all(axis=2) & (room[:, 1] + shifts[:, None] > 0.0).all(axis=2)
    likely += _MISSING * (is_inside & ~is_found).sum(axis=1)
    first = int(likely.argmax())
    is_rival = likely > likely[first] - DECIDED
    is_other = (is_best[is_rival] != is_best[first]).any(axis=0)
    is_open = np.bincount(pairs.track[is_other], minlength=len(room)).astype(np.bool_)
    mine, by_all, off = np.flatnonzero(is_best[first]), np.zeros((len(room), 2, 2)), np.zeros((len(room), 2))
    by_all[pairs.track[mine]], off[pairs.track[mine]] = votes[mine], weighed[mine]
    rest = _inverse(by_common + by_all.sum(axis=0) - by_all)
    off = (rest @ (off.sum(axis=0) - off)[:, :, None])[:, :, 0]
    spread = own + is_moved[:, None, None] * rest[pairs.track]
    squared = _squared(values - is_moved[:, None] * off[pairs.track], _inverse(spread))
    return Judged(alone - 0.5 * (squared + _log_det(spread)), is_open[pairs.track], votes, weighed)


def _largest_share(part: FloatArray, whole: FloatArray) -> FloatArray:
    """The most (p,) that a covariance (2, 2) is of others (p, 2, 2), on any axis."""
    share = _inverse(whole) @ part
    half = np.trace(share, axis1=1, axis2=2) / 2.0
    return np.asarray(half + np.sqrt(np.maximum(half**2 - np.linalg.det(share), 0.0)))


def _best(scores: FloatArray, pairs: Pairs) -> tuple[BoolArray, FloatArray]:
    """Each track's best pair (h, p) under h shifts, where it has a likely one; at most how likely (h,) all are at once.

    Two tracks may have the same ray: then the better counts.
    """
    scores = np.maximum(scores, 0.0)
    by_track, by_ray = np.zeros((len(scores), pairs.track.max() + 1)), np.zeros((len(scores), pairs.ray.max() + 1))
    np.maximum.at(by_track.T, pairs.track, scores.T)
    is_best = (scores > 0.0) & (scores == by_track[:, pairs.track])
    np.maximum.at(by_ray.T, pairs.ray, (scores * is_best).T)
    return is_best, by_ray.sum(axis=1)


def _squared(off: FloatArray, inverse: FloatArray) -> FloatArray:
    return np.asarray(((off[..., None, :] @ inverse)[..., 0, :] * off).sum(axis=-1))


def _inverse(covariance: FloatArray) -> FloatArray:
    return np.asarray(np.linalg.inv(covariance), np.float64)


def _log_det(covariance: FloatArray) -> FloatArray:
    return np.asarray(np.log(np.linalg.det(covariance)))
