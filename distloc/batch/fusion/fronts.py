"""Fires in a row or a patch, as a fire front seen from several sides: a line or an area through them."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from distloc.types import FloatArray

APART_M = 500.0  # what burns farther off from all others is no part of one front
_LEAST = 3
_SIGMAS = 3.0  # the places scatter by so many of their own standard deviations, or they may be one


@dataclass(frozen=True, slots=True)
class Front:
    """Which places it goes through, in order: along a line, or round an area, counter-clockwise."""

    kind: Literal["line", "area"]
    members: tuple[int, ...]


def fronts(positions_en_m: FloatArray, covariances_m2: FloatArray, vehicles: Sequence[frozenset[str]]) -> list[Front]:
    """Of places (N, 2) with covariances (N, 2, 2), each with who tells of it; three places and two vehicles at least.

    They are a line where they scatter across it no more than they may err, else an area: their convex hull.
    """
    found = []
    for rows in _chains(positions_en_m):
        who = frozenset().union(*(vehicles[i] for i in rows))
        if len(rows) < _LEAST or len(who) < 2:
            continue
        places = positions_en_m[rows]
        centred = places - places.mean(axis=0)
        axes = np.linalg.svd(centred, full_matrices=False)[2]
        spread = np.sqrt(np.square(centred @ axes.T).mean(axis=0))
        sigma = np.sqrt([float(np.mean([axis @ covariances_m2[i] @ axis for i in rows])) for axis in axes])
        if spread[0] <= _SIGMAS * sigma[0]:
            continue
        if spread[1] <= _SIGMAS * sigma[1]:
            order = np.argsort(centred @ axes[0], kind="stable")
            found.append(Front("line", tuple(int(rows[i]) for i in order)))
        else:
            found.append(Front("area", tuple(int(rows[i]) for i in _hull(places))))
    return found


def _chains(positions_en_m: FloatArray) -> list[list[int]]:
    """Rows of places that hang together by steps of `APART_M`."""
    is_left, chains = np.ones(len(positions_en_m), np.bool_), []
    while is_left.any():
        chain, at = [int(is_left.argmax())], 0
        is_left[chain[0]] = False
        while at < len(chain):
            away_m = np.linalg.norm(positions_en_m - positions_en_m[chain[at]], axis=1)
            near = np.flatnonzero(is_left & (away_m <= APART_M))
            is_left[near] = False
            chain += near.tolist()
            at += 1
        chains.append(sorted(chain))
    return chains


def _hull(points: FloatArray) -> list[int]:
    """Rows of the convex hull, counter-clockwise: Andrew's monotone chain."""
    order = np.lexsort((points[:, 1], points[:, 0])).tolist()

    def half(rows: Sequence[int]) -> list[int]:
        kept: list[int] = []
        for row in rows:
            while len(kept) > 1 and _turn(points[kept[-2]], points[kept[-1]], points[row]) <= 0.0:
                kept.pop()
            kept.append(row)
        return kept[:-1]

    return half(order) + half(order[::-1])


def _turn(a: FloatArray, b: FloatArray, c: FloatArray) -> float:
    return float((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]))
