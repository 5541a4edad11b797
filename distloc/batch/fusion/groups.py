"""Which claims are of one fire: each vehicle's assigned to the fires of the others, until nothing changes.

Two claims of one vehicle are two fires: it told them apart itself. A whole vehicle is assigned at once, so that one
whose compass shifts all that it says is not torn apart.
"""

import math
from collections.abc import Mapping, Sequence, Set

import numpy as np
from numpy.typing import NDArray

from distloc.batch.fusion.claims import Claim
from distloc.batch.fusion.place import PRIOR, SCALES
from distloc.tracks.assignment.matching import best_pairs
from distloc.types import FloatArray

JOIN = 13.8  # chi squared, two degrees of freedom: 0.1 % of those that are one are farther apart
STAY = 22.0  # what was one before
_ROUNDS = 4
_DENSITY = 1e-5  # fires a square metre, where there are several: each 300 m
_CLOSER = 4.0  # of twice the log likelihood: a claim that fits a second fire nearly as well is of neither for sure

IntArray = NDArray[np.intp]


def grouped(claims: Sequence[Claim], before: Mapping[str, str], fresh: Set[str] = frozenset()) -> IntArray:
    """The group (N,) of each claim, numbered from 0; `before` has the fire of each name when it was asked for last.
    Claims of the names in `fresh` are so new that their vehicle may tell two fires apart yet: they join only what is
    theirs beyond doubt.

    The same claims in any order give the same groups.
    """
    groups = _Groups(claims, before, fresh)
    order = groups.vehicles()
    for own in order:
        groups.assign(own)
    for _ in range(_ROUNDS):
        was = groups.partition()
        for own in order:
            groups.take_out(own)
            groups.assign(own)
        if groups.partition() == was:
            break
    groups.join()
    return groups.numbered()


def undecided(claims: Sequence[Claim], group: IntArray) -> NDArray[np.bool_]:
    """Which claims (N,) fit a second group nearly as well as their own, where their vehicle tells of nothing."""
    found = np.zeros(len(claims), np.bool_)
    count = int(group.max()) + 1
    if count < 2:
        return found
    groups = _Groups(claims, {}, frozenset())
    groups.put_all(group)
    vehicle = groups.vehicle
    has = np.zeros((count, int(vehicle.max()) + 1), np.bool_)
    has[group, vehicle] = True
    sizes = np.bincount(group)
    for i in range(len(claims)):
        if sizes[group[i]] < 2:
            continue
        rows = np.array([i])
        groups.take_out(rows)
        away = groups.squares(rows)[0][0]
        groups.put(i, int(group[i]))
        others = [g for g in range(count) if g != group[i] and not has[g, vehicle[i]]]
        found[i] = any(_tailed(away[g]) < _tailed(away[group[i]]) + _CLOSER for g in others)
    return found


