"""The last keyframes' attitude and position errors, from the scenery that they saw: a fixed-lag smoother.

Unknown are, for each keyframe, the errors x = (attitude, position) and their slow parts s, the lens' errors, and the
places that the corners are. Slow parts are Gauss-Markov chains, x - s is white. Gauss-Newton with robust weights; the
places are eliminated (Schur complement), and so are the slow parts, which nothing sees. When the window is full its
first keyframe leaves, and with it all places that it saw; what they know of the others stays as a prior, linearised
once (Sibley et al. 2010; Leutenegger et al. 2015). Every sighting is used once. Where landmarks of known place are
sighted too, what their places are wrong by are unknowns that stay.
"""

import copy
from collections.abc import Sequence

import numpy as np

from distloc.scenery.information import LEAST_SIGMA, Chain, chained, link, tie, wandering, with_room, without
from distloc.scenery.known_places import KnownPlaces
from distloc.scenery.landmarks import LENS, Landmarks, Normals, Seen, Sightings, exponentials
from distloc.types import FloatArray

_MOST_ITERATIONS = 4
_ROUNDS = 3  # each without the places that the one before found to move
_SETTLED, _SETTLED_LENS = np.array([2e-5] * 3 + [2e-3] * 3), 1e-4  # radians and metres, in a step; the lens
_LEAST_SEEN = 2
_MANY = 25  # places: with fewer one that is mistaken weighs more than it is told to
_WORST_LENS = 0.3
_LENS_WANDERS = 0.012  # of what is told, a keyframe: 0.3 of it in ten minutes; so it is never surer than that allows
_MISFIT = 3.0  # standard deviations, root mean square of a place's residuals: it moves, or was mistaken
_BEST_FIT = 0.04  # mean squared residual in units of what was told: the usual one is not taken to be better
_X = 6  # attitude error, position error


