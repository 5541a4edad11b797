"""Spreads the copies that resampling leaves, by a kernel that keeps mean and covariance (Liu and West 2001).

It works in coordinates about the camera, where a cloud is nearest to a Gaussian: tangents right and up, logarithm of
the depth. A particle's means of the nuisances follow its move by their regression on the cloud, for they are a function
of the position.
"""

from dataclasses import dataclass

import numpy as np

from distloc.backports import Self
from distloc.snapshot import Float32Array
from distloc.types import FloatArray

_WIDER = 1.4
_GAUSSIAN_MIDDLE = 1.349  # between its quartiles, in standard deviations
_UNIFORM_SIGMA = np.sqrt(1.0 / 12.0)


def bandwidth_of(n: int) -> float:
    """For copies among n particles: Silverman's rule (1986) for three dimensions, and more.

    It is 0.41 for 4,096. With a quarter of that the copies stay where they are, and a cloud of a few thousand cannot
    follow a target that stands in its tail: one flight in twenty ended far outside its ellipse, and of those whose
    heading erred by three of its standard deviations all did; a quarter with the rule as it is, one in 25 with more.
    """
    return _WIDER * float((4.0 / (5.0 * n)) ** (1.0 / 7.0))


@dataclass(frozen=True, slots=True)
class Kernel:
    """For particles (3 + k, n): positions, `shift` (3, 1) short of the camera's axes (3, 3), and k nuisances.

    In the camera's coordinates: `centre` (3, 1) of the cloud, `root` (3, 3) from three independent numbers of variance
    1 to a move, `shrink` (3, 3) from what a particle is off the centre to the move that takes as much off the
    covariance, `slope` (k, 3) of the nuisances.
    """

    axes: Float32Array
    shift: Float32Array
    centre: Float32Array
    root: Float32Array
    shrink: Float32Array
    slope: Float32Array

    @classmethod
    def of(cls, particles: Float32Array, axes: FloatArray, shift: FloatArray, bandwidth: float) -> Self:
        """From a sample of equally likely particles, about a camera whose axes' rows are right, up and along the ray.

        `shift` (3,) is what a position lacks in these axes; the bandwidth is a share of the standard deviation.
        """
        axes32, shift32 = axes.astype(np.float32), shift.astype(np.float32)[:, None]
        q = _seen(particles[:3], axes32, shift32, np.empty_like(particles[:3]))
        centre = q.mean(axis=1, keepdims=True, dtype=np.float64).astype(np.float32)
        q -= centre
        m = particles[3:] - particles[3:].mean(axis=1, keepdims=True)
        values, vectors = np.linalg.eigh((q @ q.T).astype(np.float64) / q.shape[1])
        values = np.maximum(values, 1e-6 * values[2] + 1e-14)  # few ancestors leave a flat cloud, rounding less
        slope = m @ q.T / q.shape[1] @ (vectors / values @ vectors.T)
        sigmas = np.sqrt(values)
        shares = bandwidth * _core((vectors / sigmas).T.astype(np.float32) @ q)
        root, shrink = vectors * shares * sigmas, vectors * (np.sqrt(1.0 - shares**2) - 1.0) @ vectors.T
        return cls(
            axes32, shift32, centre, root.astype(np.float32), shrink.astype(np.float32), slope.astype(np.float32)
        )

    def spread(
        self,
        particles: Float32Array,
        origin_shift: FloatArray,
        rng: np.random.Generator,
        scratch: tuple[Float32Array, Float32Array, Float32Array],
    ) -> None:
        """Move particles (3 + k, n) in place, and their positions to an origin of which they lack `origin_shift` (3,).

        `scratch` is three arrays: (3, n), (3, n) and (k, n). The noise is uniform: only its moments matter, and it
        costs a quarter of a Gaussian's.
        """
        q, move, turned = scratch
        _seen(particles[:3], self.axes, self.shift, q)
        rng.random(dtype=np.float32, out=move)
        move -= np.float32(0.5)
        np.matmul(self.root * np.float32(1.0 / _UNIFORM_SIGMA), move, out=turned[:3])
        q -= self.centre
        np.matmul(self.shrink, q, out=move)
        move += turned[:3]
        q += self.centre
        particles[3:] += np.matmul(self.slope, move, out=turned)
        q += move
        np.exp(q[2], out=q[2])
        q[:2] *= q[2]
        q -= origin_shift.astype(np.float32)[:, None]
        np.matmul(self.axes.T, q, out=particles[:3])


@dataclass(frozen=True, slots=True)
class Side:
    """How another platform's bias, in these rows of the particles, follows a position.

    As that platform saw it last the bias is linear in where the position is, right and up; from the camera that looks
    now it is not, and what a kernel moves along a straight line there contradicts each of its sights.
    """

    rows: slice
    axes: Float32Array
    shift: FloatArray
    centre: Float32Array
    slope: Float32Array

    @classmethod
    def of(cls, particles: Float32Array, rows: slice, axes: FloatArray, shift: FloatArray) -> Self:
        """From a sample of equally likely ones; `shift` (3,) is what a position lacks in that platform's axes."""
        axes32 = axes.astype(np.float32)
        q = _seen(particles[:3], axes32, shift.astype(np.float32)[:, None], np.empty_like(particles[:3]))
        centre = q.mean(axis=1, keepdims=True, dtype=np.float64).astype(np.float32)
        q -= centre
        m = particles[rows] - particles[rows].mean(axis=1, keepdims=True)
        slope = m @ q.T / q.shape[1] @ _inverse((q @ q.T).astype(np.float64) / q.shape[1])
        return cls(rows, axes32, shift, centre, slope.astype(np.float32))

    def follow(
        self, particles: Float32Array, origin_m: FloatArray, sign: float, q: Float32Array, moved: Float32Array
    ) -> None:
        """Add, or with -1 take off, what is of positions about an origin (3,); `q` and `moved` (3, n) are scratch."""
        shift = (self.shift + self.axes @ origin_m).astype(np.float32)[:, None]
        _seen(particles[:3], self.axes, shift, q)
        q -= self.centre
        np.matmul(np.float32(sign) * self.slope, q, out=moved)
        particles[self.rows] += moved


def _inverse(covariance: FloatArray) -> FloatArray:
    """Of a (3, 3) that may be flat: few ancestors leave such a cloud."""
    values, vectors = np.linalg.eigh(covariance)
    return np.asarray(vectors / np.maximum(values, 1e-6 * values[2] + 1e-14) @ vectors.T)


def _core(whitened: Float32Array) -> FloatArray:
    """How wide the middle half of a cloud (3, n), which is put in order, is; 1 for a standard Gaussian, never more.

    Where most of the cloud is in one place and the rest anywhere, only the first may say how far copies are spread.
    """
    n = whitened.shape[1]
    low, high = n // 4, min(3 * n // 4, n - 1)
    whitened.partition([low, high], axis=1)
    return np.clip((whitened[:, high] - whitened[:, low]).astype(np.float64) / _GAUSSIAN_MIDDLE, 1e-3, 1.0)


def _seen(positions: Float32Array, axes: Float32Array, shift: Float32Array, out: Float32Array) -> Float32Array:
    """Tangents right and up and the logarithm of the depth, in `out` (3, n)."""
    np.matmul(axes, positions, out=out)
    out += shift
    np.maximum(out[2], 1.0, out=out[2])
    out[:2] /= out[2]
    np.log(out[2], out=out[2])
    return out
