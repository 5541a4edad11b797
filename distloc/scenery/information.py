"""What is known of unknowns, as an information matrix and vector: tied, linked, eliminated, let wander."""

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
    left = np.setdiff1d(np.arange(h.size), gone)
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
