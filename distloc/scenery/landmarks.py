"""Places in the scenery that are followed through the window's keyframes, in a fixed pool, and how they are seen.

A place is d + rho * (q - p): a direction d (on a plane across the first ray), an inverse depth rho about the reported
place q of the camera that saw it first, seen from p. Seen like that it is nearly linear in what is unknown, at any
depth, infinity and a little beyond included (Civera et al. 2008).
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from distloc.geometry.rotations import crossed
from distloc.types import BoolArray, FloatArray

IntArray = NDArray[np.intp]

_INVERSE_DEPTH_SIGMA = 0.02  # 1/m: nothing is nearer than some tens of metres
_DIRECTION_SIGMA = 1e3  # nothing is known of it
_PRIOR = np.array([_DIRECTION_SIGMA, _DIRECTION_SIGMA, _INVERSE_DEPTH_SIGMA]) ** -2.0
_HUBER = 2.0  # standard deviations in which a residual counts in full
_FREE = -1
LENS = 2  # errors of the lens that are unknowns: the share by which its focal length is longer, what its k1 is more
_LEAST_SLOPE = 0.3  # a lens that folds back is none
_LEAST_AHEAD = 1e-3  # of a line's length
_WIDEST = 2.0  # squared tangent off the axis, beyond which one coefficient says nothing


@dataclass(frozen=True, slots=True)
class Seen:
    """Sightings to add at a keyframe: names (n,), unit rays (n, 3), and how a ray's error is told (n, 2, 3).

    `whiten` @ ray is the error across the ray in standard deviations. All in the axes of the reported attitude's ENU.
    `depth_m` (n,) is about how far each is, for the first guess.
    """

    names: NDArray[np.int64]
    rays: FloatArray
    whiten: FloatArray
    depth_m: FloatArray


@dataclass(frozen=True, slots=True)
class Sightings:
    """All sightings (n,) of some `places`: the one with the index `of`, which rises, in the keyframe `at`; and of what.

    It is held in `slots` of the pool, with these `rays`, `whiten` and `across` (n, 2, 3).
    """

    places: IntArray
    of: IntArray
    at: IntArray
    slots: IntArray
    rays: FloatArray
    whiten: FloatArray
    across: FloatArray


@dataclass(frozen=True, slots=True)
class Normals:
    """Normal equations of some sightings with the places eliminated: by attitude and position errors (k, 6), and lens.

    `H` (6k + 2, 6k + 2), `g` (6k + 2,); `back` gives the places' moves for the cameras' moves; `residuals` (n, 2)
    are in standard deviations, those of the places with the indices `of` (n,), which rise, in the keyframes `at` (n,).
    """

    H: FloatArray
    g: FloatArray
    places: IntArray
    back_constant: FloatArray
    back_linear: FloatArray
    residuals: FloatArray
    of: IntArray
    at: IntArray


class Landmarks:
    """A pool of `most` places in a window of `keyframes`; every array is made at construction."""

    def __init__(self, most: int, keyframes: int) -> None:
        self.names = np.full(most, _FREE, dtype=np.int64)
        self.is_seen = np.zeros((most, keyframes), dtype=np.bool_)
        self._x = np.zeros((most, 3))  # along the two axes across the first ray; inverse depth
        self._guess = np.zeros(most)  # of the inverse depth
        self._first_ray, self._first_place = np.zeros((most, 3)), np.zeros((most, 3))
        self._across = np.zeros((most, 2, 3))
        self._rays = np.zeros((most, keyframes, 3))
        self._whiten = np.zeros((most, keyframes, 2, 3))

    def add(self, k: int, seen: Seen, turned: FloatArray, place_m: FloatArray) -> int:
        """Sightings at keyframe `k`, whose attitude's error is about `turned` (3, 3); how many found no room."""
        slots = np.full(seen.names.size, _FREE, dtype=np.intp)
        at = {int(name): slot for slot, name in enumerate(self.names.tolist()) if name != _FREE}
        for i, name in enumerate(seen.names.tolist()):
            slots[i] = at.get(name, _FREE)
        room = np.flatnonzero(self.names == _FREE)
        new = np.flatnonzero(slots == _FREE)[: room.size]
        slots[new] = room[: new.size]
        self._start(slots[new], seen.names[new], seen.rays[new] @ turned, place_m, seen.depth_m[new])
        has_room = slots != _FREE
        used = slots[has_room]
        self.is_seen[used, k] = True
        self._rays[used, k] = seen.rays[has_room]
        self._whiten[used, k] = seen.whiten[has_room]
        return int((~has_room).sum())

    def _start(
        self, slots: IntArray, names: NDArray[np.int64], rays: FloatArray, place_m: FloatArray, depth_m: FloatArray
    ) -> None:
        self.names[slots] = names
        self.is_seen[slots] = False
        self._first_ray[slots], self._first_place[slots] = rays, place_m
        right = np.stack([rays[:, 1], -rays[:, 0], np.zeros(len(rays))], axis=1)
        length = np.linalg.norm(right, axis=1, keepdims=True)
        right = np.where(length > 1e-3, right / np.maximum(length, 1e-3), [1.0, 0.0, 0.0])
        self._across[slots, 0], self._across[slots, 1] = right, crossed(right, rays)
        self._x[slots, :2] = 0.0
        self._x[slots, 2] = self._guess[slots] = 1.0 / depth_m

    def take_off_first(self, k: int, by_m: FloatArray) -> None:
        """The camera of keyframe `k` was reported too far by (3,): of use to those first seen there."""
        started = self.is_seen[:, k] & ~self.is_seen[:, :k].any(axis=1)
        self._first_place[started] -= by_m

    def free(self, slots: IntArray) -> None:
        """Forget places."""
        self.names[slots] = _FREE
        self.is_seen[slots] = False

    def shift(self) -> None:
        """The window's first keyframe goes; places that nothing saw since go too."""
        for array in (self.is_seen, self._rays, self._whiten):
            array[:, :-1] = array[:, 1:]
        self.is_seen[:, -1] = False
        self.free(np.flatnonzero(~self.is_seen.any(axis=1) & (self.names != _FREE)))

    def counts(self) -> IntArray:
        """How often each (most,) is seen in the window."""
        return np.asarray(self.is_seen.sum(axis=1))

    def move(self, normals: Normals, by: FloatArray) -> None:
        """Follow a step (6k + 2,) of the cameras' errors."""
        moves = normals.back_constant - normals.back_linear @ by
        self._x[normals.places] += moves

    def sightings(self, which: BoolArray, count: int) -> Sightings:
        """Of the places `which` (most,) in the first keyframes."""
        places = np.flatnonzero(which)
        of, at = np.nonzero(self.is_seen[places, :count])
        slots = places[of]
        return Sightings(places, of, at, slots, self._rays[slots, at], self._whiten[slots, at], self._across[slots])

    def normals(
        self, seen: Sightings, errors: FloatArray, lens: FloatArray, places_m: FloatArray, forward: FloatArray
    ) -> Normals:
        """At the cameras' errors (k, 6) and the lens' (2,).

        `places_m` (k, 3) are where the cameras are reported, `forward` (k, 3) their axes as reported.
        """
        count, ki, slots = len(errors), seen.at, seen.slots
        exp, left = exponentials(errors[:, :3])
        x, baseline = self._x[slots], self._first_place[slots] - places_m[ki] + errors[ki, 3:]
        lines = self._first_ray[slots] + (x[:, None, :2] @ seen.across)[:, 0] + x[:, 2:] * baseline
        at = linearised(lines, seen.rays, seen.whiten, exp[ki], left[ki], lens, forward[ki])
        Jk = np.concatenate([at.by_turn, at.by_line * x[:, 2, None, None]], axis=2)
        Jl = np.concatenate([at.by_line @ seen.across.transpose(0, 2, 1), at.by_line @ baseline[:, :, None]], axis=2)
        return self._eliminated(seen.places, seen.of, ki, count, Jk, at.by_lens, Jl, at.weighed, at.residuals)

    def _eliminated(
        self,
        places: IntArray,
        li: IntArray,
        ki: IntArray,
        count: int,
        Jk: FloatArray,
        Jc: FloatArray,
        Jl: FloatArray,
        r: FloatArray,
        residuals: FloatArray,
    ) -> Normals:
        """By the Schur complement; `li` rises, `Jk` (n, 2, 6), `Jc` (n, 2, 2), `Jl` (n, 2, 3), `r` (n, 2)."""
        n_places, size, of_lens = places.size, 6 * count + LENS, 6 * count
        if n_places == 0:
            H, g, none = np.zeros((size, size)), np.zeros(size), np.zeros((0, 3))
            return Normals(H, g, places, none, np.zeros((0, 3, size)), residuals, li, ki)
        # with nothing where a place is not seen in a keyframe, all sums are products of whole matrices
        by_keyframe, by_place = np.zeros((count, 2 * n_places, 9)), np.zeros((n_places, 2 * count, 6))
        by_keyframe.reshape(count, n_places, 2, 9)[ki, li] = np.concatenate([Jk, Jc, r[:, :, None]], axis=2)
        by_place.reshape(n_places, count, 2, 6)[li, ki] = np.concatenate([Jl, Jc, r[:, :, None]], axis=2)
        of_keyframes = by_keyframe.transpose(0, 2, 1) @ by_keyframe
        of_places = by_place[:, :, :3].transpose(0, 2, 1) @ by_place
        H = np.zeros((size, size))
        each = np.arange(count)
        H[:of_lens, :of_lens].reshape(count, 6, count, 6)[each, :, each] = of_keyframes[:, :6, :6]
        H[:of_lens, of_lens:] = of_keyframes[:, :6, 6:8].reshape(of_lens, LENS)
        H[of_lens:, :of_lens] = H[:of_lens, of_lens:].T
        H[of_lens:, of_lens:] = of_keyframes[:, 6:8, 6:8].sum(axis=0)
        g = -np.concatenate([of_keyframes[:, :6, 8].reshape(-1), of_keyframes[:, 6:8, 8].sum(axis=0)])
        off = self._x[places]
        off[:, 2] -= self._guess[places]
        Hll, gl = of_places[:, :, :3] + np.diag(_PRIOR), -of_places[:, :, 5] - _PRIOR * off
        W = np.zeros((n_places, 3, size))
        W[:, :, :of_lens].reshape(n_places, 3, count, 6)[li, :, ki] = Jl.transpose(0, 2, 1) @ Jk
        W[:, :, of_lens:] = of_places[:, :, 3:5]
        root = np.linalg.inv(np.linalg.cholesky(Hll))
        Y = (root @ W).reshape(3 * n_places, size)
        gy = (root @ gl[:, :, None]).reshape(-1)
        rootT = root.transpose(0, 2, 1)
        H -= Y.T @ Y
        return Normals(
            H=H,
            g=g - gy @ Y,
            places=places,
            back_constant=(rootT @ gy.reshape(n_places, 3, 1))[:, :, 0],
            back_linear=rootT @ Y.reshape(n_places, 3, size),
            residuals=residuals,
            of=li,
            at=ki,
        )


