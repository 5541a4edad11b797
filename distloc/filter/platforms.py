"""Who carries the camera: the names of the platforms, and the attitude errors of those that don't look now.

Each platform has an attitude error of its own. Given a target's position they are independent but for the aim's error,
which they share, so a target keeps the errors of all platforms in one covariance, and each particle its means of them.
The platform that looks has its error in the first three rows; the others are parked behind the aim's. The bank asks.
"""

import numpy as np
from numpy.typing import NDArray

from distloc.filter.regularise import Side
from distloc.sights.sight import NUISANCES, STATE
from distloc.snapshot import Float32Array
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

    def name(self, number: int) -> str:
        """That of a number; "" while none came."""
        return next((name for name, one in self._numbers.items() if one == number), "")


class Slots:
    """Which platform's error lies where at each place, and since when: slot 0 is that of the platform that looks.

    `stamp_s` (places, platforms) is until when each has forgotten itself: minus infinity where the platform never
    looked at the target. `bias_variance` and `widest_variance` are (places, platforms, 3, 3); `axes` of the same shape
    and `camera_enu_m` (places, platforms, 3) are of each one's last sight.
    """

    def __init__(self, places: int, platforms: int) -> None:
        self.platforms = platforms
        self.nuisances = NUISANCES + 3 * (platforms - 1)
        self._numbers = np.tile(np.arange(platforms), (places, 1))
        self.stamp_s = np.full((places, platforms), -np.inf)
        self.bias_variance = np.zeros((places, platforms, 3, 3))
        self.widest_variance = np.zeros((places, platforms, 3, 3))
        self.axes, self.camera_enu_m = np.zeros((places, platforms, 3, 3)), np.zeros((places, platforms, 3))

    def begin(self, place: int, number: int | None) -> None:
        """A new target: no platform has looked at it; the first that does has this number."""
        if number is not None:
            self._numbers[place] = np.roll(np.arange(self.platforms), -number)
        self.stamp_s[place] = -np.inf
        self.bias_variance[place] = self.widest_variance[place] = 0.0

    def of(self, places: NDArray[np.intp], number: int) -> NDArray[np.intp]:
        """In which slot a platform's error lies at each place (k,)."""
        return np.asarray((self._numbers[places] == number).argmax(axis=1))

    def swap(self, places: NDArray[np.intp], slot: int) -> NDArray[np.intp]:
        """Slot 0 with another; the order (n,) in which the nuisances are then."""
        at, there, here = places[:, None], [slot, 0], [0, slot]
        for array in (
            self._numbers,
            self.stamp_s,
            self.bias_variance,
            self.widest_variance,
            self.axes,
            self.camera_enu_m,
        ):
            array[at, here] = array[at, there]
        order, parked = np.arange(self.nuisances), NUISANCES + 3 * (slot - 1) + _BIAS
        order[_BIAS], order[parked] = parked, _BIAS
        return order

    def saw(self, places: NDArray[np.intp], axes: FloatArray, camera_enu_m: FloatArray) -> None:
        """The platform that looks did, by sights' axes (k, 3, 3) from (3,)."""
        self.axes[places, 0], self.camera_enu_m[places, 0] = axes, camera_enu_m

    def sides(self, place: int, sample: Float32Array, origin_enu_m: FloatArray) -> list[Side]:
        """How the parked errors follow the positions of equally likely particles (3 + nuisances, n)."""
        return [
            Side.of(
                sample,
                slice(STATE + 3 * (slot - 1), STATE + 3 * slot),
                self.axes[place, slot],
                self.axes[place, slot] @ (origin_enu_m - self.camera_enu_m[place, slot]),
            )
            for slot in range(1, self.platforms)
            if np.isfinite(self.stamp_s[place, slot])
        ]


def kept_until(stamp_s: float, before_s: FloatArray, time_constant_s: float) -> FloatArray:
    """What share (k,) errors keep that have forgotten themselves until `before_s` (k,); none where that is never."""
    is_known = np.isfinite(before_s)
    elapsed_s = np.maximum(0.0, stamp_s - np.where(is_known, before_s, stamp_s))
    return np.asarray(np.where(is_known, np.exp(-elapsed_s / time_constant_s), 0.0))
