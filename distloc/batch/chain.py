"""Residuals of correlated sightings turned into independent ones of variance 1: a Kalman filter over the slow errors.

Each platform's attitude error is a Gauss-Markov chain about east, north and up. Its filter's gains don't depend on
where the target is, so what is left of the residuals after it, by its own standard deviations (the innovations), is
linear in them: one pass serves any number of points. `posterior` minimises its squares, which marginalises the errors
out exactly.
"""

import math

import numpy as np

from distloc.batch.lines import Lines
from distloc.types import FloatArray

LEAST_VARIANCE = 1e-9  # of an angle: 0.002 degrees, for whoever tells that nothing errs


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
