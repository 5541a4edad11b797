"""How smoke leans over its root, and so where a fire is whose foot trees or a ridge may hide; its track has one.

A root is as wide as smoke is at that height, so the fire is at most about that far under it, and upwind. One picture
shows the lean across the line of sight; from several sides, or by its prior, the rest is known.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from distloc.filter.ground import Ground
from distloc.sights.sights import Ray
from distloc.types import FloatArray

_PRIOR = 0.6  # one standard deviation on each axis, of metres downwind for each metre up
_LEAST = 0.2  # of what all pictures leave; that of one is 1
_LASTS_S = 60.0
_BELOW = 0.65  # smoke that slows down leans more the higher it is: of the lean over the root, that under it
_UNDER, _MOST_UNDER_M = 1.05, 70.0  # how far the fire may be under the root: of the root's width, and of trees


@dataclass(frozen=True, slots=True)
class Beside:
    """What k clouds of particles lack: from their means to the answers (k, 3), and what that errs by.

    `lean` (k, 2) is the smoke's over the root, metres east and north for each metre up. `covariance_m2` (k, 2, 2) is
    east and north, `up_sigma_m` (k,) one standard deviation of the height.
    """

    shift_enu_m: FloatArray
    lean: FloatArray
    covariance_m2: FloatArray
    up_sigma_m: FloatArray


class Lean:
    """Metres east and north for each metre up, by all pictures of late."""

    def __init__(
        self, weighed: FloatArray | None = None, information: FloatArray | None = None, stamp_s: float = -math.inf
    ) -> None:
        self.ee, self.en, self.nn = _PRIOR**-2, 0.0, _PRIOR**-2  # information
        self.e = self.n = 0.0
        self._stamp_s = stamp_s
        if weighed is not None and information is not None:
            (self.ee, self.en), (_, self.nn) = information.tolist()
            self.e, self.n = weighed.tolist()

    @property
    def information(self) -> FloatArray:
        """The inverse of the covariance (2, 2) by the pictures and the prior."""
        return np.array([(self.ee, self.en), (self.en, self.nn)])

    @property
    def weighed(self) -> FloatArray:
        """The information times the mean (2,)."""
        return np.array([self.e, self.n])

    def add(self, ray: Ray) -> None:
        """What one picture shows; older ones are forgotten."""
        stamp_s, (east, north, _) = ray.pose.stamp_s, ray.axes[0].tolist()
        kept, before, lean = math.exp(-max(stamp_s - self._stamp_s, 0.0) / _LASTS_S), _PRIOR**-2, _BELOW * ray.lean
        self.ee = before + kept * (self.ee - before) + east * east
        self.nn = before + kept * (self.nn - before) + north * north
        self.en = kept * self.en + east * north
        self.e, self.n = kept * self.e + lean * east, kept * self.n + lean * north
        self._stamp_s = stamp_s


def leans_of(leans: Sequence[Lean]) -> tuple[FloatArray, FloatArray]:
    """The means (k, 2) and covariances (k, 2, 2) of k."""
    covariance = np.linalg.inv(np.array([((one.ee, one.en), (one.en, one.nn)) for one in leans]))
    mean = (covariance @ np.array([(one.e, one.n) for one in leans])[:, :, None])[:, :, 0]
    return mean, covariance + _LEAST**2 * np.eye(2)


def hidden_of(
    leans: Sequence[Lean], root_m: FloatArray, mean_enu_m: FloatArray, up_m2: FloatArray, ground: Ground
) -> Beside:
    """From k roots, so wide (k,) and at about (k, 3) with variances (k,) of the height, to the fires.

    Each is likeliest at the root, and less and less so down to a root's width under it; where the ground is known,
    nearer that.
    """
    most_m = np.minimum(_UNDER * root_m, _MOST_UNDER_M)
    down_m, variance_m2 = most_m / 3.0, np.square(most_m) / 18.0
    ground_m, is_known = ground.heights_m(mean_enu_m[:, 0], mean_enu_m[:, 1])
    sigma_m = np.minimum(ground.sigmas_m(mean_enu_m[:, 0], mean_enu_m[:, 1]), 1e6)
    share = np.where(is_known, variance_m2 / (variance_m2 + np.square(sigma_m) + up_m2), 0.0)
    down_m = np.clip(down_m + share * (mean_enu_m[:, 2] - ground_m - down_m), 0.0, most_m)
    variance_m2 = (1.0 - share) * variance_m2
    lean, unsure = leans_of(leans)
    covariance_m2 = (
        variance_m2[:, None, None] * lean[:, :, None] * lean[:, None, :]
        + (np.square(down_m) + variance_m2)[:, None, None] * unsure
    )
    shift = -down_m[:, None] * np.concatenate([lean, np.ones((len(leans), 1))], axis=1)
    return Beside(shift, lean / _BELOW, covariance_m2, np.sqrt(variance_m2))
