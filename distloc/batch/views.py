"""What all sightings of a target say of points, as independent numbers of variance 1: by themselves, or in company.

Other targets that the same platforms see tell what these err by, down to the one picture in which both are: each is a
point more whose place is not known either. Their places are near enough to linear in what is found, so they are states
of the same filter that marginalises the platforms' errors.
"""

import math
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from distloc.batch.chain import LEAST_VARIANCE, Chain, noise_of, whitener
from distloc.batch.lines import IntArray, Lines
from distloc.batch.scales import SCALES, Scale, log_share
from distloc.types import FloatArray

_WORTH = 4.0  # a logarithm by which a size of white errors may be less likely than the best
_MOST_SCALES = 4
_TELLING = 400  # sightings that tell these sizes
_SETTLING, _LONGEST_SHIFT = 6, 0.3  # steps, and how far one goes at the most, by the range
_PICTURE = 9  # states before the company's: slow and white attitude error, the picture's position


class Views(Protocol):
    """Sightings as a function of the target's place."""

    @property
    def log_determinant(self) -> float:
        """Of the covariance of all residuals."""

    def white(self, points_enu_m: FloatArray) -> FloatArray:
        """Innovations (rows, K) at points (K, 3)."""


@dataclass(frozen=True, slots=True)
class Company:
    """A target's lines among those of others: `lines` has all (N), `which` (N,) is -1 for its own, else whose.

    `points_enu_m` (M, 3) is about where each other is, `bend_rad` (M,) by how much a direction to it is not linear in
    where it may be.
    """

    lines: Lines
    which: IntArray
    points_enu_m: FloatArray
    bend_rad: FloatArray


def views_of(lines: Lines, company: Company | None, scale: Scale, near_enu_m: FloatArray) -> Views:
    """Of a target about (3,), by which the positions' errors are turned into angles."""
    return Alone(lines, scale, near_enu_m) if company is None else InCompany(company, scale, near_enu_m)


class Alone:
    """The target's own sightings and nothing else."""

    def __init__(self, lines: Lines, scale: Scale, near_enu_m: FloatArray) -> None:
        self._lines = lines
        self._chain = Chain(lines, noise_of(lines, *scale, range_m=lines.ranges_m(near_enu_m[None])[:, 0]))
        self.log_determinant = self._chain.log_determinant

    def white(self, points_enu_m: FloatArray) -> FloatArray:
        """Innovations (2 N, K)."""
        return self._chain.whitened(self._lines.residuals(points_enu_m)).reshape(-1, len(points_enu_m))


