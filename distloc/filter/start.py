"""How particles are spread along a ray that is all that is known of a target, or with a prior; the bank calls it."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from distloc.filter.particles import Particles
from distloc.sights.sight import STATE
from distloc.snapshot import Float32Array
from distloc.types import FloatArray

Prior = Callable[[FloatArray], FloatArray]  # logarithms of weights (B,) for positions (3, B) in ENU

_BINS = 64  # of the logarithm of the range


@dataclass(frozen=True, slots=True)
class Cone:
    """About axes (3, 3) right, up and along: by `root` (2, 2) in tangents, with nuisances `gain` (5, 2) times that."""

    axes: FloatArray
    root: FloatArray
    gain: FloatArray


def spread_along(
    cone: Cone,
    particles: Particles,
    place: int,
    range_m: tuple[float, float],
    prior: Prior | None,
    rng: np.random.Generator,
) -> None:
    """Uniform in the logarithm of the range; with a prior they are weighed by it, half of them where it leaves any.

    A narrow prior leaves a hundredth of what is spread over all ranges: of a few thousand too few to go on with.
    """
    _spread(cone, particles, place, range_m, np.ones(_BINS), rng)
    if prior is not None:
        _weigh_by(particles, place, prior)
        left = np.add.reduceat(particles.weights[place], np.arange(_BINS) * particles.n // _BINS)
        density = 0.5 + 0.5 * _BINS * np.convolve(left, (0.25, 0.5, 0.25), mode="same")
        _spread(cone, particles, place, range_m, density, rng)
        _weigh_by(particles, place, prior)


def _spread(
    cone: Cone,
    particles: Particles,
    place: int,
    range_m: tuple[float, float],
    density: FloatArray,
    rng: np.random.Generator,
) -> None:
    """So dense in each bin, one in each stratum; by their weights they are uniform."""
    low, high = np.log(range_m)
    edges, shares = np.linspace(0.0, 1.0, _BINS + 1), np.concatenate([[0.0], np.cumsum(density)])
    axes, root, gain = (one.astype(np.float32) for one in (cone.axes, cone.root, cone.gain))
    for block in particles.blocks(np.array([place])):
        (x,), (weights,) = particles.of(block)
        across = root @ rng.standard_normal((2, weights.size), dtype=np.float32)
        stratum = np.arange(block.particles.start, block.particles.stop) + rng.random(weights.size)
        rank = np.interp(stratum * (shares[-1] / particles.n), shares, edges)
        depth = np.exp(low + (high - low) * rank).astype(np.float32)
        np.matmul(axes.T, np.vstack([across * depth, depth]), out=x[:3])
        np.matmul(gain, across, out=x[3:STATE])
        x[STATE:] = 0.0
        weights[:] = 1.0 / density[np.minimum((rank * _BINS).astype(np.intp), _BINS - 1)]
    _normalise(particles.weights[place])


def _weigh_by(particles: Particles, place: int, prior: Prior) -> None:
    weights = particles.weights[place]
    np.log(weights, out=weights)
    for block in particles.blocks(np.array([place])):
        (x,), (log,) = particles.of(block)
        log += prior(x[:3] + particles.origin_enu_m[place, :, None])
    best = weights.max()
    if best > -np.inf:
        weights -= best
        np.exp(weights, out=weights)
    else:  # it allows no particle: nothing known
        weights.fill(1.0)
    _normalise(weights)


def _normalise(weights: Float32Array) -> None:
    weights *= np.float32(1.0 / weights.sum(dtype=np.float64))
