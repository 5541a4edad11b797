"""The bootstrap step as filterpy's documentation writes one: NumPy arrays and its systematic resampling.

Its residual resampling is wrong (it subtracts copies from weights that were not multiplied by N), its systematic one
is right, and loops over particles in Python: that is the library's own. Imported only where it is installed.
"""

import numpy as np
from filterpy.monte_carlo import systematic_resample

from distloc.types import FloatArray
from service.commands.bench.published.start import spread_along
from service.commands.bench.scene import SIGMA_P_M, Seen


class FilterpyFilter:
    """Particles (N, 3) as there, all equally likely after a step."""

    def __init__(self, n_particles: int) -> None:
        self._rng = np.random.Generator(np.random.SFC64(1))
        self._particles = np.zeros((n_particles, 3))

    @property
    def mean_enu_m(self) -> FloatArray:
        """(3,)."""
        return np.asarray(self._particles.mean(axis=0))

    def begin(self, seen: Seen) -> None:
        """Start, and take the first frame like the others."""
        self._particles = np.ascontiguousarray(spread_along(seen, len(self._particles), self._rng).T)
        self.step(seen)

    def step(self, seen: Seen) -> None:
        """Predict, update, resample."""
        moved = self._rng.standard_normal(self._particles.shape)
        moved *= SIGMA_P_M
        self._particles += moved
        weights = np.exp(seen.near.log_weights(self._particles.T, seen.pose))
        weights /= weights.sum()
        self._particles = self._particles[systematic_resample(weights)]


make = FilterpyFilter
