"""What is known of unknowns, as an information matrix and vector: tied, linked, eliminated, let wander."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from distloc.scenery.landmarks import IntArray
from distloc.types import FloatArray

LEAST_SIGMA = np.array([1e-5] * 3 + [1e-3] * 3)  # of an attitude's error and of a position's


@dataclass(frozen=True, slots=True)
class Chain:
    """How the slow errors come from those of the keyframe before: kept shares, new variances, known moves; white ones.

    Each (6,): attitude about east, north and up in radians, position east, north and up in metres.
    """

    kept: FloatArray
    new: FloatArray
    white: FloatArray
    moved: FloatArray


def without(H: FloatArray, h: FloatArray, gone: IntArray) -> tuple[FloatArray, FloatArray]:
    """What is known of the others once some unknowns are eliminated."""
    stays = np.ones(h.size, np.bool_)
    stays[gone] = False
    left = np.flatnonzero(stays)
    across = H[np.ix_(left, gone)]
    solved = np.linalg.solve(H[np.ix_(gone, gone)], np.column_stack([across.T, h[gone]]))
    rest = H[np.ix_(left, left)] - across @ solved[:, :-1]
    return (rest + rest.T) / 2.0, h[left] - across @ solved[:, -1]


def tie(H: FloatArray, x: IntArray, s: IntArray, chain: Chain) -> None:
    """x is s and something white, in place."""
    weight = 1.0 / np.maximum(chain.white, LEAST_SIGMA**2)
    H[x, x] += weight
    H[s, s] += weight
    H[x, s] -= weight
    H[s, x] -= weight


def link(H: FloatArray, h: FloatArray, before: IntArray, now: IntArray, chain: Chain) -> None:
    """now = kept * before + moved, in place."""
    weight = 1.0 / np.maximum(chain.new, LEAST_SIGMA**2)
    H[now, now] += weight
    H[before, before] += chain.kept**2 * weight
    H[now, before] -= chain.kept * weight
    H[before, now] -= chain.kept * weight
    h[now] += weight * chain.moved
    h[before] -= chain.kept * weight * chain.moved


def chained(chains: Sequence[Chain]) -> tuple[FloatArray, FloatArray]:
    """What n chains know of each axis' x and of the first one's slow part, which comes last: (6, n + 1, n + 1) and so.

    The other slow parts are eliminated. The axes know nothing of each other; of the first chain only `white` counts.
    """
    n = len(chains)
    kept, moved = np.array([one.kept for one in chains]).T, np.array([one.moved for one in chains]).T
    least = (LEAST_SIGMA**2)[:, None]
    tied = 1.0 / np.maximum(np.array([one.white for one in chains]).T, least)  # (6, n), as all here
    linked = 1.0 / np.maximum(np.array([one.new for one in chains]).T, least)
    linked[:, 0] = 0.0
    each, later = np.arange(n), np.arange(1, n)
    of_slow, h_slow = np.zeros((len(least), n, n)), linked * moved
    of_slow[:, each, each] = tied + linked
    of_slow[:, each[:-1], each[:-1]] += (kept**2 * linked)[:, 1:]
    of_slow[:, later, later - 1] = of_slow[:, later - 1, later] = -(kept * linked)[:, 1:]
    h_slow[:, :-1] -= (kept * linked * moved)[:, 1:]
    across = np.zeros((len(least), n + 1, n - 1))  # of what stays to what goes
    across[:, later, later - 1] = -tied[:, 1:]
    across[:, n] = of_slow[:, 0, 1:]
    H, h = np.zeros((len(least), n + 1, n + 1)), np.zeros((len(least), n + 1))
    H[:, each, each], H[:, 0, n], H[:, n, 0] = tied, -tied[:, 0], -tied[:, 0]
    H[:, n, n], h[:, n] = of_slow[:, 0, 0], h_slow[:, 0]
    goes = np.concatenate([across.swapaxes(1, 2), h_slow[:, 1:, None]], axis=2)
    known = across @ np.linalg.solve(of_slow[:, 1:, 1:], goes)
    H, h = H - known[:, :, :-1], h - known[:, :, -1]
    return (H + H.swapaxes(1, 2)) / 2.0, h


def with_room(H: FloatArray, h: FloatArray, at: int, more: int) -> tuple[FloatArray, FloatArray]:
    """The prior with nothing known of so many more unknowns, which begin at a place."""
    size = h.size + more
    kept = np.r_[0:at, at + more : size]
    larger, longer = np.zeros((size, size)), np.zeros(size)
    larger[np.ix_(kept, kept)], longer[kept] = H, h
    return larger, longer


def wandering(H: FloatArray, h: FloatArray, which: IntArray, by: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The same once some unknowns have each moved by a variance `by` (n,); the others stay as sure as they were."""
    across = H[:, which]
    gain = np.linalg.solve(np.diag(1.0 / by) + across[which], np.column_stack([across.T, h[which]]))
    left = H - across @ gain[:, :-1]
    return (left + left.T) / 2.0, h - across @ gain[:, -1]
