"""One measured direction; the sights make it, the filters weigh it."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from distloc.types import FloatArray

NUISANCES = 5  # the bias about east, north and up, and the aim's error right and up


@dataclass(frozen=True)
class Sight:
    """A measured direction from a camera at `position_enu_m` (3,).

    `axes` (3, 3) has rows right, up and along the ray in ENU. `covariance` (2, 2) is that of the measurement's white
    errors, in tangents of the angles right and up.
    """

    stamp_s: float
    position_enu_m: FloatArray
    axes: FloatArray
    covariance: FloatArray

    @cached_property
    def by_nuisance(self) -> FloatArray:
        """H (2, 5): where the truth lies, right and up of the measured ray, by the nuisances.

        They are the bias about east, north and up, and the aim's error right and up.
        """
        H = np.zeros((2, NUISANCES))
        H[0, :3], H[1, :3] = self.axes[1], -self.axes[0]
        H[0, 3] = H[1, 4] = 1.0
        return H
