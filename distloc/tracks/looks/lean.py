"""How smoke leans over its root, and so where a fire is whose foot trees or a ridge may hide.

A root is as wide as smoke is at that height, so the fire is at most about that far under it, and upwind. One picture
shows the lean across the line of sight; from several sides, or by its prior, the rest is known.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from distloc.filter.ground import Ground
from distloc.types import FloatArray

_PRIOR = 0.6  # one standard deviation on each axis, of metres downwind for each metre up
_BEFORE = np.eye(2) / _PRIOR**2
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


class Leans:
    """Metres east and north for each metre up, by all pictures of late: a row for each place of the bank.

    Information (places, 2, 2), the inverse of the covariance by the pictures and the prior, and that times the mean
    (places, 2).
    """

    def __init__(self, places: int) -> None:
        self.information, self.weighed = np.zeros((places, 2, 2)), np.zeros((places, 2))
        self._stamp_s = np.zeros(places)
        for place in range(places):
            self.clear(place)

    def clear(self, place: int) -> None:
        """Nothing was seen."""
        self.restore(place, _BEFORE, np.zeros(2), -np.inf)

    def restore(self, place: int, information: FloatArray, weighed: FloatArray, stamp_s: float) -> None:
        """Go on from what was known then."""
        self.information[place], self.weighed[place], self._stamp_s[place] = information, weighed, stamp_s

    def add(self, places: NDArray[np.intp], stamp_s: float, right_enu: FloatArray, lean: FloatArray) -> None:
        """What one picture shows, to the right (k, 3) for each step up (k,); older ones are forgotten."""
        kept = np.exp(-np.maximum(stamp_s - self._stamp_s[places], 0.0) / _LASTS_S)[:, None]
        right = right_enu[:, :2]
        seen = right[:, :, None] * right[:, None, :]
        self.information[places] = _BEFORE + kept[:, None] * (self.information[places] - _BEFORE) + seen
        self.weighed[places] = kept * self.weighed[places] + (_BELOW * lean)[:, None] * right
        self._stamp_s[places] = stamp_s

    def pictures(self, places: NDArray[np.intp]) -> tuple[FloatArray, FloatArray]:
        """What they tell without the prior: the information (k, 2, 2), and that times the means (k, 2)."""
        return self.information[places] - _BEFORE, self.weighed[places]

    def of(self, places: NDArray[np.intp]) -> tuple[FloatArray, FloatArray]:
        """The means (k, 2) and covariances (k, 2, 2)."""
        covariance = np.linalg.inv(self.information[places])
        mean = (covariance @ self.weighed[places, :, None])[:, :, 0]
        return mean, covariance + _LEAST**2 * np.eye(2)


def hidden_of(
    lean: FloatArray,
    unsure: FloatArray,
    root_m: FloatArray,
    mean_enu_m: FloatArray,
    up_m2: FloatArray,
    ground: Ground,
) -> Beside:
    """From k roots, so wide (k,) and at about (k, 3) with variances (k,) of the height, to the fires.

    The lean has these means (k, 2) and covariances (k, 2, 2).

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
    covariance_m2 = (
        variance_m2[:, None, None] * lean[:, :, None] * lean[:, None, :]
        + (np.square(down_m) + variance_m2)[:, None, None] * unsure
    )
    shift = -down_m[:, None] * np.concatenate([lean, np.ones((len(lean), 1))], axis=1)
    return Beside(shift, lean / _BELOW, covariance_m2, np.sqrt(variance_m2))
