"""A second localizer that believes the poses' heading and tilt, beside the service's own. The demo draws its ellipse.

It gets the frames that the stage has processed and steps in a thread of its own; the service knows nothing of it.
"""

import dataclasses
from concurrent.futures import Future, ThreadPoolExecutor

import numpy as np

from distloc.localizer import Localizer
from distloc.types import CameraPose, FloatArray, TargetEstimate
from service.config.sections import Config
from service.localise.stage import Localised, localizer_config

_NO_BIAS_RAD = 1e-6  # none to speak of, and still a covariance


class BiasBlind:
    """The calibrated filter with the biases' sizes all but 0; the white errors are as the poses say."""

    def __init__(self, config: Config) -> None:
        rng = np.random.Generator(np.random.SFC64(config.localizer.seed))
        self._localizer = Localizer(config.camera.camera(), localizer_config(config.localizer), rng=rng)
        self._errors = config.pose_errors.pose_errors()
        self._worker = ThreadPoolExecutor(1, thread_name_prefix="bias-blind")
        self._last: Future[list[TargetEstimate]] | None = None

    def see(self, localised: Localised) -> None:
        """Have a frame's step done; returns at once."""
        if localised.mask is not None:
            self._last = self._worker.submit(self._localizer.step, self._blinded(localised.pose), localised.mask)

    def nearest(self, position_enu_m: FloatArray) -> TargetEstimate | None:
        """The last estimate of its target nearest to a place, once all steps are done; None where it has none."""
        self._worker.shutdown(wait=True)
        estimates = self._last.result() if self._last else []
        return min(
            estimates,
            key=lambda one: float(np.linalg.norm((one.position_enu_m - position_enu_m)[:2])),
            default=None,
        )

    def _blinded(self, pose: CameraPose) -> CameraPose:
        errors = dataclasses.replace(
            pose.errors or self._errors, heading_bias_rad=_NO_BIAS_RAD, tilt_bias_rad=_NO_BIAS_RAD
        )
        return dataclasses.replace(pose, errors=errors)