@dataclass(frozen=True, slots=True)
class Linearised:
    """Residuals (n, 2) of sightings in standard deviations, the same as robust weights have them, and the derivatives
    of the latter by the attitude's error and by the line to the place (n, 2, 3), and by the lens' errors (n, 2, 2).
    """

    residuals: FloatArray
    weighed: FloatArray
    by_turn: FloatArray
    by_line: FloatArray
    by_lens: FloatArray


def linearised(
    lines: FloatArray,
    rays: FloatArray,
    whiten: FloatArray,
    exp: FloatArray,
    left: FloatArray,
    lens: FloatArray,
    forward: FloatArray,
) -> Linearised:
    """How lines (n, 3) from the camera to places, of any length, fit the `rays` (n, 3); `whiten` as in `Seen`.

    `exp` and `left` (n, 3, 3) are the `exponentials` of the attitude's error, `forward` (n, 3) the camera's axis,
    `lens` (2,) its errors: they stretch the image about its middle.
    """
    y = np.einsum("nij,nj->ni", exp, lines)
    off = y - np.einsum("ni,ni->n", forward, y)[:, None] * forward
    stretch, stretch_by = _stretch(y, off, forward, lens)
    seen = y + (stretch - 1.0)[:, None] * off
    depth = np.maximum(np.einsum("ni,ni->n", rays, seen), 1e-3)
    r = np.einsum("nij,nj->ni", whiten, seen) / depth[:, None]
    norms = np.linalg.norm(r, axis=1)
    root = np.sqrt(np.minimum(1.0, _HUBER / np.maximum(norms, 1e-9)))
    JF = (whiten - r[:, :, None] * rays[:, None]) * (root / depth)[:, None, None]
    JF_off, JF_forward = (np.einsum("nij,nj->ni", JF, one)[:, :, None] for one in (off, forward))
    stretched = stretch[:, None, None]
    by_y = stretched * JF + (1.0 - stretched) * JF_forward * forward[:, None] + JF_off * stretch_by[:, None, :3]
    return Linearised(
        residuals=r,
        weighed=r * root[:, None],
        by_turn=crossed(y[:, None], by_y) @ left,
        by_line=by_y @ exp,
        by_lens=JF_off * stretch_by[:, None, 3:],
    )


