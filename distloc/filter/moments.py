"""What clouds of weighted particles sum up to; the particles add it up block by block."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from distloc.snapshot import Float32Array
from distloc.types import FloatArray


@dataclass(frozen=True, slots=True)
class Cloud:
    """The weighted particles' moments: mean (3,) in ENU, covariance (3, 3), effective number, mean bias (3,)."""

    mean_enu_m: FloatArray
    covariance_enu_m2: FloatArray
    effective: float
    bias_rad: FloatArray


class Clouds:
    """The same of k targets, in arrays whose first axis is the target's."""

    def __init__(self, k: int) -> None:
        self.mean_enu_m = np.zeros((k, 3))
        self.covariance_enu_m2 = np.zeros((k, 3, 3))
        self.effective = np.zeros(k)
        self.bias_rad = np.zeros((k, 3))

    def one(self, target: int) -> Cloud:
        """A copy of one target's."""
        return Cloud(
            self.mean_enu_m[target].copy(),
            self.covariance_enu_m2[target].copy(),
            float(self.effective[target]),
            self.bias_rad[target].copy(),
        )


class Sums:
    """What the moments of k targets are made of."""

    def __init__(self, k: int) -> None:
        self.weight, self._squared = np.zeros(k), np.zeros(k)
        self._first, self._second = np.zeros((k, 6)), np.zeros((k, 3, 3))  # of position and bias; of position

    def add(self, at: slice, x: Float32Array, weights: Float32Array, scratch: Float32Array) -> None:
        """A block of these targets' particles (g, 8 or more, b) with weights (g, b); `scratch` is (g, 3, b)."""
        row, column = weights[:, None, :], weights[:, :, None]
        self.weight[at] += weights.sum(axis=1)
        self._squared[at] += np.matmul(row, column)[:, 0, 0]
        self._first[at] += np.matmul(x[:, :6], column)[:, :, 0]
        np.multiply(x[:, :3], row, out=scratch)
        self._second[at] += np.matmul(scratch, x[:, :3].transpose(0, 2, 1))

    def into(self, clouds: Clouds, places: NDArray[np.intp], origin_enu_m: FloatArray, scale: FloatArray) -> None:
        """Write them at these places: of positions about origins (k, 3), nuisances in units of `scale` (k, m)."""
        first = self._first / self.weight[:, None]
        clouds.mean_enu_m[places] = origin_enu_m + first[:, :3]
        clouds.covariance_enu_m2[places] = (
            self._second / self.weight[:, None, None] - first[:, :3, None] * first[:, None, :3]
        )
        clouds.effective[places] = self.weight**2 / np.maximum(self._squared, 1e-30)
        clouds.bias_rad[places] = first[:, 3:] * scale[:, :3]
