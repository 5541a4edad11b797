"""What all sightings of a target say of points, as independent numbers of variance 1: by themselves, or in company.

Other targets that the same platforms see tell what these err by, down to the one picture in which both are: each is a
point more whose place is not known either. Their places are near enough to linear in what is found, so that all
residuals together are Gaussian, and the target's own by the others' are, too.
"""

import math
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from distloc.batch.chain import LEAST_VARIANCE, noise_of, slow_covariance, whitening_of
from distloc.batch.lines import IntArray, Lines
from distloc.batch.scales import SCALES, Scale, log_share
from distloc.types import BoolArray, FloatArray

_WORTH = 4.0  # a logarithm by which a size of white errors may be less likely than the best
_MOST_SCALES = 4
_BEND = 3.0  # half of the 95 % quantile of a squared place: a product of two normal numbers has far ends
_TELLING = 400  # sightings that tell these sizes
_SETTLING, _LONGEST_SHIFT, _NO_FARTHER = 6, 0.3, 1e-3  # steps, how far one goes at most and least, by the range


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


class Seen:
    """A target's lines, by themselves or in company, with the positions' errors as angles at a target about (3,)."""

    def __init__(self, lines: Lines, company: Company | None, near_enu_m: FloatArray) -> None:
        self._lines, self._near = lines, near_enu_m
        self._shared = None if company is None else _Shared(company, near_enu_m)

    def views(self, scale: Scale) -> Views:
        """For one size of the white errors."""
        return Alone(self._lines, scale, self._near) if self._shared is None else InCompany(self._shared, scale)


class Alone:
    """The target's own sightings and nothing else."""

    def __init__(self, lines: Lines, scale: Scale, near_enu_m: FloatArray) -> None:
        self._lines = lines
        self._whitening = whitening_of(lines, noise_of(lines, *scale, range_m=lines.ranges_m(near_enu_m[None])[:, 0]))
        self.log_determinant = self._whitening.log_determinant

    def white(self, points_enu_m: FloatArray) -> FloatArray:
        """Innovations (2 N, K)."""
        return self._whitening.whitened(self._lines.residuals(points_enu_m)).reshape(-1, len(points_enu_m))


class _Shared:
    """The covariance of all residuals of a company but for the white errors that nobody told, which differ by scale.

    Others' come first, the target's own after them. A picture's sightings share its attitude's and position's white
    errors, and those of one other target the doubt about where that is: at first as good as unknown, as far off as it
    is away. What directions to it bend by is one error of all that a platform sees of it. `doubt` (2 N, 3) is what each
    sighting has of where it is, by `apart_m` (M,).
    """

    def __init__(self, company: Company, near_enu_m: FloatArray) -> None:
        order = np.argsort(company.which < 0, kind="stable")
        lines, which = company.lines, company.which
        self.which = which[order]
        self.own = lines.of(which < 0)
        at = company.points_enu_m[np.maximum(which, 0)]
        at[which < 0] = near_enu_m
        range_m = np.linalg.norm(at - lines.position_enu_m, axis=1)
        self.apart_m = np.array([float(range_m[which == j].mean()) for j in range(len(company.points_enu_m))])
        moved = (lines.basis / np.maximum(range_m, 1.0)[:, None, None]).reshape(-1, 3)
        doubt = _scaled(moved, np.where(which < 0, 0.0, self.apart_m[np.maximum(which, 0)]))
        residuals = np.where(which[:, None] < 0, 0.0, lines.residuals_each(at)[:, :, 0]).reshape(-1)
        covariance, jump = _in_pictures(lines, moved)
        covariance += np.where(_blocks(which[:, None] == which[None]), doubt @ doubt.T, 0.0)
        is_one = (which[:, None] == which[None]) & (lines.platform[:, None] == lines.platform[None])
        bend = np.where(which < 0, 0.0, company.bend_rad[np.maximum(which, 0)])
        covariance += np.where(_blocks(is_one), np.kron(np.outer(bend, bend), np.eye(2)), 0.0)
        own = np.square(lines.mark) + np.square(np.where(_is_marked(lines), 0.0, lines.attitude_white))[:, None]
        covariance.flat[:: len(covariance) + 1] += (own + LEAST_VARIANCE).reshape(-1)
        rows = (2 * order[:, None] + np.arange(2)).reshape(-1)
        self.residuals, self.doubt = residuals[rows], doubt[rows]
        self._covariance, self._jump = covariance[np.ix_(rows, rows)], jump[np.ix_(rows, rows)]

    def whole(self, scale: Scale) -> FloatArray:
        """The covariance for one size of the white errors, with a border of the residuals: (2 N + 1, 2 N + 1)."""
        n = len(self._covariance)
        bordered = np.zeros((n + 1, n + 1))
        bordered[:n, :n] = self._covariance + scale[0] ** 2 * self._jump
        bordered.flat[:: n + 2] += scale[1] ** 2
        bordered[n, :n] = bordered[:n, n] = self.residuals
        return bordered


