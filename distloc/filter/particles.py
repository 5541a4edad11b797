"""Weighted particles in arrays made once: what they sum up to, and how they are drawn anew. The filter owns them.

A particle is a column: its position about an origin that all share, and its means of five nuisances in units of
`scale`. A step goes over them in blocks that stay in the cache, and allocates nothing that grows with N.
"""

from dataclasses import dataclass

import numpy as np

from distloc.filter.regularise import Kernel
from distloc.filter.resample import systematic_indices
from distloc.sights.sight import NUISANCES
from distloc.snapshot import Float32Array
from distloc.types import FloatArray

STATE = 3 + NUISANCES
_BLOCK = 10_000  # particles at a time
_SAMPLE = 2048  # particles that stand for the cloud where their order matters: gates, quantiles, snapshots
_SPREAD = 256  # that stand for how far it reaches, and for whether a sight is likely at all
_FEW, _VERY_FEW = 1 / 2, 1 / 8  # of N, the effective number: draw anew; where another was drawn in this step, wait


@dataclass(frozen=True, slots=True)
class Cloud:
    """The weighted particles' moments: mean (3,) in ENU, covariance (3, 3), effective number, mean bias (3,)."""

    mean_enu_m: FloatArray
    covariance_enu_m2: FloatArray
    effective: float
    bias_rad: FloatArray


class Sums:
    """What the cloud's moments are made of, added up block by block."""

    def __init__(self) -> None:
        self.weight, self._squared = 0.0, 0.0
        self._first, self._second = np.zeros(6), np.zeros((3, 3))  # of position and bias; of position

    def add(self, x: Float32Array, weights: Float32Array, scratch: Float32Array) -> None:
        """Particles (8, B) with weights (B,); `scratch` is (3, B)."""
        self.weight += float(weights.sum())
        self._squared += float(weights @ weights)
        self._first += x[:6] @ weights
        np.multiply(x[:3], weights, out=scratch)
        self._second += scratch @ x[:3].T

    def cloud(self, origin_enu_m: FloatArray, scale: FloatArray) -> Cloud:
        """Of positions about an origin (3,) and nuisances in units of `scale` (5,)."""
        first = self._first / self.weight
        covariance = self._second / self.weight - np.outer(first[:3], first[:3])
        effective = self.weight**2 / max(self._squared, 1e-30)
        return Cloud(origin_enu_m + first[:3], covariance, effective, first[3:] * scale[:3])


class Workspace:
    """What N particles are drawn into; those of several targets share it, one after the other in one thread.

    To draw anew takes several times as long as the rest of a step. Who calls `begin_step` has one target drawn in each
    step, and the others wait for the next ones while they can; only where many are new do many come at once.
    """

    def __init__(self, n: int) -> None:
        self.n = n
        self._draws_left = np.inf
        self.row = np.zeros(n, np.float32)
        self.chosen = np.zeros(n, np.intp)
        self._buffers = [np.empty(NUISANCES * min(_BLOCK, n), np.float32) for _ in range(3)]

    def begin_step(self) -> None:
        """From now on one may be drawn whose effective number is low but not very low."""
        self._draws_left = 1

    def may_draw(self, effective_share: float) -> bool:
        """Whether to draw anew now at this effective number, as a share of N; it counts if so."""
        may = effective_share < (_FEW if self._draws_left > 0 else _VERY_FEW)
        self._draws_left -= may
        return may

    def scratch(self, number: int, rows: int, n: int) -> Float32Array:
        """One of three contiguous arrays (rows, n), rows <= 5 and n at most a block, for a block's own results."""
        return self._buffers[number][: rows * n].reshape(rows, n)


