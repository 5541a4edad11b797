"""The bootstrap step as Stone-Soup's predictor, updater and resampler; imported only where it is installed.

One ParticleState holds all particles as StateVectors. The diffusion's noise comes from NumPy's fast generator and not
from SciPy's general multivariate normal, which would take longer than all the rest.
"""

from datetime import datetime, timedelta, timezone
from typing import Any

import numpy as np
from stonesoup.base import Property
from stonesoup.models.measurement.base import MeasurementModel
from stonesoup.models.transition.linear import LinearGaussianTimeInvariantTransitionModel
from stonesoup.predictor.particle import ParticlePredictor
from stonesoup.resampler.particle import SystematicResampler
from stonesoup.types.array import StateVectors
from stonesoup.types.detection import Detection
from stonesoup.types.hypothesis import SingleHypothesis
from stonesoup.types.state import ParticleState
from stonesoup.updater.particle import ParticleUpdater

from distloc.types import FloatArray
from service.commands.bench.published.start import spread_along
from service.commands.bench.scene import SIGMA_P_M, Seen

_START = datetime(2026, 1, 1, tzinfo=timezone.utc)


class Diffusion(LinearGaussianTimeInvariantTransitionModel):  # type: ignore[misc]
    """x + sigma_p times white noise."""

    rng: np.random.Generator = Property(doc="Draws the noise.")

    def function(self, state: Any, noise: bool = False, **_options: Any) -> Any:
        """The particles moved, (3, N)."""
        moved = self.rng.standard_normal(state.state_vector.shape)
        moved *= SIGMA_P_M
        moved += state.state_vector
        return moved.view(StateVectors)


class NearestPixel(MeasurementModel):  # type: ignore[misc]
    """The likelihood of a frame's mask, for all particles at once."""

    seen: Seen = Property(default=None, doc="The frame that weighs.")

    @property
    def ndim_meas(self) -> int:
        """A mask is no vector: what stands for it has no use."""
        return 1

    def logpdf(self, detection: Any, state: Any, **_options: Any) -> FloatArray:
        """Logarithms (N,) of exp(-min d^2)."""
        return np.asarray(self.seen.near.log_weights(np.asarray(state.state_vector), self.seen.pose))

    def pdf(self, detection: Any, state: Any, **_options: Any) -> FloatArray:
        """The weights (N,)."""
        return np.asarray(np.exp(self.logpdf(detection, state)))

    def function(self, state: Any, noise: bool = False, **_options: Any) -> Any:
        """Not used by the particle updater's update."""
        raise NotImplementedError

    def rvs(self, num_samples: int = 1, **_options: Any) -> Any:
        """Not used by it either."""
        raise NotImplementedError


class StoneSoupFilter:
    """Predict, update, resample by the framework's own parts."""

    def __init__(self, n_particles: int) -> None:
        self._n_particles = n_particles
        self._model = NearestPixel(ndim_state=3, mapping=(0, 1, 2))
        rng = np.random.Generator(np.random.SFC64(1))
        self._predictor = ParticlePredictor(Diffusion(np.eye(3), SIGMA_P_M**2 * np.eye(3), rng))
        self._updater = ParticleUpdater(self._model, resampler=SystematicResampler())

    @property
    def mean_enu_m(self) -> FloatArray:
        """(3,): all are equally likely after a step."""
        return np.asarray(np.mean(np.asarray(self._cloud.state_vector), axis=1), dtype=np.float64)

    def begin(self, seen: Seen) -> None:
        """Start, and take the first frame like the others."""
        cloud = spread_along(seen, self._n_particles, np.random.Generator(np.random.SFC64(2)))
        self._set(cloud, np.full(self._n_particles, -np.log(self._n_particles)), _START)
        self.step(seen)

    def step(self, seen: Seen) -> None:
        """One step of a second."""
        self._model.seen = seen
        stamp = self._cloud.timestamp + timedelta(seconds=1)
        prediction = self._predictor.predict(self._cloud, timestamp=stamp)
        detection = Detection(np.zeros((1, 1)), timestamp=stamp, measurement_model=self._model)
        updated = self._updater.update(SingleHypothesis(prediction, detection))
        self._set(updated.state_vector, updated.log_weight, stamp)

    def _set(self, cloud: FloatArray, log_weight: FloatArray, stamp: datetime) -> None:
        # a state of its own: one that knows its parents would slice and keep them as well
        self._cloud = ParticleState(StateVectors(cloud), log_weight=log_weight, timestamp=stamp)


make = StoneSoupFilter
