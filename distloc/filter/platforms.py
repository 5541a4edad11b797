"""Who carries the camera: the names of the platforms, and the attitude errors of those that don't look now.

Each platform has an attitude error of its own. Given a target's position they are independent but for the aim's error,
which they share, so a target keeps the errors of all platforms in one covariance, and each particle its means of them.
The platform that looks has its error in the first three rows; the others are parked behind the aim's. The bank asks.
"""

import numpy as np
from numpy.typing import NDArray

from distloc.sights.sight import NUISANCES
from distloc.types import FloatArray

_BIAS = np.arange(3)


class Names:
    """The platforms' names, numbered in the order in which they came; at most so many."""

    def __init__(self, most: int) -> None:
        self._most = most
        self._numbers: dict[str, int] = {}

    def __len__(self) -> int:
        return len(self._numbers)

    def number(self, name: str) -> int:
        """A name's number, from 0. ValueError for one name too many."""
        found = self._numbers.get(name)
        if found is None:
            if len(self._numbers) == self._most:
                known = ", ".join(repr(one) for one in self._numbers)
                raise ValueError(
                    f"CameraPose.platform {name!r} is one name too many after {known}: "
                    f"LocalizerConfig.platforms must be as many as there are, got {self._most}"
                )
            found = self._numbers[name] = len(self._numbers)
        return found


class Slots:
    """Which platform's error lies where at each place, and since when: slot 0 is that of the platform that looks.

    `stamp_s` (places, platforms) is until when each has forgotten itself: minus infinity where the platform never
    looked at the target. `bias_variance` and `widest_variance` are (places, platforms, 3, 3).
    """

    def __init__(self, places: int, platforms: int) -> None:
        self.platforms = platforms
        self.nuisances = NUISANCES + 3 * (platforms - 1)
        self._numbers = np.tile(np.arange(platforms), (places, 1))
        self.stamp_s = np.full((places, platforms), -np.inf)
        self.bias_variance = np.zeros((places, platforms, 3, 3))
        self.widest_variance = np.zeros((places, platforms, 3, 3))

    def begin(self, place: int) -> None:
        """A new target: no platform has looked at it."""
        self.stamp_s[place] = -np.inf
        self.bias_variance[place] = self.widest_variance[place] = 0.0

    def of(self, places: NDArray[np.intp], number: int) -> NDArray[np.intp]:
        """In which slot a platform's error lies at each place (k,)."""
        return np.asarray((self._numbers[places] == number).argmax(axis=1))

    def swap(self, places: NDArray[np.intp], slot: int) -> NDArray[np.intp]:
        """Slot 0 with another; the order (n,) in which the nuisances are then."""
        at, there, here = places[:, None], [slot, 0], [0, slot]
        for array in (self._numbers, self.stamp_s, self.bias_variance, self.widest_variance):
            array[at, here] = array[at, there]
        order, parked = np.arange(self.nuisances), NUISANCES + 3 * (slot - 1) + _BIAS
        order[_BIAS], order[parked] = parked, _BIAS
        return order


def kept_until(stamp_s: float, before_s: FloatArray, time_constant_s: float) -> FloatArray:
    """What share (k,) errors keep that have forgotten themselves until `before_s` (k,); none where that is never."""
    is_known = np.isfinite(before_s)
    elapsed_s = np.maximum(0.0, stamp_s - np.where(is_known, before_s, stamp_s))
    return np.asarray(np.where(is_known, np.exp(-elapsed_s / time_constant_s), 0.0))
