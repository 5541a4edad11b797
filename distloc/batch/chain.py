"""Residuals of correlated sightings turned into independent ones of variance 1, the slow errors marginalised out.

Each platform's attitude error is a Gauss-Markov chain about east, north and up. What it makes of the residuals'
covariance doesn't depend on where the target is, so whitening is linear in them: one factor serves any number of
points. Of few sightings that is Cholesky's of the whole covariance, of many a Kalman filter's innovations.
"""

import math
from typing import Protocol

import numpy as np

from distloc.batch.lines import Lines
from distloc.types import FloatArray

_FEW = 160  # sightings whose covariance is cheaper at once than one by one
_FORGOTTEN = -60.0  # the logarithm of a share of an error of which nothing is left
LEAST_VARIANCE = 1e-9  # of an angle: 0.002 degrees, for whoever tells that nothing errs


class Whitening(Protocol):
    """Residuals as independent numbers; `log_determinant` is that of the covariance of all of them."""

    log_determinant: float

    def whitened(self, residuals: FloatArray) -> FloatArray:
        """(N, 2, K) of residuals (N, 2, K), each of variance 1 and independent."""


def whitening_of(lines: Lines, noise: FloatArray) -> Whitening:
    """For N lines with variances `noise` (N, 2, 2) of their own."""
    return Whole(lines, noise) if len(lines) <= _FEW else Chain(lines, noise)


class Whole:
    """By the whole covariance at once."""

    def __init__(self, lines: Lines, noise: FloatArray) -> None:
        n = len(lines)
        covariance = slow_covariance(lines)
        blocks = covariance.reshape(n, 2, n, 2)
        blocks[range(n), :, range(n)] += noise
        factor = np.linalg.cholesky(covariance)
        self.log_determinant = 2.0 * float(np.log(np.diagonal(factor)).sum())
        self._inverse = np.linalg.inv(factor)

    def whitened(self, residuals: FloatArray) -> FloatArray:
        """(N, 2, K) of residuals (N, 2, K)."""
        return np.asarray((self._inverse @ residuals.reshape(-1, residuals.shape[2])).reshape(residuals.shape))


def slow_covariance(lines: Lines) -> FloatArray:
    """What the slow errors make of the covariance of all residuals, across and upright in turn: (2 N, 2 N)."""
    n = len(lines)
    passed = np.cumsum(np.log(np.maximum(lines.kept, math.exp(_FORGOTTEN))))
    is_one = lines.platform[:, None] == lines.platform[None]
    share = np.where(is_one, np.exp(np.minimum(passed[None] - passed[:, None], 0.0)), 0.0)  # of i's that j has, i <= j
    variance = lines.bias_variance.copy()
    for i, kept in enumerate((lines.kept**2).tolist()):
        if kept > 0.0:
            variance[i] = kept * variance[i - 1] + (1.0 - kept) * lines.bias_variance[i]
    first = (lines.to_bias * variance[:, None]).reshape(2 * n, 3)
    whole = first @ lines.to_bias.reshape(2 * n, 3).T * np.repeat(np.repeat(share, 2, axis=0), 2, axis=1)
    order = np.arange(2 * n) // 2
    return np.asarray(np.where(order[:, None] <= order[None], whole, whole.T))


class Chain:
    """The filter's gains for N lines with variances `noise` (N, 2, 2) of their own.

    `log_determinant` is that of the covariance of all residuals.
    """

    def __init__(self, lines: Lines, noise: FloatArray) -> None:
        n = len(lines)
        self._H, self._kept = lines.to_bias, lines.kept.tolist()
        self._gains, self._whites = np.empty((n, 3, 2)), np.empty((n, 2, 2))
        log_determinant = 0.0
        P = np.zeros((3, 3))
        for i, share in enumerate(self._kept):
            H = self._H[i]
            P = share * share * P
            P.flat[::4] += (1.0 - share * share) * lines.bias_variance[i]
            PH = P @ H.T
            S = H @ PH + noise[i]
            self._whites[i], log = whitener(S)
            log_determinant += log
            inverse = self._whites[i].T @ self._whites[i]
            self._gains[i] = PH @ inverse
            P = P - self._gains[i] @ PH.T
        self.log_determinant = log_determinant

    def whitened(self, residuals: FloatArray) -> FloatArray:
        """Innovations (N, 2, K) of residuals (N, 2, K), each of variance 1 and independent."""
        innovations = np.empty_like(residuals)
        mean = np.zeros((3, residuals.shape[2]))
        for i, share in enumerate(self._kept):
            if share == 0.0:
                mean[:] = 0.0
            else:
                mean *= share
            innovation = residuals[i] - self._H[i] @ mean
            mean += self._gains[i] @ innovation
            innovations[i] = innovation
        return np.asarray(self._whites @ innovations)


def whitener(S: FloatArray) -> tuple[FloatArray, float]:
    """The inverse of Cholesky's factor of a covariance (2, 2), and the log of its determinant."""
    first = math.sqrt(float(S[0, 0]))
    mixed = float(S[0, 1]) / first
    second = math.sqrt(max(float(S[1, 1]) - mixed * mixed, 1e-30))
    inverse = np.array([[1.0 / first, 0.0], [-mixed / (first * second), 1.0 / second]])
    return inverse, 2.0 * (math.log(first) + math.log(second))


def noise_of(lines: Lines, heading_white_rad: float, scatter_rad: float, range_m: FloatArray) -> FloatArray:
    """Each sighting's own variance (N, 2, 2): what is told, the position's at ranges (N,), and what was found out.

    That is how far the heading jumps from sighting to sighting, where it is not told, and how far all scatters.
    """
    noise = np.zeros((len(lines), 2, 2))
    about_up = np.einsum("nji,ni->nj", lines.to_bias, lines.up)
    jump = np.where(lines.is_heading_told, lines.heading_white, heading_white_rad)
    noise += np.square(jump)[:, None, None] * about_up[:, :, None] * about_up[:, None, :]
    common = np.square(lines.attitude_white) + scatter_rad**2 + np.square(lines.position_m / np.maximum(range_m, 1.0))
    own = np.square(lines.mark) + common[:, None] + LEAST_VARIANCE
    noise[:, 0, 0] += own[:, 0]
    noise[:, 1, 1] += own[:, 1]
    return noise