class Particles:
    """N of them: `x` (8, N) and `weights` (N,)."""

    def __init__(self, n: int, rng: np.random.Generator, workspace: Workspace | None = None) -> None:
        self.n = n
        self.cloud = Cloud(np.zeros(3), np.zeros((3, 3)), 0.0, np.zeros(3))
        self.origin_enu_m = np.zeros(3)
        self.x = np.zeros((STATE, n), np.float32)
        self.scale = np.ones(NUISANCES)
        self.weights = np.zeros(n, np.float32)
        self.blocks = [slice(i, min(i + _BLOCK, n)) for i in range(0, n, _BLOCK)]
        self.sample = slice(0, n, max(1, n // _SAMPLE))
        self._rng = rng
        self.workspace = workspace or Workspace(n)

    def write(self) -> None:
        """Write the arrays: the system gives memory when it is first written, so that a flight would seem to grow."""
        for array in (self.x, self.weights, self.workspace.row, self.workspace.chosen):
            array.fill(0)

    @property
    def state_bytes(self) -> int:
        """What a step must read and write at the least."""
        return self.x.nbytes + self.weights.nbytes

    def rescale(self) -> None:
        """Have the nuisances in their own units again."""
        self.x[3:] *= self.scale.astype(np.float32)[:, None]
        self.scale.fill(1.0)

    def mix_bias(self, kept: FloatArray) -> None:
        """Multiply each mean of the bias by a matrix (3, 3)."""
        scale = self.scale[:3]
        kept32 = (kept * scale / scale[:, None]).astype(np.float32)
        for block in self.blocks:
            bias = self.x[3:6, block]
            bias[:] = np.matmul(kept32, bias, out=self.workspace.scratch(0, 3, bias.shape[1]))

    def off_bias(self, found_rad: FloatArray) -> tuple[FloatArray, FloatArray]:
        """How far a bias (3,) is from the particles' means of it: mean (3,) and covariance (3, 3)."""
        x, weights = self.sampled()
        off = found_rad[:, None] - x[3:6] * self.scale[:3, None]
        mean = off @ weights
        centred = off - mean[:, None]
        return mean, (centred * weights) @ centred.T

    def find_bias(self, found_rad: FloatArray, whiten: FloatArray, gain: FloatArray) -> None:
        """Weigh by a bias (3,), through `whiten` (3, 3), move the nuisances by `gain` (5, 3), and take it off them."""
        least = np.inf
        for is_weighing in (False, True):  # by the nearest first: else all weights might vanish
            for block in self.blocks:
                off = found_rad[:, None] - self.x[3:6, block] * self.scale[:3, None]
                squared = np.square(whiten @ off).sum(axis=0)
                if not is_weighing:
                    least = min(least, float(squared.min()))
                    continue
                self.weights[block] *= np.exp((least - squared) / 2.0).astype(np.float32)
                self.x[3:, block] += ((gain @ off) / self.scale[:, None]).astype(np.float32)
                self.x[3:6, block] -= (found_rad / self.scale[:3]).astype(np.float32)[:, None]
        self.weights *= np.float32(1.0 / float(self.weights.sum(dtype=np.float64)))
        self.measure()

    def measure(self) -> None:
        """Sum the cloud up."""
        sums = Sums()
        for block in self.blocks:
            weights = self.weights[block]
            sums.add(self.x[:, block], weights, self.workspace.scratch(0, 3, weights.size))
        self.cloud = sums.cloud(self.origin_enu_m, self.scale)

    def resample_if_few(self, axes: FloatArray, camera_enu_m: FloatArray) -> None:
        """Where the effective number is low and it is their turn, draw them anew, spread about a camera at (3,).

        The rows of `axes` (3, 3) are right, up and along its line of sight.
        """
        if self.workspace.may_draw(self.cloud.effective / self.n):
            systematic_indices(self.weights, self._rng.random(), self.workspace.chosen)
            self._take(self.x, axes, camera_enu_m)

    def sampled(self, is_rough: bool = False) -> tuple[Float32Array, FloatArray]:
        """Every so many-th particle (8, n) and its weight (n,), a few hundred or 2048; the weights sum to 1."""
        sample = slice(0, self.n, max(1, self.n // _SPREAD)) if is_rough else self.sample
        weights = self.weights[sample].astype(np.float64)
        return self.x[:, sample], weights / max(float(weights.sum()), 1e-30)

    def weighted_positions(self) -> tuple[FloatArray, FloatArray]:
        """Every so many-th particle's position (3, n) in ENU and its weight (n,); the weights sum to 1."""
        x, weights = self.sampled()
        return x[:3] + self.origin_enu_m[:, None], weights

    def drawn(self) -> Float32Array:
        """Equally likely particles (8, n), the nuisances in their own units; the same at each call."""
        chosen = systematic_indices(self.weights, 0.5, np.empty(min(_SAMPLE, self.n), np.intp))
        drawn = self.x[:, chosen]
        drawn[3:] *= self.scale.astype(np.float32)[:, None]
        return drawn

    def restore(self, drawn: Float32Array, axes: FloatArray, camera_enu_m: FloatArray) -> None:
        """Go on with equally likely particles (8, n) about the origin, copied, and spread about a camera."""
        np.floor_divide(np.arange(self.n) * drawn.shape[1], self.n, out=self.workspace.chosen)
        self.scale.fill(1.0)
        self._take(drawn, axes, camera_enu_m)

    def positions_enu_m(self) -> FloatArray:
        """Those of the particles drawn (3, n)."""
        return self.drawn()[:3] + self.origin_enu_m[:, None]

    def reach_enu_m(self) -> FloatArray:
        """A few hundred of the positions (3, n), whatever their weights."""
        x, _ = self.sampled(is_rough=True)
        return x[:3] + self.origin_enu_m[:, None]

    def _take(self, source: Float32Array, axes: FloatArray, camera_enu_m: FloatArray) -> None:
        """Go on with the chosen of `source` (8, n), spread about a camera, with equal weights.

        The origin moves into their middle: there float32 is fine enough for any moment.
        """
        shift = axes @ (self.origin_enu_m - camera_enu_m)
        sample = source[:, self.workspace.chosen[self.sample]]
        kernel = Kernel.of(sample, axes, shift)
        self.origin_enu_m = self.origin_enu_m + sample[:3].mean(axis=1, dtype=np.float64)
        shift = axes @ (self.origin_enu_m - camera_enu_m)
        self.weights.fill(1.0 / self.n)
        for row, values in zip(self.x, source, strict=True):
            np.take(values, self.workspace.chosen, out=self.workspace.row, mode="clip")  # which writes without a buffer
            row[:] = self.workspace.row
        sums = Sums()
        for block in self.blocks:
            copies, weights = self.x[:, block], self.weights[block]
            n = weights.size
            q, move, moves = (self.workspace.scratch(number, rows, n) for number, rows in enumerate((3, 3, NUISANCES)))
            kernel.spread(copies, shift, self._rng, (q, move, moves))
            sums.add(copies, weights, q)
        self.cloud = sums.cloud(self.origin_enu_m, self.scale)