def _stretch(y: FloatArray, off: FloatArray, forward: FloatArray, lens: FloatArray) -> tuple[FloatArray, FloatArray]:
    """By how much (n,) the lens stretches what of lines y (n, 3) is `off` its axis, and that by y and `lens` (n, 5).

    A true tangent t is seen at (1 + focal) (t + k1 t^3). It is the place's own tangent and never the sighting's: that
    one's noise is in the residual too, and would bend the lens, the more the more corners there are.
    """
    focal, k1 = lens
    ahead = np.maximum(np.einsum("ni,ni->n", forward, y), _LEAST_AHEAD * np.linalg.norm(y, axis=1))[:, None]
    squared = np.einsum("ni,ni->n", off, off)[:, None] / ahead**2
    by_y = 2.0 / ahead**2 * (off - squared * ahead * forward)
    widest = min(_WIDEST, (1.0 - _LEAST_SLOPE) / (3.0 * max(-k1, 1e-9)))
    by_y[squared[:, 0] > widest] = 0.0
    squared = np.minimum(squared, widest)
    bent = 1.0 + k1 * squared
    by = np.concatenate([(1.0 + focal) * k1 * by_y, bent, (1.0 + focal) * squared], axis=1)
    return (1.0 + focal) * bent[:, 0], by


def exponentials(vectors: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Rotations (k, 3, 3) of small vectors (k, 3), and their left Jacobians: exp(v + dv) = exp(J dv) exp(v)."""
    K = np.zeros((len(vectors), 3, 3))
    x, y, z = vectors.T
    K[:, 0, 1], K[:, 0, 2], K[:, 1, 2] = -z, y, -x
    K[:, 1, 0], K[:, 2, 0], K[:, 2, 1] = z, -y, x
    angle = np.maximum(np.linalg.norm(vectors, axis=1), 1e-9)[:, None, None]
    K2 = K @ K
    by_sin, by_cos = np.sin(angle) / angle, (1.0 - np.cos(angle)) / angle**2
    rest = np.where(angle < 1e-3, 1.0 / 6.0, (angle - np.sin(angle)) / np.maximum(angle, 1e-3) ** 3)
    return np.eye(3) + by_sin * K + by_cos * K2, np.eye(3) + by_cos * K + rest * K2
