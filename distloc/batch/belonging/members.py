"""Which sightings are of one place: robust, and with each platform's error found out on the way.

Points where two lines of sight come near each other are tried, and each is judged by a Kalman filter of its own over
the platforms' errors, which leaves out what does not fit. So a compass that is three degrees off hides no sighting of
another thing one degree beside: once its error is known the gate is as narrow as the white errors are.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from distloc.batch.chain import LEAST_VARIANCE, Whitening, noise_of, whitening_of
from distloc.batch.lines import IntArray, Lines
from distloc.batch.scales import SCALES, Scale
from distloc.types import BoolArray, FloatArray

_MISFIT = 0.02  # share of the sightings that are of something else, anywhere within
_ANYWHERE_SR = 0.5  # this part of the sky
GATE = 20.0  # squared standard deviations of two numbers: 5 in 100,000 of what fits are outside
AGREE, _MINUTE_S = 12.0, 60.0  # the same of two sightings in one picture: 2 in 1000 are farther apart
_MOST_PAIRS, _MOST_JUDGED = 192, 160
_MOST_SCALES, _REFINED, _ROUNDS = 3, 4, 3  # that are looked at closely, points of each, how often


@dataclass(frozen=True, slots=True)
class Members:
    """Which of N lines belong to a place near `point_enu_m` (3,), and how unlikely the others are."""

    point_enu_m: FloatArray
    is_member: BoolArray  # (N,)
    squared: FloatArray  # (N,) of each one's innovation, by its covariance
    score: float


def members_of(lines: Lines, range_m: tuple[float, float], scales: Sequence[Scale] = SCALES) -> Members:
    """The sightings that agree best."""
    few = lines.of(_thinned(lines))
    points = candidates(few, range_m)
    score, fits, _ = judged(few, np.tile(points, (len(scales), 1)), np.repeat(np.array(scales), len(points), axis=0))
    score, fits = score.reshape(len(scales), -1), fits.reshape(len(scales), len(points), -1)
    first = np.argsort(-score.max(axis=1), kind="stable")[:_MOST_SCALES]
    leading = np.argsort(-score[first], axis=1, kind="stable")[:, :_REFINED]  # (scales, points)
    near, fits = points[leading], fits[first[:, None], leading]
    top = first[0], int(leading[0, 0])
    best: tuple[float, FloatArray, Scale] = float(score[top]), points[top[1]], scales[first[0]]
    refine = _Refining(few)
    going = np.arange(len(first))  # scales of which the last round found something better
    for _ in range(_ROUNDS):
        near = np.stack(
            [[refine.better(p, own) for p, own in zip(*one, strict=True)] for one in zip(near, fits, strict=True)]
        )
        each = np.repeat(np.array([scales[i] for i in first[going]]), near.shape[1], axis=0)
        flat, flat_fits, _ = judged(few, near.reshape(-1, 3), each)
        score, fits = flat.reshape(near.shape[:2]), flat_fits.reshape(*near.shape[:2], -1)
        is_better = score.max(axis=1) > best[0] + 1e-3
        for k in np.flatnonzero(is_better).tolist():
            if score[k].max() > best[0]:
                best = float(score[k].max()), near[k, int(np.argmax(score[k]))], scales[first[going[k]]]
        going, near, fits = going[is_better], near[is_better], fits[is_better]
        if not len(going):
            break
    _, point, scale = best
    last, is_member, squared = judged(lines, point[None], np.array([scale]))
    return Members(point, _one_a_picture(lines, is_member[0], squared[0], point, scale), squared[0], float(last[0]))


def judged(lines: Lines, points_enu_m: FloatArray, scales: FloatArray) -> tuple[FloatArray, BoolArray, FloatArray]:
    """For each point (K, 3), by scales (K, 2) of the white errors, the log of its likelihood (K,), which lines fit it
    (K, N), and how well (K, N).
    """
    n, k = len(lines), len(points_enu_m)
    sizes, which = np.unique(scales, axis=0, return_inverse=True)
    which = which.reshape(-1)
    places, of_place = np.unique(points_enu_m, axis=0, return_inverse=True)
    of_place = of_place.reshape(-1)
    residuals, range_m = lines.residuals(places), lines.ranges_m(places)
    near = np.square(lines.position_m[:, None] / np.maximum(range_m, 1.0))
    noise = np.stack(
        [noise_of(lines, heading, scatter, np.full(n, np.inf)) for heading, scatter in sizes.tolist()], axis=-1
    )
    score, fits, squared = np.zeros(k), np.zeros((n, k), np.bool_), np.zeros((n, k))
    mean, P = np.zeros((3, k)), np.zeros((3, 3, k))
    log_missed = math.log(_MISFIT / _ANYWHERE_SR)
    log_whole = math.log(1.0 - _MISFIT) - math.log(2.0 * math.pi)
    for i, share in enumerate(lines.kept.tolist()):
        H = lines.to_bias[i]
        if share == 0.0:
            mean[:], P[:] = 0.0, 0.0
        elif share != 1.0:
            mean *= share
            P *= share * share
        if share != 1.0:
            P[range(3), range(3)] += ((1.0 - share * share) * lines.bias_variance[i])[:, None]
        HP = (H @ P.reshape(3, -1)).reshape(2, 3, k)
        own = noise[i][:, :, which]
        own_near = near[i][of_place]
        a = H[0] @ HP[0] + own[0, 0] + own_near
        b = H[1] @ HP[0] + own[0, 1]
        c = H[1] @ HP[1] + own[1, 1] + own_near
        determinant = a * c - b * b
        across, upright = residuals[i][:, of_place] - H @ mean
        u, v = (c * across - b * upright) / determinant, (a * upright - b * across) / determinant
        squared[i] = across * u + upright * v
        log_fit = log_whole - 0.5 * squared[i] - 0.5 * np.log(determinant)
        is_fit = (squared[i] < GATE) & (log_fit > log_missed)
        fits[i] = is_fit
        score += np.where(is_fit, log_fit, log_missed)
        mean += (HP[0] * u + HP[1] * v) * is_fit
        weight = is_fit / determinant
        first, second = (HP[0] * c - HP[1] * b) * weight, (HP[1] * a - HP[0] * b) * weight
        P -= first[:, None] * HP[0][None] + second[:, None] * HP[1][None]
    return score, fits.T, squared.T


def candidates(lines: Lines, range_m: tuple[float, float]) -> FloatArray:
    """Points (K, 3) that the lines may be of: where two of them come near each other, and some along single ones."""
    n = len(lines)
    far_m = np.geomspace(max(range_m[0], 1.0), range_m[1], 12)
    few = np.unique(np.linspace(0, n - 1, min(n, 4)).astype(np.intp))
    along = lines.position_enu_m[few, None] + far_m[None, :, None] * lines.direction_enu[few, None]
    points = [along.reshape(-1, 3)]
    if n > 1:
        first, second = _pairs(n)
        p, q = lines.position_enu_m[first], lines.position_enu_m[second]
        u, v = lines.direction_enu[first], lines.direction_enu[second]
        between = np.einsum("ni,ni->n", u, v)
        w = q - p
        flat = np.maximum(1.0 - between**2, 1e-9)
        s = (np.einsum("ni,ni->n", w, u) - between * np.einsum("ni,ni->n", w, v)) / flat
        t = (between * np.einsum("ni,ni->n", w, u) - np.einsum("ni,ni->n", w, v)) / flat
        is_ahead = (s > range_m[0]) & (t > range_m[0]) & (s < range_m[1]) & (t < range_m[1])
        points.append((0.5 * (p + s[:, None] * u + q + t[:, None] * v))[is_ahead])
    return np.concatenate(points)


def least_squares(lines: Lines, weights: FloatArray) -> FloatArray | None:
    """The point (3,) nearest to lines by weights (N,); None where they are parallel."""
    across = np.eye(3) - lines.direction_enu[:, :, None] * lines.direction_enu[:, None, :]
    A = np.einsum("n,nij->ij", weights, across)
    values = np.linalg.eigvalsh(A)
    if values[0] < 1e-9 * values[2]:
        return None
    return np.asarray(np.linalg.solve(A, np.einsum("n,nij,nj->i", weights, across, lines.position_enu_m)))


class _Refining:
    """Better points for what fits: steps of Gauss and Newton with the platforms' errors marginalised out.

    Points whose fitting lines are the same share what whitens these, by the ranges of the first of them.
    """

    def __init__(self, lines: Lines) -> None:
        self._lines = lines
        self._whitening: dict[bytes, tuple[Lines, Whitening]] = {}

    def better(self, point: FloatArray, fits: BoolArray) -> FloatArray:
        """A point (3,) nearer to where the lines that fit (N,) have it."""
        if fits.sum() < 2:
            return point
        key = fits.tobytes()
        if key not in self._whitening:
            own = self._lines.of(fits)
            self._whitening[key] = own, whitening_of(own, noise_of(own, 0.0, 0.0, own.ranges_m(point[None])[:, 0]))
        own, whitening = self._whitening[key]
        for _ in range(2):
            range_m = float(own.ranges_m(point[None]).min())
            size_m = 1e-4 * range_m + 1e-3
            tried = np.concatenate([point[None], point + size_m * np.eye(3)])
            white = whitening.whitened(own.residuals(tried)).reshape(-1, 4)
            J = (white[:, 1:] - white[:, :1]) / size_m
            A = J.T @ J
            A.flat[::4] += 1e-9 * np.trace(A) + 1e-30
            step = -np.linalg.solve(A, J.T @ white[:, 0])
            length = float(np.linalg.norm(step))
            point = point + step * min(1.0, 0.5 * range_m / max(length, 1e-9))
        return np.asarray(point)


def _pairs(n: int) -> tuple[IntArray, IntArray]:
    """Pairs of N, spread over all of them; the same always."""
    first, second = np.triu_indices(n, 1)
    if len(first) > _MOST_PAIRS:
        chosen = np.random.default_rng(0).permutation(len(first))[:_MOST_PAIRS]
        chosen.sort()
        first, second = first[chosen], second[chosen]
    return np.asarray(first, np.intp), np.asarray(second, np.intp)


def _thinned(lines: Lines) -> BoolArray:
    """Which lines judge the points: at most so many, evenly by their order, some of each platform."""
    n = len(lines)
    judges = np.zeros(n, np.bool_)
    judges[np.unique(np.linspace(0, n - 1, min(n, _MOST_JUDGED)).astype(np.intp))] = True
    return judges


def _one_a_picture(
    lines: Lines, is_member: BoolArray, squared: FloatArray, point: FloatArray, scale: Scale
) -> BoolArray:
    """A picture shows a place once: of a platform's sightings at one time the best is kept, and what agrees with it.

    That is what looks the same way within what white errors allow; those that were found out as well where times are
    told in whole minutes, so that sightings of one may be of many pictures.
    """
    kept = is_member.copy()
    beside = lines.residuals(point[None])[:, :, 0]
    variance = white_variance(lines)
    for number in np.unique(lines.platform).tolist():
        own = lines.platform == number
        if (lines.stamp_s[own] % _MINUTE_S == 0.0).all():
            variance[own] += scale[1] ** 2
    groups: dict[tuple[int, float], list[int]] = {}
    for i in np.flatnonzero(is_member & ~np.isnan(lines.stamp_s)).tolist():
        groups.setdefault((int(lines.platform[i]), float(lines.stamp_s[i])), []).append(i)
    for group in groups.values():
        best = min(group, key=lambda i: (squared[i], -i))
        for i in group:
            apart = np.square(beside[i] - beside[best]) / (variance[i] + variance[best])
            kept[i] = float(apart.sum()) < AGREE
    return kept


def white_variance(lines: Lines) -> FloatArray:
    """Of how each was marked and of its attitude (N, 2), as told."""
    return np.asarray(np.square(lines.mark) + np.square(lines.attitude_white)[:, None] + LEAST_VARIANCE)
