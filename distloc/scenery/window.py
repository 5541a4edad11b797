"""The last keyframes' attitude and position errors, from the scenery that they saw: a fixed-lag smoother.

Unknown are, for each keyframe, the errors x = (attitude, position) and their slow parts s, and the places that the
corners are. Slow parts are Gauss-Markov chains, x - s is white. Gauss-Newton with robust weights; the places are
eliminated (Schur complement), and so are the slow parts, which nothing sees. When the window is full its first
keyframe leaves, and with it all places that it saw; what they know of the others stays as a prior, linearised once
(Sibley et al. 2010; Leutenegger et al. 2015). Every sighting is used once.
"""

from dataclasses import dataclass

import numpy as np

from distloc.scenery.landmarks import IntArray, Landmarks, Normals, Seen, exponentials
from distloc.types import FloatArray

_MOST_ITERATIONS = 4
_SETTLED = 2e-5  # radians and metres, in a step
_LEAST_SIGMA = np.array([1e-5] * 3 + [1e-3] * 3)
_LEAST_SEEN = 2
_MISFIT = 3.0  # standard deviations, root mean square of a place's residuals: it moves, or was mistaken
_BEST_FIT = 0.04  # mean squared residual in units of what was told: the usual one is not taken to be better
_X = 6  # attitude error, position error


@dataclass(frozen=True, slots=True)
class Chain:
    """How the slow errors come from those of the keyframe before: kept shares, new variances, known moves; white ones.

    Each (6,): attitude about east, north and up in radians, position east, north and up in metres.
    """

    kept: FloatArray
    new: FloatArray
    white: FloatArray
    moved: FloatArray


