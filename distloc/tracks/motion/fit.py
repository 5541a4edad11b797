"""Where targets are and how they move, by all their bearings at once, and how well priors of motion explain these.

Levenberg and Marquardt for the maximum of the posterior, Laplace's approximation for the evidence (Kass and Raftery
1995, 4.1). On one straight course a source that moves evenly looks like one that stands elsewhere: nearer or farther,
so that what raises it is lower or higher, and dust is drawn out behind what raises it. So how high smoke and dust rise
and how they lean are weighed with the bearings. `judge` calls it.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from distloc.tracks.motion.bearings import AZIMUTH, EAST, MOST, NORTH, TIME, WHITE, Bearings, correlated, jumps_rad2
from distloc.types import FloatArray

SPEEDS_MPS = (1e-3, 0.4, 6.0)  # one standard deviation on each axis: it stands, creeps, is driven
HEIGHTS_M = (150.0, 150.0, 30.0)  # of the smoke of a fire, of dust or a ship's smoke: the median,
LOG_HEIGHTS = (0.9, 0.9, 0.5)  # and one standard deviation of the logarithm
SCALES = (1.0, 2.5, 5.0)  # of the heading's slow error to what is told of it
MOTIONS, HYPOTHESES = len(SPEEDS_MPS), len(SPEEDS_MPS) * len(SCALES)
_NORMAL95 = 2.448  # standard deviations of the 95 % ellipse
_ITERATIONS, _SETTLED = 7, 1e-3  # at the most; a change of twice the logarithm of the evidence
_LOG_RANGE = 1.5  # that of the range's about the cloud's, where nobody knows how high it looks
_DRAWN_S_M, _WIND_LEAN = 0.2, 0.8  # how far it leans back for each m/s of its source; one standard deviation by wind
_MOST_STEP = np.array([0.3, 0.5, 5.0, 5.0])
_AIM_TURN_RAD = 0.1
_MOST_SQUARED = 9.0  # of what one bearing adds: where half a plume goes for good its middle jumps, and nothing wanders


@dataclass(frozen=True, slots=True)
class Fit:
    """Of k targets by h = 9 hypotheses, each motion by the first scale, then by the next.

    Logarithms (k, h) of the evidence; place and velocity now (k, h, 2); the place's covariances (k, h, 2, 2).
    """

    log_evidence: FloatArray
    place_m: FloatArray
    velocity_mps: FloatArray
    place_m2: FloatArray


@dataclass(frozen=True, slots=True)
class Appearance:
    """How high k targets look (k,), 0 where nobody knows, and how they lean by the pictures alone.

    Of the lean, metres east and north for each metre up, the information (k, 2, 2), and that times its mean (k, 2).
    """

    height_rad: FloatArray
    lean_information: FloatArray
    lean_weighed: FloatArray


def fitted(bearings: Sequence[Bearings], about_m: FloatArray, aim_rad: FloatArray, appearance: Appearance) -> Fit:
    """Begin at about (k, 2); the aim errs by `aim_rad` (k,), the same way for a while."""
    rows = np.array([one.held for one in bearings])
    is_held = np.arange(MOST) < np.array([[one.count] for one in bearings])
    last = rows[np.arange(len(bearings)), [one.count - 1 for one in bearings]]
    from_m, offset_m = last[:, [EAST, NORTH]], about_m - last[:, [EAST, NORTH]]
    jumps = jumps_rad2(rows, is_held, about_m)[:, None]
    rows[:, :, WHITE] = np.sqrt(np.maximum(np.square(rows[:, :, WHITE]), jumps))
    covariance: FloatArray = correlated(rows, is_held, aim_rad, _AIM_TURN_RAD, np.array(SCALES))
    factor = np.linalg.cholesky(covariance)
    whiten = np.linalg.inv(factor) * is_held[:, None, None]
    lines = _Lines(rows - last[:, None], rows[:, :, AZIMUTH], whiten)
    spread = np.repeat(2.0 * np.log(factor.diagonal(axis1=2, axis2=3)).sum(axis=2), MOTIONS, axis=1)
    x = np.zeros((len(bearings), HYPOTHESES, 4))
    x[:, :, 0] = np.arctan2(offset_m[:, 0], offset_m[:, 1])[:, None]
    x[:, :, 1] = np.log(np.maximum(np.hypot(*offset_m.T), 1.0))[:, None]
    prior = _prior(x, appearance)
    best, damping = np.full(x.shape[:2], np.inf), np.full(x.shape[:2], 1e-3)
    kept, information, descent = x.copy(), np.zeros((*x.shape, 4)), np.zeros_like(x)
    is_moving = np.ones(len(bearings), np.bool_)
    for _ in range(_ITERATIONS):
        white = lines.whitened(x)
        squares = white @ white.swapaxes(2, 3)
        pull = prior.weighed - (prior.information @ x[..., None])[..., 0]
        cost = squares[..., 4, 4] - (x * (pull + prior.weighed)).sum(axis=2)
        is_better = (cost < best) & is_moving[:, None]  # each target's as if it were alone
        is_moving &= ~(np.abs(best - cost).max(axis=1) < _SETTLED)
        best = np.where(is_better, cost, best)
        kept[is_better] = x[is_better]
        information[is_better] = (squares[..., :4, :4] + prior.information + 1e-9 * np.eye(4))[is_better]
        descent[is_better] = (squares[..., :4, 4] + pull)[is_better]
        if not is_moving.any():
            break
        damping = np.where(is_better, 0.1 * damping, 30.0 * damping)
        damped = information + damping[..., None, None] * information * np.eye(4)
        step = np.linalg.solve(damped, descent[..., None])[..., 0]
        x = kept + np.clip(step, -_MOST_STEP, _MOST_STEP)
    squared = np.square(lines.whitened(kept)[..., 4, :])
    told = best - np.maximum(squared - _MOST_SQUARED, 0.0).sum(axis=2)
    return _result(kept, information, told + prior.constant + spread, from_m[:, None])


@dataclass(frozen=True, slots=True)
class _Lines:
    """Rows (k, m, 8) less the last one's, azimuths (k, m), and what whitens those held by scale (k, s, m, m)."""

    rows: FloatArray
    azimuth: FloatArray
    whiten: FloatArray

    def whitened(self, x: FloatArray) -> FloatArray:
        """Of hypotheses x (k, h, 4) the transposed J (k, h, 5, m), its last row being what the azimuths are off."""
        k, s, m, _ = self.whiten.shape
        since_s, east_m, north_m = (self.rows[:, None, :, None, column] for column in (TIME, EAST, NORTH))
        azimuth, log_range, east_mps, north_mps = x.reshape(k, s, 1, MOTIONS, 4).transpose(4, 0, 1, 2, 3)
        range_m = np.exp(log_range)
        to_east_m, to_north_m = range_m * np.sin(azimuth), range_m * np.cos(azimuth)
        line_east_m = to_east_m + east_mps * since_s - east_m  # (k, s, m, motions)
        line_north_m = to_north_m + north_mps * since_s - north_m
        squared = np.maximum(line_east_m * line_east_m + line_north_m * line_north_m, 1.0)
        by_east, by_north = line_north_m / squared, -line_east_m / squared
        off = self.azimuth[:, None, :, None] - np.arctan2(line_east_m, line_north_m)
        J = np.empty((k, s, m, 5, MOTIONS))
        J[..., 0, :] = by_east * to_north_m - by_north * to_east_m
        J[..., 1, :] = by_east * to_east_m + by_north * to_north_m
        J[..., 2, :], J[..., 3, :] = by_east * since_s, by_north * since_s
        J[..., 4, :] = off - 2.0 * np.pi * np.rint(off / (2.0 * np.pi))
        white = (self.whiten @ J.reshape(k, s, m, -1)).reshape(J.shape)
        return np.asarray(white.transpose(0, 1, 4, 3, 2).reshape(k, -1, 5, m))


