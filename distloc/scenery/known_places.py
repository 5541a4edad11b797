"""Sightings of places that are known beforehand, in a window's keyframes: landmarks that the operator surveyed.

What a place is wrong by is an unknown of the whole window with what was told of it as a prior, so that seeing it often
does not make its place any surer than that. The window adds these normal equations to those of the corners.
"""

import numpy as np

from distloc.scenery.landmarks import LENS, IntArray, Linearised, Seen, exponentials, linearised
from distloc.types import FloatArray

_DATUM_M = 50.0  # by which all heights may be off together: above the ellipsoid in place of the sea
_X = 6  # of a keyframe: attitude error, position error


class KnownPlaces:
    """As many as `sigma_m` (m, 3) has rows, one standard deviation of each east, north and up; fixed memory."""

    def __init__(self, sigma_m: FloatArray, keyframes: int) -> None:
        most = len(sigma_m)
        self.sigma_m = sigma_m.copy()
        self.is_seen = np.zeros((most, keyframes), dtype=np.bool_)
        self._places_m = np.zeros((most, 3))
        self._rays = np.zeros((most, keyframes, 3))
        self._whiten = np.zeros((most, keyframes, 2, 3))

    @property
    def size(self) -> int:
        """Unknowns: three for each place."""
        return 3 * len(self.sigma_m)

    @property
    def covariance(self) -> FloatArray:
        """What was told of the places, and that their heights may be of another datum (3m, 3m)."""
        up = np.tile([0.0, 0.0, 1.0], len(self.sigma_m))
        return np.diag(self.sigma_m.reshape(-1) ** 2) + _DATUM_M**2 * np.outer(up, up)

    def add(self, k: int, seen: Seen, places_m: FloatArray) -> None:
        """Sightings at keyframe `k` of the places with the indices `seen.names`, which are at (n, 3)."""
        which: IntArray = seen.names.astype(np.intp)
        self.is_seen[which, k] = True
        self._places_m[which] = places_m
        self._rays[which, k], self._whiten[which, k] = seen.rays, seen.whiten

    def free(self) -> None:
        """Forget all sightings."""
        self.is_seen[:] = False

    def shift(self) -> None:
        """The window's first keyframe goes."""
        for array in (self.is_seen, self._rays, self._whiten):
            array[:, :-1] = array[:, 1:]
        self.is_seen[:, -1] = False

    def normals(
        self, keyframes: int, state: FloatArray, count: int, cameras_m: FloatArray, forward: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Of the sightings in the first `keyframes` of the window: H (s, s) and g (s,) at `state` (s,).

        The state has attitude and position errors of `count` keyframes, the lens' and the places' errors;
        `cameras_m` (count, 3) are where the cameras are reported, `forward` (count, 3) their axes as reported.
        """
        H, g = np.zeros((state.size, state.size)), np.zeros(state.size)
        if not self.is_seen.any():
            return H, g
        li, ki, at = self.linearised(keyframes, state, count, cameras_m, forward)
        for i in range(li.size):
            of_lens, of_place = _X * count, _X * count + LENS + 3 * li[i]
            columns = np.r_[_X * ki[i] : _X * ki[i] + _X, of_lens : of_lens + LENS, of_place : of_place + 3]
            J = np.concatenate([at.by_turn[i], at.by_line[i], at.by_lens[i], at.by_line[i]], axis=1)
            H[np.ix_(columns, columns)] += J.T @ J
            g[columns] -= J.T @ at.weighed[i]
        return H, g

    def linearised(
        self, keyframes: int, state: FloatArray, count: int, cameras_m: FloatArray, forward: FloatArray
    ) -> tuple[IntArray, IntArray, Linearised]:
        """As for `normals`: of which place and of which keyframe each sighting is (n,), and how well it fits."""
        li, ki = np.nonzero(self.is_seen[:, :keyframes])
        errors, lens, off_m = np.split(state, [_X * count, _X * count + LENS])
        errors, off_m = errors.reshape(count, _X), off_m.reshape(-1, 3)
        exp, left = exponentials(errors[:, :3])
        lines_m = self._places_m[li] + off_m[li] - cameras_m[ki] + errors[ki, 3:]
        rays, whiten = self._rays[li, ki], self._whiten[li, ki]
        return li, ki, linearised(lines_m, rays, whiten, exp[ki], left[ki], lens, forward[ki])
