"""How well particles fit a sight, by their innovations in its own unit; the calibrated filter calls it."""

import math

import numpy as np
from numpy.typing import NDArray

from distloc.snapshot import Float32Array
from distloc.types import FloatArray


def densities(white: Float32Array, in_front: NDArray[np.bool_] | None) -> Float32Array:
    """exp(-d^2 / 2) (B,) of whitened innovations (2, B), which are overwritten; 0 behind the camera."""
    np.square(white, out=white)
    density: Float32Array = white[0]
    density += white[1]
    density *= np.float32(-0.5)
    np.exp(density, out=density)
    if in_front is not None:
        density *= in_front
    return density


def log_posterior(weights: Float32Array, white: Float32Array, in_front: NDArray[np.bool_] | None) -> Float32Array:
    """Logarithms (B,) of weights times exp(-d^2 / 2); minus infinity for no weight and behind the camera."""
    with np.errstate(divide="ignore"):
        log: Float32Array = np.log(weights) - np.float32(0.5) * np.square(white).sum(axis=0)
    if in_front is not None:
        log[~in_front] = -np.inf
    return log


def whitening(S: FloatArray) -> FloatArray:
    """The inverse of the Cholesky factor of a covariance (2, 2): what it multiplies has the identity for covariance."""
    a = math.sqrt(S[0, 0])
    b = S[1, 0] / a
    c = math.sqrt(S[1, 1] - b * b)
    return np.array([[1.0 / a, 0.0], [-b / (a * c), 1.0 / c]])