@dataclass(frozen=True, slots=True)
class _Prior:
    """Of azimuth, range's logarithm and velocity: information (k, h, 4, 4), and that times the mean (k, h, 4).

    `constant` (k, h) completes minus two times the logarithm of the density.
    """

    information: FloatArray
    weighed: FloatArray
    constant: FloatArray


def _prior(x: FloatArray, appearance: Appearance) -> _Prior:
    """About where the fits begin (k, h, 4): of the azimuth nothing, the range by the height, how fast it may be.

    And how fast by how it leans, which is -`_DRAWN_S_M` times its velocity and what the wind does.
    """
    height_rad = appearance.height_rad[:, None]
    speeds_mps, heights_m, log_heights = (np.tile(one, len(SCALES)) for one in (SPEEDS_MPS, HEIGHTS_M, LOG_HEIGHTS))
    by_height = np.log(heights_m) - np.log(np.where(height_rad > 0.0, height_rad, 1.0))
    log_range = np.where(height_rad > 0.0, by_height, x[:, :, 1])
    by_range = np.where(height_rad > 0.0, log_heights**-2.0, _LOG_RANGE**-2)
    by_speed = speeds_mps**-2.0
    information, weighed = np.zeros((*x.shape, 4)), np.zeros_like(x)
    information[..., 1, 1], weighed[..., 1] = by_range, by_range * log_range
    shrunk = np.linalg.inv(np.eye(2) + _WIND_LEAN**2 * appearance.lean_information)
    information[..., 2:, 2:] = (by_speed[:, None, None] * np.eye(2)) + (
        _DRAWN_S_M**2 * appearance.lean_information @ shrunk
    )[:, None]
    weighed[..., 2:] = -_DRAWN_S_M * (shrunk @ appearance.lean_weighed[:, :, None])[:, None, :, 0]
    constant = by_range * np.square(log_range) - np.log(by_range) - 2.0 * np.log(by_speed)
    return _Prior(information, weighed, constant)


def _result(x: FloatArray, information: FloatArray, cost: FloatArray, from_m: FloatArray) -> Fit:
    log_evidence = -0.5 * (np.linalg.slogdet(information)[1] + cost)
    range_m = np.exp(x[:, :, 1, None])
    along = np.stack([np.sin(x[:, :, 0]), np.cos(x[:, :, 0])], axis=2)
    aside = np.stack([along[:, :, 1], -along[:, :, 0]], axis=2)
    of_x = np.linalg.inv(information)[..., :2, :2]
    # far ends are farther than near ones are near: as long as the far one
    ends = _NORMAL95 * np.sqrt(np.clip(of_x[..., 1, 1], 1e-12, 1.0))[..., None]
    by_x = np.stack([range_m * aside, range_m * np.expm1(ends) / ends * along], axis=3)
    covariance = by_x @ of_x @ by_x.swapaxes(2, 3)
    return Fit(log_evidence, from_m + range_m * along, x[:, :, 2:], covariance)
