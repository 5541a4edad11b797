"""How well particles fit a sight, by their innovations in its own unit; the calibrated filter calls it."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from distloc.backports import Self
from distloc.snapshot import Float32Array
from distloc.types import FloatArray

_LEAST_ACROSS = 1e-12  # of a covariance


@dataclass(frozen=True, slots=True)
class View:
    """From particles (k, 8, B) by `A` (k, 5, 8) and `shift` (k, 3, 1) to what is right and up of k sights.

    Each in a unit of its own. The first two rows are that times the depth, the third is the depth in metres, the last
    two the nuisances' part.
    """

    A: Float32Array
    shift: Float32Array

    def at(self, which: slice) -> Self:
        """Of some of the sights."""
        return type(self)(self.A[which], self.shift[which])

    def innovations(
        self, x: Float32Array, out: Float32Array | None = None
    ) -> tuple[Float32Array, NDArray[np.bool_] | None]:
        """u(p) - H m (k, 2, B) of particles (k, 8, B), in `out` (k, 5, B); which (k, B) are in front, None if all."""
        seen: Float32Array = np.matmul(self.A, x, out=out)
        seen[:, :3] += self.shift
        depth = seen[:, 2]
        in_front = None
        if not depth.min() > 1.0:
            in_front = depth > 1.0
            np.maximum(depth, 1.0, out=depth)
        innovations = seen[:, :2]
        innovations /= depth[:, None]
        innovations -= seen[:, 3:]
        return innovations, in_front


def densities(white: Float32Array, in_front: NDArray[np.bool_] | None) -> Float32Array:
    """exp(-d^2 / 2) (k, B) of whitened innovations (k, 2, B), which are overwritten; 0 behind the camera."""
    np.square(white, out=white)
    density: Float32Array = white[:, 0]
    density += white[:, 1]
    density *= np.float32(-0.5)
    np.exp(density, out=density)
    if in_front is not None:
        density *= in_front
    return density


def log_posterior(weights: Float32Array, white: Float32Array, in_front: NDArray[np.bool_] | None) -> Float32Array:
    """Logarithms (k, B) of weights times exp(-d^2 / 2); minus infinity for no weight and behind the camera."""
    with np.errstate(divide="ignore"):
        log: Float32Array = np.log(weights) - np.float32(0.5) * np.square(white).sum(axis=1)
    if in_front is not None:
        log[~in_front] = -np.inf
    return log


def whitening(S: FloatArray) -> FloatArray:
    """The inverses of the Cholesky factors of covariances (k, 2, 2): what they multiply has the identity."""
    a = np.sqrt(S[:, 0, 0])
    b = S[:, 1, 0] / a
    # a sight that tells nothing along one line may have rounding alone across it
    c = np.sqrt(np.maximum(S[:, 1, 1] - b * b, _LEAST_ACROSS * S[:, 1, 1]))
    whiten = np.zeros_like(S)
    whiten[:, 0, 0], whiten[:, 1, 0], whiten[:, 1, 1] = 1.0 / a, -b / (a * c), 1.0 / c
    return whiten