def _in_pictures(lines: Lines, moved: FloatArray) -> tuple[FloatArray, FloatArray]:
    """What the slow errors and those of the pictures make of the covariance (2 N, 2 N), and what a jump of 1 rad does.

    `moved` (2 N, 3) is by how much a camera elsewhere moves what it sees.
    """
    is_picture = _blocks(lines.picture[:, None] == lines.picture[None])
    about_up = np.einsum("nji,ni->nj", lines.to_bias, lines.up)
    told = (about_up * np.where(lines.is_heading_told, lines.heading_white, 0.0)[:, None]).reshape(-1)
    untold = (about_up * ~lines.is_heading_told[:, None]).reshape(-1)
    white = np.column_stack(
        [
            _scaled(lines.to_bias.reshape(-1, 3), np.where(_is_marked(lines), lines.attitude_white, 0.0)),
            _scaled(moved, lines.position_m),
            told,
        ]
    )
    covariance = slow_covariance(lines) + np.where(is_picture, white @ white.T, 0.0)
    return covariance, np.where(is_picture, np.outer(untold, untold), 0.0)


def _is_marked(lines: Lines) -> BoolArray:
    """Whether it is told (N,) how well each was marked. Else what is told of attitudes is taken as each sighting's own:
    nobody marks exactly, and taken as the picture's it would make two of its targets' angle apart exact.
    """
    return np.asarray((lines.mark > 0.0).any(axis=1))


class InCompany:
    """The target's sightings by what those of others leave of their errors: these say nothing more of its place."""

    def __init__(self, shared: _Shared, scale: Scale) -> None:
        self._own = shared.own
        count = 2 * len(shared.own)
        bordered = shared.whole(scale)
        bordered[-1, -1] = 1e30  # its root is what is left of this after all squares, and is not used
        factor = np.linalg.cholesky(bordered)
        others = factor.shape[0] - 1 - count
        innovations = factor[-1, :-1]
        self.rest = float(np.linalg.norm(innovations[:others]))
        self._shift = innovations[others:]
        self._inverse = np.linalg.inv(factor[others:-1, others:-1])
        self.log_determinant = 2.0 * float(np.log(np.diagonal(factor)[:-1]).sum())

    def white(self, points_enu_m: FloatArray) -> FloatArray:
        """Its own innovations and, in a last row, all that the others' squares come to: (rows, K)."""
        k = len(points_enu_m)
        own = self._inverse @ self._own.residuals(points_enu_m).reshape(-1, k) + self._shift[:, None]
        return np.concatenate([own, np.full((1, k), self.rest)])


