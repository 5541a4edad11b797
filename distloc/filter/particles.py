"""Weighted particles of many targets in arrays made once: what they sum up to, and how they are drawn anew.

A target has a place. A particle is a column there: its position about an origin that the place's particles share, and
its means of five nuisances, and of three for each platform more than one, in units of `scale`. What a step does to all
targets it does in blocks that stay in the cache, several targets to a block where they have few particles; nothing is
allocated that grows with them. Places are handed in rising order. The bank owns them.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from distloc.filter.moments import Clouds, Sums
from distloc.filter.platforms import Slots
from distloc.filter.regularise import Kernel, bandwidth_of
from distloc.filter.resample import systematic_indices
from distloc.sights.sight import NUISANCES, STATE
from distloc.snapshot import Float32Array
from distloc.types import FloatArray

Places = NDArray[np.intp]  # (k,), rising

_BLOCK = 20_000  # particles at a time: what is made of them stays in the cache
SAMPLE = 2048  # particles that stand for a cloud where their order matters: quantiles, snapshots
SPREAD = 256  # that stand for how far it reaches, and for whether a sight is likely at all
_FEW, _VERY_FEW = 1 / 2, 1 / 8  # of n, the effective number: draw anew; where enough were drawn in this step, wait
_APART = 0.1  # the bandwidth that tells copies apart, and leaves a cloud as it is
_DRAWN_IN_A_STEP = 32_768  # particles; one target at the least


@dataclass(frozen=True, slots=True)
class Block:
    """Targets `at` of those that are gone over lie at `places`; and which of their particles."""

    at: slice
    places: slice
    particles: slice


class Particles:
    """`n` of them for each place: `x` (places, 3 + nuisances, n), `weights` (places, n), `origin_enu_m` (places, 3).

    To draw anew takes several times as long as the rest of a step. Who calls `begin_step` has few targets drawn in each
    step, and the others wait for the next ones while they can; only where many are new do many come at once.
    """

    def __init__(self, places: int, n: int, rngs: list[np.random.Generator], slots: Slots | None = None) -> None:
        self.n, self._slots = n, slots or Slots(places, 1)
        nuisances = self._slots.nuisances
        self.clouds = Clouds(places)
        self.origin_enu_m = np.zeros((places, 3))
        self.x = np.zeros((places, 3 + nuisances, n), np.float32)
        self.scale = np.ones((places, nuisances))
        self.weights = np.zeros((places, n), np.float32)
        self._rngs = rngs
        self._draws_left = np.inf
        self._row, self._chosen = np.zeros(n, np.float32), np.zeros(n, np.intp)
        self._together = max(1, _BLOCK // n)
        most = min(max(_BLOCK, self._together * n), places * n)
        self._buffers = [np.empty(nuisances * most, np.float32) for _ in range(3)]

    def write(self, places: int) -> None:
        """Write the first places' arrays: the system gives memory when it is first written, so a flight would seem to
        grow. The others, taken last, cost none until then.
        """
        for array in (self.x[:places], self.weights[:places], self._row, *self._buffers):
            array.fill(0.0)
        self._chosen.fill(0)

    @property
    def state_bytes(self) -> int:
        """What a step must read and write at the least."""
        return self.x.nbytes + self.weights.nbytes

    def blocks(self, places: Places) -> Iterator[Block]:
        """All particles of these places, neighbours together."""
        numbers: list[int] = places.tolist()
        first = 0
        for last, place in enumerate(numbers):
            is_end = last + 1 == len(numbers) or numbers[last + 1] != place + 1 or last + 1 - first == self._together
            if not is_end:
                continue
            for start in range(0, self.n, _BLOCK):
                part = slice(start, min(start + _BLOCK, self.n))
                yield Block(slice(first, last + 1), slice(numbers[first], place + 1), part)
            first = last + 1

    def of(self, block: Block) -> tuple[Float32Array, Float32Array]:
        """A block's particles (g, 3 + nuisances, b) and weights (g, b), to be written into."""
        return self.x[block.places, :, block.particles], self.weights[block.places, block.particles]

    def scratch(self, number: int, rows: int, weights: Float32Array) -> Float32Array:
        """One of three contiguous arrays (g, rows, b) for the results of a block with weights (g, b).

        It has at most as many rows as there are nuisances.
        """
        g, b = weights.shape
        return self._buffers[number][: g * rows * b].reshape(g, rows, b)

    def begin_step(self) -> None:
        """From now on so many may be drawn whose effective number is low but not very low."""
        self._draws_left = max(1, _DRAWN_IN_A_STEP // self.n)

    def rescale(self, place: int) -> None:
        """Have a place's nuisances in their own units again."""
        self.x[place, 3:] *= self.scale[place].astype(np.float32)[:, None]
        self.scale[place] = 1.0

    def swap(self, places: Places, order: NDArray[np.intp]) -> None:
        """The bias with another platform's, by the nuisances' order (m,) from then on."""
        self.scale[places] = self.scale[places][:, order]
        parked = slice(3 + int(order[0]), 6 + int(order[0]))
        for block in self.blocks(places):
            x, weights = self.of(block)
            held = self.scratch(0, 3, weights)
            held[:] = x[:, 3:6]
            x[:, 3:6] = x[:, parked]
            x[:, parked] = held
        self.measure(places)

    def mix_bias(self, places: Places, kept: FloatArray) -> None:
        """Multiply each mean of the bias by a matrix (3, 3)."""
        scale = self.scale[places, :3]
        kept32 = (kept * scale[:, None, :] / scale[:, :, None]).astype(np.float32)
        for block in self.blocks(places):
            x, weights = self.of(block)
            x[:, 3:6] = np.matmul(kept32[block.at], x[:, 3:6], out=self.scratch(0, 3, weights))

    def off_bias(self, places: Places, found_rad: FloatArray) -> tuple[FloatArray, FloatArray]:
        """How far a bias (3,) is from the particles' means of it: means (k, 3) and covariances (k, 3, 3)."""
        x, weights = self.sampled(places)
        off = found_rad[:, None] - x[:, 3:6] * self.scale[places, :3, None]
        mean = (off @ weights[:, :, None])[:, :, 0]
        centred = off - mean[:, :, None]
        return mean, (centred * weights[:, None, :]) @ centred.transpose(0, 2, 1)

    def find_bias(self, place: int, found_rad: FloatArray, whiten: FloatArray, gain: FloatArray) -> None:
        """Weigh by a bias (3,), through `whiten` (3, 3), move the nuisances by `gain` (m, 3), and take it off them."""
        x, weights, scale = self.x[place], self.weights[place], self.scale[place]
        blocks = [slice(start, start + _BLOCK) for start in range(0, self.n, _BLOCK)]
        least = np.inf
        for is_weighing in (False, True):  # by the nearest first: else all weights might vanish
            for block in blocks:
                off = found_rad[:, None] - x[3:6, block] * scale[:3, None]
                squared = np.square(whiten @ off).sum(axis=0)
                if not is_weighing:
                    least = min(least, float(squared.min()))
                    continue
                weights[block] *= np.exp((least - squared) / 2.0).astype(np.float32)
                x[3:, block] += ((gain @ off) / scale[:, None]).astype(np.float32)
                x[3:6, block] -= (found_rad / scale[:3]).astype(np.float32)[:, None]
        weights *= np.float32(1.0 / float(weights.sum(dtype=np.float64)))
        self.measure(np.array([place]))

    def measure(self, places: Places) -> None:
        """Sum the clouds up."""
        sums = Sums(places.size)
        for block in self.blocks(places):
            x, weights = self.of(block)
            sums.add(block.at, x, weights, self.scratch(0, 3, weights))
        self.take_in(places, sums)

    def take_in(self, places: Places, sums: Sums) -> None:
        """These are the sums of all particles there."""
        sums.into(self.clouds, places, self.origin_enu_m[places], self.scale[places])

    def resample_where_few(self, places: Places, axes: FloatArray, camera_enu_m: FloatArray) -> None:
        """Where the effective number is low and it is their turn, draw them anew, spread about a camera at (3,).

        The rows of each of `axes` (k, 3, 3) are right, up and along the line of sight.
        """
        shares = self.clouds.effective[places] / self.n
        for at in np.flatnonzero(shares < _FEW):
            if shares[at] < (_FEW if self._draws_left > 0 else _VERY_FEW):
                self._draws_left -= 1
                place = int(places[at])
                systematic_indices(self.weights[place], self._rngs[place].random(), self._chosen)
                self._take(place, self.x[place], axes[at], camera_enu_m, bandwidth_of(self.n))

    def sampled(
        self, places: NDArray[np.intp], most: int = SAMPLE, rows: int = STATE
    ) -> tuple[Float32Array, Float32Array]:
        """A copy of the first rows of every so many-th particle (k, rows, m); weights (k, m) whose sum is 1."""
        stride = max(1, self.n // most)
        weights = self.weights[places, ::stride]
        totals = np.maximum(weights.sum(axis=1, dtype=np.float64), 1e-30)
        return self.x[places, :rows, ::stride], weights * (1.0 / totals).astype(np.float32)[:, None]

    def drawn(self, place: int) -> Float32Array:
        """Equally likely particles (8, m), the nuisances in their own units; the same at each call."""
        chosen = systematic_indices(self.weights[place], 0.5, np.empty(min(SAMPLE, self.n), np.intp))
        drawn: Float32Array = self.x[place, :STATE][:, chosen]
        drawn[3:] *= self.scale[place, :NUISANCES].astype(np.float32)[:, None]
        return drawn

    def restore(self, place: int, drawn: Float32Array, axes: FloatArray, camera_enu_m: FloatArray) -> None:
        """Go on with equally likely particles (8, m) about the origin, copied, and spread about a camera."""
        np.floor_divide(np.arange(self.n) * drawn.shape[1], self.n, out=self._chosen)
        self.scale[place] = 1.0
        others = np.zeros((self._slots.nuisances - NUISANCES, drawn.shape[1]), np.float32)
        self._take(place, np.concatenate([drawn, others]), axes, camera_enu_m, _APART)

    def _take(
        self, place: int, source: Float32Array, axes: FloatArray, camera_enu_m: FloatArray, bandwidth: float
    ) -> None:
        """Go on with the chosen of `source` (3 + nuisances, m), spread about a camera, with equal weights.

        The origin moves into their middle: there float32 is fine enough for any moment.
        """
        origin_enu_m, x = self.origin_enu_m[place].copy(), self.x[place]
        sample = source[:, self._chosen[:: max(1, self.n // SAMPLE)]]
        kernel = Kernel.of(sample[:STATE], axes, axes @ (origin_enu_m - camera_enu_m), bandwidth)
        self.origin_enu_m[place] = origin_enu_m + sample[:3].mean(axis=1, dtype=np.float64)
        shift = axes @ (self.origin_enu_m[place] - camera_enu_m)
        sides = self._slots.sides(place, sample, origin_enu_m)
        moved_m = self.origin_enu_m[place] - origin_enu_m
        self.weights[place] = 1.0 / self.n
        for row, values in zip(x, source, strict=True):
            np.take(values, self._chosen, out=self._row, mode="clip")  # which writes without a buffer
            row[:] = self._row
        places = np.array([place])
        sums = Sums(1)
        for block in self.blocks(places):
            copies, weights = self.of(block)
            scratch = tuple(self.scratch(number, rows, weights) for number, rows in enumerate((3, 3, NUISANCES)))
            for side in sides:
                side.follow(copies[0], np.zeros(3), -1.0, scratch[0][0], scratch[1][0])
            one = copies[0, :STATE]
            kernel.spread(one, shift, self._rngs[place], (scratch[0][0], scratch[1][0], scratch[2][0]))
            for side in sides:
                side.follow(copies[0], moved_m, 1.0, scratch[0][0], scratch[1][0])
            sums.add(block.at, copies, weights, scratch[0])
        self.take_in(places, sums)