class Window:
    """A fixed number of keyframes and a pool of places."""

    def __init__(self, keyframes: int, places: int) -> None:
        self.size = keyframes
        self.count = 0
        self.x = np.zeros((keyframes, _X))
        self.landmarks = Landmarks(places, keyframes)
        self.misfit, self.used, self.wrong = 1.0, 0, 0
        self._places_m = np.zeros((keyframes, 3))
        self._chains: list[Chain] = []
        # of x of all keyframes and of the slow part of the first: information matrix and vector
        self._prior_H = np.zeros((0, 0))
        self._prior_h = np.zeros(0)

    def reset(self) -> None:
        """Forget all."""
        self.count = 0
        self._chains.clear()
        self.landmarks.free(np.arange(self.landmarks.names.size))

    def add(self, place_m: FloatArray, chain: Chain, seen: Seen) -> int:
        """A keyframe at a reported place (3,); how many corners found no room. The first one's chain is its prior."""
        if self.count == self.size:
            self._drop_first()
        k = self.count
        if k == 0:
            variance = np.maximum(chain.new, _LEAST_SIGMA**2)
            self._prior_H = np.zeros((2 * _X, 2 * _X))
            self._prior_H[_X:, _X:] = np.diag(1.0 / variance)
            self._prior_h = np.zeros(2 * _X)
            self.x[0] = 0.0
        else:
            self.x[k] = chain.kept * self.x[k - 1] + chain.moved
            self._prior_H, self._prior_h = _with_room(self._prior_H, self._prior_h, k)
        self._chains.append(chain)
        self._places_m[k] = place_m
        self.count += 1
        turned = exponentials(self.x[k : k + 1, :3])[0][0]
        return self.landmarks.add(k, seen, turned, place_m)

    def replace_last_chain(self, chain: Chain) -> None:
        """Another way from the keyframe before to the last one."""
        self._chains[-1] = chain

    def solve(self) -> FloatArray:
        """Settle the errors `x`; the covariance (6k, 6) of all keyframes' with the last one's.

        Raises numpy.linalg.LinAlgError where they can't be.
        """
        H0, h0 = self._linear()
        which = self.landmarks.counts() >= _LEAST_SEEN
        x = self.x[: self.count].copy()
        for _ in range(_MOST_ITERATIONS):
            normals = self.landmarks.normals(which, x, self._places_m[: self.count])
            H = H0 + normals.H
            step = np.asarray(np.linalg.solve(H, h0 - H0 @ x.reshape(-1) + normals.g), dtype=np.float64)
            x += step.reshape(x.shape)
            self.landmarks.move(normals, step)
            if np.abs(step).max() < _SETTLED:
                break
        if not np.isfinite(x).all():
            raise np.linalg.LinAlgError("the scenery's errors are not finite")
        self.x[: self.count] = x
        self._judge(normals)
        ends = np.zeros((_X * self.count, _X))
        ends[-_X:] = np.eye(_X)
        return np.asarray(np.linalg.solve(H, ends))

    def _judge(self, normals: Normals) -> None:
        """Free places that don't stand still, and say how well the others fit."""
        n = normals.places.size
        if n == 0:
            self.misfit, self.used, self.wrong = 1.0, 0, 0
            return
        counts = np.bincount(normals.of, minlength=n)
        squares = np.bincount(normals.of, np.minimum(normals.norms, 10.0) ** 2, n)
        freedom = np.maximum(2 * counts - 3, 1)
        usual = float(np.clip(np.median(squares / freedom), _BEST_FIT, 1.0))
        is_wrong = squares > _MISFIT**2 * usual * freedom
        good = ~is_wrong
        self.used = int(good.sum())
        self.misfit = float(squares[good].sum() / max(freedom[good].sum(), 1)) if good.any() else 1.0
        self.wrong = int(is_wrong.sum())
        self.landmarks.free(normals.places[is_wrong])

    def _linear(self) -> tuple[FloatArray, FloatArray]:
        """What the prior and the chains know of x, the slow parts eliminated: H (6k, 6k) and h (6k,)."""
        n = self.count
        half = _X * n
        H, h = np.zeros((2 * half, 2 * half)), np.zeros(2 * half)
        held = half + _X  # the prior's: x of all, slow of the first
        H[:held, :held], h[:held] = self._prior_H, self._prior_h
        diagonal = np.arange(_X)
        for k, chain in enumerate(self._chains[:n]):
            x, s = _X * k + diagonal, half + _X * k + diagonal
            weight = 1.0 / np.maximum(chain.white, _LEAST_SIGMA**2)
            H[x, x] += weight
            H[s, s] += weight
            H[x, s] -= weight
            H[s, x] -= weight
            if k > 0:
                _link(H, h, s - _X, s, chain)
        solved = np.linalg.solve(H[half:, half:], np.column_stack([H[half:, :half], h[half:]]))
        return H[:half, :half] - H[:half, half:] @ solved[:, :-1], h[:half] - H[:half, half:] @ solved[:, -1]

    def _drop_first(self) -> None:
        """Keep what the first keyframe and the places that it saw know of the others."""
        n = self.count
        which = self.landmarks.is_seen[:, 0] & (self.landmarks.counts() >= _LEAST_SEEN)
        normals = self.landmarks.normals(which, self.x[:n], self._places_m[:n])
        half = _X * n
        size = half + 2 * _X  # x of all, slow of the first and the second
        H, h = np.zeros((size, size)), np.zeros(size)
        held = half + _X
        H[:held, :held], h[:held] = self._prior_H, self._prior_h
        H[:half, :half] += normals.H
        h[:half] += normals.g + normals.H @ self.x[:n].reshape(-1)
        diagonal = np.arange(_X)
        x, s = diagonal, half + diagonal
        weight = 1.0 / np.maximum(self._chains[0].white, _LEAST_SIGMA**2)
        H[x, x] += weight
        H[s, s] += weight
        H[x, s] -= weight
        H[s, x] -= weight
        if n > 1:
            _link(H, h, s, s + _X, self._chains[1])
        gone = np.concatenate([x, s])
        left = np.setdiff1d(np.arange(size), gone)
        solved = np.linalg.solve(H[np.ix_(gone, gone)], np.column_stack([H[np.ix_(gone, left)], h[gone]]))
        self._prior_H = H[np.ix_(left, left)] - H[np.ix_(left, gone)] @ solved[:, :-1]
        self._prior_H = (self._prior_H + self._prior_H.T) / 2.0
        self._prior_h = h[left] - H[np.ix_(left, gone)] @ solved[:, -1]
        self.landmarks.free(np.flatnonzero(self.landmarks.is_seen[:, 0]))
        self.landmarks.shift()
        self.x[:-1], self._places_m[:-1] = self.x[1:].copy(), self._places_m[1:].copy()
        self._chains.pop(0)
        self.count -= 1


def _link(H: FloatArray, h: FloatArray, before: IntArray, now: IntArray, chain: Chain) -> None:
    """now = kept * before + moved, in place."""
    weight = 1.0 / np.maximum(chain.new, _LEAST_SIGMA**2)
    H[now, now] += weight
    H[before, before] += chain.kept**2 * weight
    H[now, before] -= chain.kept * weight
    H[before, now] -= chain.kept * weight
    h[now] += weight * chain.moved
    h[before] -= chain.kept * weight * chain.moved


def _with_room(H: FloatArray, h: FloatArray, k: int) -> tuple[FloatArray, FloatArray]:
    """The prior of k keyframes with nothing known of one more."""
    kept = np.r_[0 : _X * k, _X * (k + 1) : _X * (k + 2)]
    larger, longer = np.zeros((_X * (k + 2), _X * (k + 2))), np.zeros(_X * (k + 2))
    larger[np.ix_(kept, kept)], longer[kept] = H, h
    return larger, longer