class _Groups:
    """Sums of information of the members of up to N groups; a group without members is free."""

    def __init__(self, claims: Sequence[Claim], before: Mapping[str, str], fresh: Set[str]) -> None:
        n = len(claims)
        self._claims = claims
        self._x = np.array([one.position_en_m for one in claims])
        self._P = np.array([one.covariance_m2 for one in claims])
        self._information = np.linalg.inv(self._P)
        self._vector = np.einsum("nij,nj->ni", self._information, self._x)
        self.vehicle = np.unique([one.vehicle for one in claims], return_inverse=True)[1]
        fires = [before.get(one.name, "") for one in claims]
        fire = np.unique(fires, return_inverse=True)[1]
        self._was_one = (fire[:, None] == fire) & (np.array(fires) != "")
        self._is_fresh = np.array([one.name in fresh for one in claims])
        self._group = np.full(n, -1, np.intp)
        self._sums, self._sum_vectors = np.zeros((n, 2, 2)), np.zeros((n, 2))
        self._sizes, self._fresh_in = np.zeros(n, np.intp), np.zeros(n, np.intp)

    def vehicles(self) -> list[IntArray]:
        """Rows of each, those with the most claims first, then the surest."""
        keyed = []
        for number in range(int(self.vehicle.max()) + 1):
            rows = np.flatnonzero(self.vehicle == number)
            least = float(np.trace(self._P[rows], axis1=1, axis2=2).min())
            keyed.append((-len(rows), least, self._claims[rows[0]].vehicle, rows))
        return [one[3] for one in sorted(keyed, key=lambda one: one[:3])]

    def squares(self, rows: IntArray) -> tuple[FloatArray, FloatArray]:
        """Mahalanobis' distance squared of each claim (k,) from each group (N,), endless from a free one; the gates."""
        shape = len(rows), len(self._sizes)
        away, gate = np.full(shape, np.inf), np.full(shape, JOIN)
        used = np.flatnonzero(self._sizes)
        if used.size:
            P = np.linalg.inv(self._sums[used])
            x = np.einsum("gij,gj->gi", P, self._sum_vectors[used])
            d = self._x[rows][:, None] - x
            S = self._P[rows][:, None] + P
            away[:, used] = _square(d, S)
            is_new = self._is_fresh[rows][:, None] | (self._fresh_in[used] > 0)
            gate[:, used] = np.where(is_new, np.minimum(_doubtless(S), JOIN), JOIN)
        return away, gate

    def assign(self, rows: IntArray) -> None:
        """A vehicle's claims to the groups, at most one each; what fits none gets its own."""
        away, gate = self.squares(rows)
        members = np.zeros((len(self._sizes), len(self._group)), np.bool_)
        inside = np.flatnonzero(self._group >= 0)
        members[self._group[inside], inside] = True
        gate = np.where((self._was_one[rows].astype(np.float64) @ members.T) > 0.0, STAY, gate)
        scores = np.where(away < gate, 1.0 - away / np.maximum(gate, 1e-9), 0.0)
        by_row, by_column = np.nonzero(scores > 0.0)
        for pair in best_pairs(scores[by_row, by_column], by_row, by_column):
            self.put(int(rows[by_row[pair]]), int(by_column[pair]))
        for i in rows[self._group[rows] < 0]:
            self.put(int(i), int(np.flatnonzero(self._sizes == 0)[0]))

    def put(self, i: int, group: int) -> None:
        """One claim into a group."""
        self._group[i] = group
        self._sizes[group] += 1
        self._fresh_in[group] += self._is_fresh[i]
        self._sums[group] += self._information[i]
        self._sum_vectors[group] += self._vector[i]

    def take_out(self, rows: IntArray) -> None:
        """Claims out of theirs."""
        for i in rows:
            group = self._group[i]
            self._sizes[group] -= 1
            self._fresh_in[group] -= self._is_fresh[i]
            self._sums[group] -= self._information[i]
            self._sum_vectors[group] -= self._vector[i]
            if self._sizes[group] == 0:
                self._sums[group], self._sum_vectors[group] = 0.0, 0.0
        self._group[rows] = -1

    def put_all(self, group: IntArray) -> None:
        """As it is."""
        for i, one in enumerate(group):
            self.put(i, int(one))

    def join(self) -> None:
        """Groups that have no vehicle in common, the nearest first."""
        while True:
            used = np.flatnonzero(self._sizes)
            if used.size < 2:
                return
            P = np.linalg.inv(self._sums[used])
            x = np.einsum("gij,gj->gi", P, self._sum_vectors[used])
            S = P[:, None] + P
            away = _square(x[:, None] - x, S)
            is_new = (self._fresh_in[used] > 0)[:, None] | (self._fresh_in[used] > 0)
            away[is_new & (away > _doubtless(S))] = np.inf
            has = np.zeros((len(used), int(self.vehicle.max()) + 1))
            has[np.searchsorted(used, self._group), self.vehicle] = 1.0
            away[(has @ has.T) > 0.0] = np.inf
            first, second = np.unravel_index(int(away.argmin()), away.shape)
            if not away[first, second] < JOIN:
                return
            rows = np.flatnonzero(self._group == used[second])
            self.take_out(rows)
            for i in rows:
                self.put(int(i), int(used[first]))

    def partition(self) -> set[frozenset[int]]:
        """Who is with whom."""
        return {frozenset(np.flatnonzero(self._group == one).tolist()) for one in np.unique(self._group)}

    def numbered(self) -> IntArray:
        """The groups (N,) from 0, without free ones."""
        return np.unique(self._group, return_inverse=True)[1].astype(np.intp)


def _doubtless(S: FloatArray) -> FloatArray:
    """The gate at which one fire is as likely as a second one beside it."""
    size = np.sqrt(S[..., 0, 0] * S[..., 1, 1] - S[..., 0, 1] ** 2)
    return np.asarray(-2.0 * np.log(2.0 * np.pi * size * _DENSITY))


def _tailed(away: float) -> float:
    """Minus twice the log likelihood at a distance squared, where the claim's drone may be worse than it tells."""
    squares = [scale**2 for scale in SCALES]
    likelihood = sum(share / s * math.exp(-0.5 * away / s) for share, s in zip(PRIOR, squares, strict=True))
    return -2.0 * math.log(max(likelihood, 1e-300))


def _square(d: FloatArray, S: FloatArray) -> FloatArray:
    """d' S^-1 d of offsets (..., 2) and covariances (..., 2, 2)."""
    xx, xy, yy = S[..., 0, 0], S[..., 0, 1], S[..., 1, 1]
    x, y = d[..., 0], d[..., 1]
    return np.asarray((yy * x * x - 2.0 * xy * x * y + xx * y * y) / (xx * yy - xy * xy))
