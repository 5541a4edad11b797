"""Where a target is: its posterior over shells of range about one camera.

With few or narrow views the range is known by its reciprocal at best, so no Gaussian about a point will do. On a shell
of one range the two bearings are near Gaussian, the platforms' errors marginalised out. So: ranges by their logarithm,
narrowed to where there is weight, on each the best bearings and their covariance (Laplace), samples of these, weighed
by their true likelihood and by the ground. All samples are fixed ones: the same sightings give the same answer.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from distloc.batch.lines import Lines
from distloc.batch.scales import Scale
from distloc.batch.views import Alone, Company, Seen, Views
from distloc.types import FloatArray

_SHELLS, _FINE_SHELLS, _GROUND_SHELLS, _MOST_WORK = 96, 48, 192, 3_000_000
_SEARCHED_SHELLS, _FEW = 1536, 64  # few sightings leave it to the ground: a slope that is met is soon passed
_DRAWS = 40
_MOST_CAMERAS = 16
_WIDER = 1.25  # the samples are spread, by the Laplace approximation's standard deviations
_STEPS, _CLOSE = 6, 1e-3
_NEGLIGIBLE = 18.0  # a logarithm of weight under the best one's
_ENOUGH = 600  # lines that choose the range to look at closely
_FAR_FROM_SURE = 3.0  # a logarithm: range is not bounded where its last shell is hardly worse than the best

LogWeights = Callable[[FloatArray], FloatArray]


@dataclass(frozen=True, slots=True)
class Cloud:
    """Samples (S, 3) with weights (S,), their ranges (S,) from the camera at `origin_enu_m` (3,).

    `log_evidence` compares one scale of the white errors with another; `is_bounded` says whether the far end of the
    ranges is excluded, `reach_m` from where to where ranges are not.
    """

    points_enu_m: FloatArray
    weights: FloatArray
    log_evidence: float
    is_bounded: bool
    reach_m: tuple[float, float]


def posterior(
    lines: Lines,
    origin: int,
    near_enu_m: FloatArray,
    scale: Scale,
    company: Company | None,
    range_m: tuple[float, float],
    ground: LogWeights | None,
) -> Cloud:
    """The cloud of what the lines see, in shells about the camera of line `origin`.

    `near_enu_m` (3,) is a first guess, by which the positions' errors are turned into angles; `company` has what else
    the platforms see; `ground` weighs points.
    """
    cameras = _cameras(lines, origin)
    shells = _Shells(Seen(lines, company, near_enu_m).views(scale), len(lines), cameras, near_enu_m)
    thin = shells
    if company is None and len(lines) > _ENOUGH:
        thin = _Shells(Alone(_thinned(lines), scale, near_enu_m), _ENOUGH, cameras, near_enu_m)
    ends = (math.log(range_m[0]), math.log(range_m[1]))
    count = _SEARCHED_SHELLS if ground is not None and len(lines) <= _FEW else _SHELLS
    for _ in range(8):
        log_ranges = np.linspace(*ends, count)
        _, _, log_weight = thin.solved(log_ranges)
        own = log_weight.copy()
        if ground is not None:
            own += _best_of_ground(thin, log_ranges, ground)
        worth = np.flatnonzero(own > own.max() - _NEGLIGIBLE * (1.5 if thin is shells else 1.0))
        low, high = max(worth[0] - 1, 0), min(worth[-1] + 1, count - 1)
        ends = (float(log_ranges[low]), float(log_ranges[high]))
        if high - low > count // 3 or ends[1] - ends[0] < 1e-6:
            break
        count = _SHELLS
    count = _GROUND_SHELLS if ground is not None else _FINE_SHELLS
    log_ranges = np.linspace(*ends, count)
    bearings, information, log_weight = shells.solved(log_ranges)
    points, log_weights = shells.sampled(log_ranges, bearings, information, log_weight)
    if ground is not None:
        log_weights = log_weights + ground(points.reshape(-1, 3)).reshape(log_weights.shape)
    shell_weight = np.logaddexp.reduce(log_weights, axis=1)
    worth = shell_weight > shell_weight.max() - 1.92
    is_bounded = ends[1] < math.log(range_m[1]) - 1e-9 or shell_weight[-1] < shell_weight.max() - _FAR_FROM_SURE
    ranges = np.exp(log_ranges[worth])
    flat = log_weights.ravel()
    total = float(np.logaddexp.reduce(flat)) + float(np.log(log_ranges[1] - log_ranges[0]))
    return Cloud(
        points.reshape(-1, 3),
        np.exp(flat - np.logaddexp.reduce(flat)),
        total,
        bool(is_bounded),
        (float(ranges[0]), float(ranges[-1])),
    )


class _Shells:
    """Shells about the first of some cameras: the best bearings on each, and samples about them.

    Before anything is seen a range is as likely as another by its logarithm, and that from the farthest camera: else
    of all places between two that face each other those at the first would be the likeliest.
    """

    def __init__(self, views: Views, count: int, cameras_enu_m: FloatArray, near_enu_m: FloatArray) -> None:
        self._views, self._count, self._cameras, self._camera = views, count, cameras_enu_m, cameras_enu_m[0]
        towards = near_enu_m - self._camera
        self._towards = towards / max(float(np.linalg.norm(towards)), 1e-9)
        across = np.cross(self._towards, [0.0, 0.0, 1.0])
        if np.linalg.norm(across) < 1e-3:
            across = np.cross(self._towards, [0.0, 1.0, 0.0])
        across /= np.linalg.norm(across)
        self._basis = np.stack([across, np.cross(across, self._towards)])

    def points(self, log_ranges: FloatArray, bearings: FloatArray) -> FloatArray:
        """(..., 3) of ranges (...,) and bearings (..., 2), tangents across and upright."""
        towards = self._towards + bearings @ self._basis
        towards = towards / np.linalg.norm(towards, axis=-1, keepdims=True)
        return np.asarray(self._camera + np.exp(log_ranges)[..., None] * towards)

    def squares(self, points_enu_m: FloatArray) -> FloatArray:
        """Of all innovations at points (K, 3): (K,)."""
        return np.asarray(np.square(self._white(points_enu_m)).sum(axis=0))

    def solved(self, log_ranges: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """On each shell (K,) the best bearings (K, 2), the information about them (K, 2, 2), the log of its weight."""
        k = len(log_ranges)
        bearings = np.zeros((k, 2))
        size = np.full(k, 1.0)
        found = self._linear(log_ranges, bearings)
        for _ in range(_STEPS):
            squares, gradient, information = found
            damped = information + np.eye(2) * (1e-9 * np.trace(information, axis1=1, axis2=2))[:, None, None]
            step = -np.linalg.solve(damped, gradient[:, :, None])[:, :, 0]
            length = np.linalg.norm(step, axis=1)
            step *= (size * np.minimum(1.0, 0.2 / np.maximum(length, 1e-12)))[:, None]
            tried = bearings + step
            again = self._linear(log_ranges, tried)
            is_better = again[0] <= squares
            size = np.where(is_better, 1.0, 0.3 * size)
            bearings = np.where(is_better[:, None], tried, bearings)
            found = (
                np.where(is_better, again[0], squares),
                np.where(is_better[:, None], again[1], gradient),
                np.where(is_better[:, None, None], again[2], information),
            )
            left = np.einsum("ki,kij,kj->k", step, information, step)  # by the bearings' own covariance
            if is_better.all() and float(left.max()) < _CLOSE:
                break
        squares, _, information = found
        _, log_det = np.linalg.slogdet(information)
        before = self._before(self.points(log_ranges, bearings))
        return bearings, information, -0.5 * squares - 0.5 * log_det + before + self._constant

    def sampled(
        self, log_ranges: FloatArray, bearings: FloatArray, information: FloatArray, log_weight: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Points (K, draws, 3) on the shells and the logs of their weights (K, draws)."""
        draws = _normal_draws(_DRAWS) * _WIDER
        roots = np.linalg.cholesky(np.linalg.inv(information))  # (K, 2, 2)
        offsets = np.einsum("kij,sj->ksi", roots, draws)
        points = self.points(np.broadcast_to(log_ranges[:, None], offsets.shape[:2]), bearings[:, None] + offsets)
        # by the Gaussian that they are drawn from, wider than the one whose integral the shell's weight has
        log_drawn = -0.5 * np.square(draws / _WIDER).sum(axis=1) - np.log(_WIDER**2)
        share = -np.log(len(draws))
        count = len(log_ranges) * len(draws)
        if self._count * count > _MOST_WORK:  # many lines: near enough to Gaussian on each shell
            log_true = -0.5 * np.square(draws).sum(axis=1)
            return points, log_weight[:, None] + (log_true - log_drawn + share)[None]
        squares = self.squares(points.reshape(-1, 3)).reshape(points.shape[:2])
        _, log_det = np.linalg.slogdet(information)
        at_best = self._constant - 0.5 * log_det[:, None]
        return points, at_best - 0.5 * squares + self._before(points) - log_drawn[None] + share

    def _before(self, points_enu_m: FloatArray) -> FloatArray:
        """The logs of how likely points (..., 3) are before anything is seen, by their ranges from the first."""
        squared = np.square(points_enu_m[..., None, :] - self._cameras).sum(axis=-1)
        return np.asarray(1.5 * (np.log(squared[..., 0]) - np.log(squared.max(axis=-1))))

    @property
    def _constant(self) -> float:
        return -0.5 * self._views.log_determinant

    def _linear(self, log_ranges: FloatArray, bearings: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Squares (K,), half their gradient (K, 2) and the information (K, 2, 2) at bearings (K, 2)."""
        k, size = len(log_ranges), 1e-6
        tried = np.concatenate([bearings, bearings + np.array([size, 0.0]), bearings + np.array([0.0, size])])
        white = self._white(self.points(np.tile(log_ranges, 3), tried)).reshape(-1, 3, k)
        at, J = white[:, 0], (white[:, 1:] - white[:, :1]) / size
        return np.square(at).sum(axis=0), np.einsum("nik,nk->ki", J, at), np.einsum("nik,njk->kij", J, J)

    def _white(self, points_enu_m: FloatArray) -> FloatArray:
        return self._views.white(points_enu_m)


def _best_of_ground(shells: _Shells, log_ranges: FloatArray, ground: LogWeights) -> FloatArray:
    """The most that the ground leaves of each shell (K,), within 3 standard deviations upright."""
    bearings, information, _ = shells.solved(log_ranges)
    upright = np.sqrt(np.linalg.inv(information)[:, 1, 1])
    best = np.full(len(log_ranges), -np.inf)
    for sigmas in np.linspace(-3.0, 3.0, 13):
        tried = bearings + np.stack([np.zeros_like(upright), sigmas * upright], axis=1)
        best = np.maximum(best, ground(shells.points(log_ranges, tried)) - 0.5 * sigmas**2)
    return best


def _cameras(lines: Lines, origin: int) -> FloatArray:
    """Where they are (C, 3), that of the origin first: the first and last of each platform's, of some platforms."""
    ends = np.flatnonzero(np.diff(lines.platform, prepend=-1) + np.diff(lines.platform, append=lines.platform[-1] + 1))
    chosen = ends[np.unique(np.linspace(0, len(ends) - 1, min(len(ends), _MOST_CAMERAS)).astype(np.intp))]
    return lines.position_enu_m[[origin, *chosen.tolist()]]


def _thinned(lines: Lines) -> Lines:
    chosen = np.zeros(len(lines), np.bool_)
    chosen[np.linspace(0, len(lines) - 1, _ENOUGH).astype(np.intp)] = True
    return lines.of(chosen)


def _normal_draws(count: int) -> FloatArray:
    """Pairs (count, 2) of mean 0 and covariance 1: a fixed sequence without gaps (Roberts' R2), turned normal."""
    i = np.arange(1, count // 2 + 1)
    first, second = (0.5 + i * 0.7548776662466927) % 1.0, (0.5 + i * 0.5698402909980532) % 1.0
    radius = np.sqrt(-2.0 * np.log(np.maximum(first, 1e-12)))
    half = np.stack([radius * np.cos(2.0 * np.pi * second), radius * np.sin(2.0 * np.pi * second)], axis=1)
    both = np.concatenate([half, -half])
    return np.asarray(both @ np.linalg.inv(np.linalg.cholesky(both.T @ both / len(both))).T)
