"""One measured direction; the sights make it, the filters weigh it."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from distloc.backports import Self
from distloc.types import FloatArray

NUISANCES = 5  # the bias about east, north and up, and the aim's error right and up
STATE = 3 + NUISANCES  # with the position


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


@dataclass(frozen=True)
class Sights:
    """k sights from one camera at once: `axes` (k, 3, 3) and `covariance` (k, 2, 2)."""

    stamp_s: float
    position_enu_m: FloatArray
    axes: FloatArray
    covariance: FloatArray

    @classmethod
    def of(cls, sights: Sequence[Sight]) -> Self:
        """Of one frame's, at least one."""
        first = sights[0]
        axes, covariance = np.array([one.axes for one in sights]), np.array([one.covariance for one in sights])
        return cls(first.stamp_s, first.position_enu_m, axes, covariance)

    def chosen(self, which: NDArray[np.bool_] | NDArray[np.intp]) -> Self:
        """Some of them."""
        return type(self)(self.stamp_s, self.position_enu_m, self.axes[which], self.covariance[which])

    def one(self, index: int) -> Sight:
        """One of them."""
        return Sight(self.stamp_s, self.position_enu_m, self.axes[index], self.covariance[index])

    @cached_property
    def by_nuisance(self) -> FloatArray:
        """H (k, 2, 5): where the truth lies, right and up of the measured ray, by the nuisances.

        They are the bias about east, north and up, and the aim's error right and up.
        """
        H = np.zeros((self.axes.shape[0], 2, NUISANCES))
        H[:, 0, :3], H[:, 1, :3] = self.axes[:, 1], -self.axes[:, 0]
        H[:, 0, 3] = H[:, 1, 4] = 1.0
        return H