class Window:
    """A fixed number of keyframes and a pool of places.

    `lens` (2,) is what the lens is wrong by: the share by which its focal length is longer, and by what its first
    radial coefficient is more; `lens_sigma` (2,) is told before and found.
    """

    def __init__(self, keyframes: int, places: int, lens_sigma: Sequence[float] = (0.02, 0.03)) -> None:
        self.size = keyframes
        self._told_lens_sigma = np.maximum(lens_sigma, 1e-6)
        self.lens, self.lens_sigma = np.zeros(LENS), self._told_lens_sigma.copy()
        self.count = 0
        self.x = np.zeros((keyframes, _X))
        self.landmarks = Landmarks(places, keyframes)
        self.usual = 1.0  # what the mean squared residual commonly is, as the corners tell
        self.misfit, self.used, self.wrong, self.likeness = 1.0, 0, 0, 0.0
        self._places_m = np.zeros((keyframes, 3))
        self._forward = np.zeros((keyframes, 3))
        self.known = KnownPlaces(np.zeros((0, 3)), keyframes)
        self.off_m = np.zeros((0, 3))  # what the known places are wrong by
        self._chains: list[Chain] = []
        # of x of all keyframes, the lens, the known places' errors and the slow part of the first: information
        # matrix and vector
        self._prior_H = np.zeros((0, 0))
        self._prior_h = np.zeros(0)

    def reset(self) -> None:
        """Forget all."""
        self.count = 0
        self.lens, self.lens_sigma = np.zeros(LENS), self._told_lens_sigma.copy()
        self.off_m[:] = 0.0
        self.known.free()
        self._chains.clear()
        self.landmarks.free(np.arange(self.landmarks.names.size))

    @property
    def roughness(self) -> float:
        """How large the residuals are beside the usual ones, squared; 1 where there are none."""
        return self.misfit / max(self.usual, 1e-3) if self.used else 1.0

    @property
    def doubt(self) -> float:
        """What the covariance is larger by than the least squares have it: for rough residuals, and for few places."""
        return max(1.0, self.roughness) * max(1.0, _MANY / max(self.used, 1))

    @property
    def last_chain(self) -> Chain:
        """From the keyframe before the last one to that."""
        return self._chains[-1]

    def with_known(self, sigma_m: FloatArray) -> "Window":
        """A copy that takes sightings of known places too: `sigma_m` (m, 3) is one standard deviation of each."""
        made = copy.deepcopy(self)
        made.known, made.off_m = KnownPlaces(sigma_m, self.size), np.zeros(sigma_m.shape)
        at = _X * self.count + LENS
        made._prior_H, made._prior_h = with_room(self._prior_H, self._prior_h, at, made.known.size)
        places = slice(at, at + made.known.size)
        made._prior_H[places, places] = np.linalg.inv(made.known.covariance)
        return made

    def add(self, place_m: FloatArray, forward: FloatArray, chain: Chain, seen: Seen) -> int:
        """A keyframe at a reported place (3,), whose camera is reported to look along `forward` (3,).

        Returns how many corners found no room. The first one's chain is its prior.
        """
        if self.count == self.size:
            self._drop_first()
        k = self.count
        if k == 0:
            variance = np.maximum(chain.new, LEAST_SIGMA**2)
            self._prior_H = np.diag(
                [*np.zeros(_X), *self._told_lens_sigma**-2.0, *np.zeros(self.known.size), *(1.0 / variance)]
            )
            at = slice(_X + LENS, _X + LENS + self.known.size)
            self._prior_H[at, at] = np.linalg.inv(self.known.covariance)
            self._prior_h = np.zeros(len(self._prior_H))
            self.x[0] = 0.0
        else:
            self.x[k] = chain.kept * self.x[k - 1] + chain.moved
            self._prior_H, self._prior_h = with_room(self._prior_H, self._prior_h, _X * k, _X)
        self._chains.append(chain)
        self._places_m[k], self._forward[k] = place_m, forward
        self.count += 1
        turned = exponentials(self.x[k : k + 1, :3])[0][0]
        return self.landmarks.add(k, seen, turned, place_m)

    def add_known(self, seen: Seen, places_m: FloatArray) -> None:
        """Sightings at the last keyframe of the known places with the indices `seen.names`, which are at (n, 3)."""
        self.known.add(self.count - 1, seen, places_m)

    def replace_last_chain(self, chain: Chain) -> None:
        """Another way from the keyframe before to the last one."""
        self._chains[-1] = chain

    def last_step(self, chain: Chain) -> FloatArray:
        """The last keyframe's errors (6,) less what a chain has of those before."""
        return np.asarray(self.x[self.count - 1] - chain.kept * self.x[self.count - 2] - chain.moved)

    def take_off_last(self, by_m: FloatArray) -> None:
        """The last keyframe's reported place was off by (3,), and is mended."""
        k = self.count - 1
        self._places_m[k] -= by_m
        self.x[k, 3:] -= by_m
        self.landmarks.take_off_first(k, by_m)

    def solve(self) -> FloatArray:
        """Settle the errors `x` and `lens`; the covariance (6k, 6) of all keyframes' with the last one's.

        Raises numpy.linalg.LinAlgError where they can't be.
        """
        H0, h0 = self._linear()
        state, of_corners = self._state(), _X * self.count + LENS
        off_m = np.full(self.known.size, _SETTLED[-1])
        settled = np.concatenate([np.tile(_SETTLED, self.count), np.full(LENS, _SETTLED_LENS), off_m])
        wrong = 0
        for _ in range(_ROUNDS):
            seen = self.landmarks.sightings(self.landmarks.counts() >= _LEAST_SEEN, self.count)
            for _ in range(_MOST_ITERATIONS):
                normals = self._normals(seen, state)
                H, g = normals.H, normals.g
                if self.known.size:
                    H, g = self._known_normals(self.count, state)
                    H[:of_corners, :of_corners] += normals.H
                    g[:of_corners] += normals.g
                H += H0
                step = np.asarray(np.linalg.solve(H, h0 - H0 @ state + g), dtype=np.float64)
                state += step
                self.landmarks.move(normals, step[:of_corners])
                if (np.abs(step) < settled).all():
                    break
            found = self._judge(normals)
            wrong += found
            if not found:
                break
        self.wrong = wrong
        at = of_corners - LENS
        if not np.isfinite(state).all() or np.abs(state[at:of_corners]).max() > _WORST_LENS:
            raise np.linalg.LinAlgError("the scenery's errors are beyond reason")
        self.x[: self.count], self.lens = state[:at].reshape(-1, _X), state[at:of_corners].copy()
        self.off_m = state[of_corners:].reshape(-1, 3)
        ends = np.zeros((state.size, _X + LENS))
        ends[at - _X : of_corners] = np.eye(_X + LENS)
        covariance = np.asarray(np.linalg.solve(H, ends))
        if not (np.isfinite(covariance).all() and np.diag(covariance[at - _X : at]).min() > 0.0):
            raise np.linalg.LinAlgError("the scenery's covariance is none")
        self.lens_sigma = np.sqrt(np.maximum(np.diag(covariance[at:of_corners, _X:]), 0.0))
        return covariance[:at, :_X]

    def _state(self) -> FloatArray:
        return np.concatenate([self.x[: self.count].reshape(-1), self.lens, self.off_m.reshape(-1)])

    def _normals(self, seen: Sightings, state: FloatArray) -> Normals:
        n = self.count
        x, lens = state[: _X * n].reshape(-1, _X), state[_X * n : _X * n + LENS]
        return self.landmarks.normals(seen, x, lens, self._places_m[:n], self._forward[:n])

    def _known_normals(self, keyframes: int, state: FloatArray) -> tuple[FloatArray, FloatArray]:
        n = self.count
        return self.known.normals(keyframes, state, n, self._places_m[:n], self._forward[:n])

    def _judge(self, normals: Normals) -> int:
        """Free places that don't stand still, and say how well the others fit; how many there were."""
        n = normals.places.size
        self.misfit, self.used, self.likeness = 1.0, 0, 0.0
        if n == 0:
            return 0
        counts = np.bincount(normals.of, minlength=n)
        squared = np.minimum(np.square(normals.residuals).sum(axis=1), 100.0)
        squares = np.bincount(normals.of, squared, n)
        freedom = np.maximum(2 * counts - 3, 1)
        usual = float(np.clip(np.median(squares / freedom), _BEST_FIT, 1.0))
        is_wrong = squares > _MISFIT**2 * usual * freedom
        good = ~is_wrong
        self.used = int(good.sum())
        self.misfit = float(squares[good].sum() / max(freedom[good].sum(), 1)) if good.any() else 1.0
        follows = (np.diff(normals.of) == 0) & (np.diff(normals.at) == 1) & good[normals.of[1:]]
        product = np.einsum("ni,ni->n", normals.residuals[1:], normals.residuals[:-1])[follows]
        self.likeness = float(product.sum() / max(squared[1:][follows].sum(), 1e-9))
        self.landmarks.free(normals.places[is_wrong])
        return int(is_wrong.sum())

    def _linear(self) -> tuple[FloatArray, FloatArray]:
        """What the prior and the chains know of the state, the slow parts eliminated: H and h."""
        n = self.count
        half = _X * n + LENS + self.known.size
        H, h = self._prior_H.copy(), self._prior_h.copy()  # of the state, slow of the first
        axes = np.arange(_X)[:, None]
        of = np.concatenate([axes + _X * np.arange(n), half + axes], axis=1)
        chained_H, chained_h = chained(self._chains[:n])
        H[of[:, :, None], of[:, None]] += chained_H
        h[of] += chained_h
        return without(H, h, half + axes[:, 0])

    def _drop_first(self) -> None:
        """Keep what the first keyframe and the places that it saw know of the others."""
        n = self.count
        which = self.landmarks.is_seen[:, 0] & (self.landmarks.counts() >= _LEAST_SEEN)
        state, of_corners = self._state(), _X * n + LENS
        normals = self._normals(self.landmarks.sightings(which, n), state)
        known_H, known_g = self._known_normals(1, state)
        known_H[:of_corners, :of_corners] += normals.H
        known_g[:of_corners] += normals.g
        half = state.size
        size = half + 2 * _X  # the state, slow of the first and the second
        H, h = np.zeros((size, size)), np.zeros(size)
        held = half + _X
        H[:held, :held], h[:held] = self._prior_H, self._prior_h
        H[:half, :half] += known_H
        h[:half] += known_g + known_H @ state
        diagonal = np.arange(_X)
        x, s = diagonal, half + diagonal
        tie(H, x, s, self._chains[0])
        if n > 1:
            link(H, h, s, s + _X, self._chains[1])
        H, h = without(H, h, np.concatenate([x, s]))
        lens = np.arange(half - self.known.size - LENS, half - self.known.size) - _X
        self._prior_H, self._prior_h = wandering(H, h, lens, (_LENS_WANDERS * self._told_lens_sigma) ** 2)
        self.landmarks.free(np.flatnonzero(self.landmarks.is_seen[:, 0]))
        self.landmarks.shift()
        self.known.shift()
        for array in (self.x, self._places_m, self._forward):
            array[:-1] = array[1:].copy()
        self._chains.pop(0)
        self.count -= 1
