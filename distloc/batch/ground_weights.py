"""What the ground says of where a target can be: near it, and not behind what hides the line of sight.

Built on the prior that the filter starts its particles with: four in five targets have their visible foot on the
ground, one in five is smoke that rises behind a crest, anywhere within the relief under the line of sight.
"""

import numpy as np

from distloc.batch.posterior import LogWeights
from distloc.filter.ground import GridGround, Ground, ground_prior
from distloc.types import FloatArray

_SHARES = np.linspace(0.02, 0.97, 40)  # of the way to a target, where the ground must be under the line of sight


def ground_weights(ground: Ground, camera_enu_m: FloatArray) -> LogWeights | None:
    """The log of how likely points (K, 3) are to be a target that the camera (3,) sees; None without a ground."""
    prior = ground_prior(ground, camera_enu_m, 0.0)
    if prior is None:
        return None

    def log_weights(points_enu_m: FloatArray) -> FloatArray:
        near = prior(points_enu_m.T)
        return near + _hidden(ground, camera_enu_m, points_enu_m) if isinstance(ground, GridGround) else near

    return log_weights


def _hidden(ground: GridGround, camera_enu_m: FloatArray, points_enu_m: FloatArray) -> FloatArray:
    """The log of how likely the line of sight to points (K, 3) is free, by the most that ground stands into it."""
    least = np.full(len(points_enu_m), np.inf)
    for share in _SHARES:
        at = camera_enu_m + share * (points_enu_m - camera_enu_m)
        height_m, is_known = ground.heights_m(at[:, 0], at[:, 1])
        least = np.minimum(least, np.where(is_known, at[:, 2] - height_m, np.inf))
    return np.asarray(-0.5 * np.square(np.minimum(least / ground.sigma_m + 1.0, 0.0)))