def settled(company: Company, scale: Scale) -> Company:
    """The company, of which every line is somebody's, with the places that all sightings together have.

    Gauss and Newton: about the single places it would be linear in the wrong ones, and too sure. So it would where
    places are known to a tenth of their range: what directions bend by over that is an error more.
    """
    points = company.points_enu_m
    for _ in range(_SETTLING):
        shifts_m, sigmas_m = _places(replace(company, points_enu_m=points), scale)
        range_m = np.array([company.lines.ranges_m(point[None]).min() for point in points])
        length_m = np.maximum(np.linalg.norm(shifts_m, axis=1), 1e-9)
        points = points + shifts_m * np.minimum(1.0, _LONGEST_SHIFT * range_m / length_m)[:, None]
        if (length_m < _NO_FARTHER * range_m).all():
            break
    return replace(company, points_enu_m=points, bend_rad=_BEND * np.square(sigmas_m / range_m))


def evidence(company: Company) -> tuple[float, FloatArray]:
    """Of a settled company, every line somebody's: the log of its likelihood, and each place's covariance (M, 3, 3).

    By the likeliest size of the white errors. Where a place may be counts as said of `_Shared`: one place more must be
    worth it.
    """
    shared = _Shared(replace(company, bend_rad=np.zeros(len(company.points_enu_m))), company.points_enu_m[0])
    logs = {}
    for scale in SCALES:
        if scale[0] > 0.0 and company.lines.is_heading_told.all():
            continue
        views = InCompany(shared, scale)
        logs[scale] = -0.5 * views.rest**2 - 0.5 * views.log_determinant + log_share(scale)
    best = max(logs, key=lambda scale: logs[scale])
    return logs[best], _solved(shared, best)[1]


def _places(company: Company, scale: Scale) -> tuple[FloatArray, FloatArray]:
    """By how much (M, 3) all sightings would have the places elsewhere, and each's largest standard deviation (M,)."""
    shifts_m, covariance = _solved(_Shared(company, company.points_enu_m[0]), scale)
    return shifts_m, np.sqrt(np.maximum(np.linalg.eigvalsh(covariance)[:, -1], 0.0))


def _solved(shared: _Shared, scale: Scale) -> tuple[FloatArray, FloatArray]:
    """The same shifts (M, 3) and the places' covariances (M, 3, 3)."""
    count = len(shared.apart_m)
    doubt = np.zeros((2 * len(shared.which), 3 * count))
    for j in range(count):
        rows = np.repeat(shared.which == j, 2)
        doubt[rows, 3 * j : 3 * j + 3] = shared.doubt[rows]
    whole = shared.whole(scale)[:-1, :-1]
    solved = np.linalg.solve(whole, np.column_stack([doubt, shared.residuals]))
    shifts_m = (doubt.T @ solved[:, -1]).reshape(count, 3) * shared.apart_m[:, None]
    left = np.eye(3 * count) - doubt.T @ solved[:, :-1]
    blocks = np.stack([left[3 * j : 3 * j + 3, 3 * j : 3 * j + 3] for j in range(count)])
    return shifts_m, blocks * np.square(shared.apart_m)[:, None, None]


def _scaled(rows: FloatArray, sigmas: FloatArray) -> FloatArray:
    """Rows (2 N, 3) by what each sighting (N,) has."""
    return np.asarray(rows * np.repeat(sigmas, 2)[:, None])


def _blocks(pairs: BoolArray) -> BoolArray:
    """(2 N, 2 N) of (N, N): across and upright are one sighting's."""
    return np.repeat(np.repeat(pairs, 2, axis=0), 2, axis=1)


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
    seen = Seen(lines, company, point_enu_m)
    for scale in SCALES:
        if scale[0] > 0.0 and lines.is_heading_told.all():
            continue
        views = seen.views(scale)
        squares = float(np.square(views.white(point_enu_m[None])).sum())
        logs[scale] = -0.5 * squares - 0.5 * views.log_determinant + log_share(scale)
    ordered = sorted(logs, key=lambda scale: (-logs[scale], scale))
    kept = [scale for scale in ordered if logs[scale] > logs[ordered[0]] - _WORTH]
    return kept[: 1 if n > _TELLING else _MOST_SCALES]
