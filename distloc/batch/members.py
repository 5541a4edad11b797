"""Which sightings are of one place: robust, and with each platform's error found out on the way.

Points where two lines of sight come near each other are tried, and each is judged by a Kalman filter of its own over
the platforms' errors, which leaves out what does not fit. So a compass that is three degrees off hides no sighting of
another thing one degree beside: once its error is known the gate is as narrow as the white errors are.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from distloc.batch.chain import Chain, noise_of
from distloc.batch.lines import IntArray, Lines
from distloc.batch.scales import SCALES, Scale
from distloc.types import BoolArray, FloatArray

_MISFIT = 0.02  # share of the sightings that are of something else, anywhere within
_ANYWHERE_SR = 0.5  # this part of the sky
GATE = 20.0  # squared standard deviations of two numbers: 5 in 100,000 of what fits are outside
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
    tried = []
    for scale in scales:
        score, fits, _ = judged(few, points, scale)
        leading = np.argsort(-score, kind="stable")[:_REFINED]
        tried.append((float(score[leading[0]]), scale, points[leading], fits[leading]))
    tried.sort(key=lambda one: (-one[0], one[1]))
    best: tuple[float, FloatArray, Scale] = tried[0][0], tried[0][2][0], tried[0][1]
    for _, scale, leading_points, leading_fits in tried[:_MOST_SCALES]:
        near, fits = leading_points, leading_fits
        for _ in range(_ROUNDS):
            near = np.stack([_refined(few, point, own) for point, own in zip(near, fits, strict=True)])
            score, fits, _ = judged(few, near, scale)
            top = int(np.argmax(score))
            if score[top] <= best[0] + 1e-3:
                break
            best = float(score[top]), near[top], scale
    _, point, scale = best
    score, is_member, squared = judged(lines, point[None], scale)
    return Members(point, _one_a_picture(lines, is_member[0], squared[0]), squared[0], float(score[0]))


def judged(lines: Lines, points_enu_m: FloatArray, scale: Scale) -> tuple[FloatArray, BoolArray, FloatArray]:
    """For each point (K, 3) the log of its likelihood (K,), which lines fit it (K, N), and how well (K, N)."""
    n, k = len(lines), len(points_enu_m)
    residuals, range_m = lines.residuals(points_enu_m), lines.ranges_m(points_enu_m)
    noise = noise_of(lines, *scale, range_m=np.full(n, np.inf))
    near = np.square(lines.position_m[:, None] / np.maximum(range_m, 1.0))  # (N, K)
    score, fits, squared = np.zeros(k), np.zeros((k, n), np.bool_), np.zeros((k, n))
    mean, P = np.zeros((k, 3)), np.zeros((k, 3, 3))
    log_missed = math.log(_MISFIT / _ANYWHERE_SR)
    for i, share in enumerate(lines.kept.tolist()):
        H = lines.to_bias[i]
        mean, P = share * mean, share * share * P
        P += np.diag((1.0 - share * share) * lines.bias_variance[i])
        PH = P @ H.T  # (K, 3, 2)
        S = H @ PH + noise[i]
        a, b, c = S[:, 0, 0] + near[i], S[:, 0, 1], S[:, 1, 1] + near[i]
        determinant = a * c - b * b
        e = residuals[i].T - mean @ H.T  # (K, 2)
        squared[:, i] = (c * e[:, 0] ** 2 - 2.0 * b * e[:, 0] * e[:, 1] + a * e[:, 1] ** 2) / determinant
        log_fit = math.log(1.0 - _MISFIT) - 0.5 * squared[:, i] - 0.5 * np.log(determinant) - math.log(2.0 * math.pi)
        is_fit = (squared[:, i] < GATE) & (log_fit > log_missed)
        fits[:, i] = is_fit
        score += np.where(is_fit, log_fit, log_missed)
        inverse = np.stack([np.stack([c, -b], 1), np.stack([-b, a], 1)], 1) / determinant[:, None, None]
        gain = PH @ inverse * is_fit[:, None, None]
        mean = mean + (gain @ e[:, :, None])[:, :, 0]
        P = P - gain @ PH.transpose(0, 2, 1)
    return score, fits, squared


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


def _refined(lines: Lines, point: FloatArray, fits: BoolArray) -> FloatArray:
    """A better point for what fits: steps of Gauss and Newton with the platforms' errors marginalised out."""
    if fits.sum() < 2:
        return point
    own = lines.of(fits)
    for _ in range(2):
        range_m = own.ranges_m(point[None])[:, 0]
        chain = Chain(own, noise_of(own, 0.0, 0.0, range_m))
        size_m = 1e-4 * float(range_m.min()) + 1e-3
        tried = np.concatenate([point[None], point + size_m * np.eye(3)])
        white = chain.whitened(own.residuals(tried)).reshape(-1, 4)
        J = (white[:, 1:] - white[:, :1]) / size_m
        A = J.T @ J
        A.flat[::4] += 1e-9 * np.trace(A) + 1e-30
        step = -np.linalg.solve(A, J.T @ white[:, 0])
        most_m = 0.5 * float(range_m.min())
        length = float(np.linalg.norm(step))
        point = point + step * min(1.0, most_m / max(length, 1e-9))
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


def _one_a_picture(lines: Lines, is_member: BoolArray, squared: FloatArray) -> BoolArray:
    """A picture shows a place once: of a platform's sightings at one time the best is kept."""
    kept = is_member.copy()
    best: dict[tuple[int, float], int] = {}
    for i in np.flatnonzero(is_member).tolist():
        stamp = float(lines.stamp_s[i])
        if math.isnan(stamp):
            continue
        key = int(lines.platform[i]), stamp
        other = best.setdefault(key, i)
        if other != i:
            loser, best[key] = (i, other) if squared[other] <= squared[i] else (other, i)
            kept[loser] = False
    return kept