class InCompany:
    """The target's sightings with those of others: a Kalman filter whose states are errors and the others' places."""

    def __init__(self, company: Company, scale: Scale, near_enu_m: FloatArray) -> None:
        lines, which = company.lines, company.which
        self._own = lines.of(which < 0)
        self._is_own = which < 0
        at = np.where(self._is_own[:, None], near_enu_m, company.points_enu_m[np.maximum(which, 0)])
        range_m = np.linalg.norm(at - lines.position_enu_m, axis=1)
        self._fixed = lines.residuals_each(at)
        states = _PICTURE + 3 * len(company.points_enu_m)
        self._H = np.zeros((len(lines), 2, states))
        self._H[:, :, 0:3] = self._H[:, :, 3:6] = lines.to_bias
        by_shift = lines.basis / np.maximum(range_m, 1.0)[:, None, None]
        self._H[:, :, 6:9] = by_shift
        for i, whose in enumerate(which.tolist()):
            if whose >= 0:
                start = _PICTURE + 3 * whose
                self._H[i, :, start : start + 3] = by_shift[i]
        self._kept = lines.kept.tolist()
        self._is_new = np.append(True, np.diff(lines.picture) != 0).tolist()
        self._gains, self._whites = np.empty((len(lines), states, 2)), np.empty((len(lines), 2, 2))
        self.log_determinant = self._filtered(company, scale, range_m)

    def white(self, points_enu_m: FloatArray) -> FloatArray:
        """Innovations (2 N, K) of all sightings."""
        k = len(points_enu_m)
        residuals = np.repeat(self._fixed, k, axis=2)
        residuals[self._is_own] = self._own.residuals(points_enu_m)
        innovations, _ = self._run(residuals)
        return np.asarray((self._whites @ innovations).reshape(-1, k))

    def shifts_m(self) -> FloatArray:
        """By how much (M, 3) all sightings would have the others' places elsewhere, where none is the target's own."""
        _, mean = self._run(self._fixed)
        return mean[_PICTURE:, 0].reshape(-1, 3)

    def _run(self, residuals: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Innovations (N, 2, K) of residuals (N, 2, K), and the states' means (S, K) after the last."""
        mean = np.zeros((self._H.shape[2], residuals.shape[2]))
        innovations = np.empty_like(residuals)
        for i, share in enumerate(self._kept):
            mean[0:3] *= share
            if self._is_new[i]:
                mean[3:_PICTURE] = 0.0
            innovations[i] = residuals[i] - self._H[i] @ mean
            mean += self._gains[i] @ innovations[i]
        return innovations, mean

    def _filtered(self, company: Company, scale: Scale, range_m: FloatArray) -> float:
        lines = company.lines
        P = np.zeros((self._H.shape[2], self._H.shape[2]))
        for j in range(len(company.points_enu_m)):  # as good as unknown: as far off as it is away
            start = _PICTURE + 3 * j
            P[range(start, start + 3), range(start, start + 3)] = float(range_m[company.which == j].mean()) ** 2
        jump = np.where(lines.is_heading_told, lines.heading_white, scale[0])
        log_determinant = 0.0
        for i, share in enumerate(self._kept):
            P[0:3] *= share
            P[:, 0:3] *= share
            P[range(3), range(3)] += (1.0 - share * share) * lines.bias_variance[i]
            if self._is_new[i]:
                P[3:_PICTURE] = 0.0
                P[:, 3:_PICTURE] = 0.0
                P[3:6, 3:6] = np.eye(3) * lines.attitude_white[i] ** 2 + jump[i] ** 2 * np.outer(
                    lines.up[i], lines.up[i]
                )
                P[range(6, 9), range(6, 9)] = lines.position_m[i] ** 2
            PH = P @ self._H[i].T
            whose = int(company.which[i])
            own = scale[1] ** 2 + LEAST_VARIANCE + (company.bend_rad[whose] ** 2 if whose >= 0 else 0.0)
            S = self._H[i] @ PH + np.diag(np.square(lines.mark[i]) + own)
            self._whites[i], log = whitener(S)
            log_determinant += log
            self._gains[i] = PH @ (self._whites[i].T @ self._whites[i])
            P = P - self._gains[i] @ PH.T
        self._covariance = P
        return log_determinant

    def sigmas_m(self) -> FloatArray:
        """The largest standard deviation (M,) of each other's place."""
        starts = range(_PICTURE, len(self._covariance), 3)
        blocks = np.stack([self._covariance[start : start + 3, start : start + 3] for start in starts])
        return np.asarray(np.sqrt(np.linalg.eigvalsh(blocks)[:, -1]))


def settled(company: Company, scale: Scale) -> Company:
    """The company, of which every line is somebody's, with the places that all sightings together have.

    Gauss and Newton: about the single places the filter would be linear in the wrong ones, and too sure. So it would
    where places are known to a tenth of their range: what directions bend by over that is an error more.
    """
    points = company.points_enu_m
    for _ in range(_SETTLING):
        views = InCompany(replace(company, points_enu_m=points), scale, points[0])
        shifts_m = views.shifts_m()
        range_m = np.array([company.lines.ranges_m(point[None]).min() for point in points])
        length_m = np.maximum(np.linalg.norm(shifts_m, axis=1), 1e-9)
        points = points + shifts_m * np.minimum(1.0, _LONGEST_SHIFT * range_m / length_m)[:, None]
        if (length_m < 1e-3 * range_m).all():
            break
    return replace(company, points_enu_m=points, bend_rad=np.square(views.sigmas_m() / range_m))


def sigma_share(views: Views, near_enu_m: FloatArray, range_m: float) -> float:
    """The largest standard deviation of a place near (3,), by its range: infinity where it is not known at all."""
    size_m = 1e-4 * range_m + 1e-3
    white = views.white(np.concatenate([near_enu_m[None], near_enu_m + size_m * np.eye(3)]))
    J = (white[:, 1:] - white[:, :1]) / size_m
    least = float(np.linalg.eigvalsh(J.T @ J)[0])
    return 1.0 / math.sqrt(least) / range_m if least > 0.0 else math.inf


def likely_scales(lines: Lines, company: Company | None, point_enu_m: FloatArray) -> list[Scale]:
    """The sizes of white errors that the residuals at one point (3,) leave, at most four, the likeliest first."""
    n = len(lines)
    if company is None and n > _TELLING:
        chosen = np.zeros(n, np.bool_)
        chosen[np.linspace(0, n - 1, _TELLING).astype(np.intp)] = True
        lines = lines.of(chosen)
    logs = {}
    for scale in SCALES:
        if scale[0] > 0.0 and lines.is_heading_told.all():
            continue
        views = views_of(lines, company, scale, point_enu_m)
        squares = float(np.square(views.white(point_enu_m[None])).sum())
        logs[scale] = -0.5 * squares - 0.5 * views.log_determinant + log_share(scale)
    ordered = sorted(logs, key=lambda scale: (-logs[scale], scale))
    kept = [scale for scale in ordered if logs[scale] > logs[ordered[0]] - _WORTH]
    return kept[: 1 if n > _TELLING else _MOST_SCALES]
