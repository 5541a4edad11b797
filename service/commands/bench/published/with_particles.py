"""The bootstrap step as `particles.SMC` over a Feynman-Kac model; imported only where it is installed."""

import numpy as np
import particles

from distloc.types import FloatArray
from service.commands.bench.published.start import spread_along
from service.commands.bench.scene import SIGMA_P_M, Seen


class Model(particles.FeynmanKac):  # type: ignore[misc]
    """A static point (N, 3) that diffuses, weighed by the frame in `seen`."""

    def __init__(self, seen: Seen) -> None:
        super().__init__(T=1 << 30)
        self.seen = seen
        self._rng = np.random.Generator(np.random.SFC64(1))

    def M0(self, N: int) -> FloatArray:
        """The particles at first."""
        return np.ascontiguousarray(spread_along(self.seen, N, self._rng).T)

    def M(self, t: int, xp: FloatArray) -> FloatArray:
        """A step of diffusion."""
        moved = self._rng.standard_normal(xp.shape)
        moved *= SIGMA_P_M
        moved += xp
        return moved

    def logG(self, t: int, xp: FloatArray | None, x: FloatArray) -> FloatArray:
        """Logarithms of the weights."""
        return self.seen.near.log_weights(x.T, self.seen.pose)


class ParticlesFilter:
    """`SMC` resamples at the start of the next step: a step's cost is the same. Its summaries are switched off."""

    def __init__(self, n_particles: int) -> None:
        self._n_particles = n_particles

    @property
    def mean_enu_m(self) -> FloatArray:
        """(3,)."""
        return np.asarray(self._smc.W @ self._smc.X)

    def begin(self, seen: Seen) -> None:
        """Start and weigh."""
        self._model = Model(seen)
        # an ESS of all is under 1.01 of all: it resamples at every step
        self._smc = particles.SMC(
            fk=self._model, N=self._n_particles, resampling="systematic", ESSrmin=1.01, collect="off"
        )
        next(self._smc)

    def step(self, seen: Seen) -> None:
        """Resample, move, weigh."""
        self._model.seen = seen
        next(self._smc)


make = ParticlesFilter
