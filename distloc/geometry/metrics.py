"""Errors of estimates against the truth, and how sure a share of runs is."""

from dataclasses import dataclass

import numpy as np

from distloc.types import FloatArray

_NORMAL_975 = 1.959964  # the standard normal's 97.5 % quantile


@dataclass(frozen=True, slots=True)
class Gospa:
    """`distance` in metres; distance^order = localisation^order + cutoff^order / 2 x (missed + false)."""

    distance: float
    localisation: float
    missed: int
    false: int


def horizontal_error_m(estimate_enu_m: FloatArray, truth_enu_m: FloatArray) -> float:
    """Distance on the map between two positions (3,)."""
    return float(np.hypot(*(estimate_enu_m - truth_enu_m)[:2]))


def share_inside(particles_enu_m: FloatArray, is_inside: np.ndarray[tuple[int], np.dtype[np.bool_]]) -> float:
    """The paper's ratio: the share of particles (3, N) for which `is_inside` (N,) holds."""
    return float(np.count_nonzero(is_inside) / particles_enu_m.shape[1])


def nees(error: FloatArray, covariance: FloatArray) -> float:
    """Normalised estimation error squared e' P^-1 e of an error (k,): k on average where P (k, k) is true.

    Bar-Shalom, Li and Kirubarajan 2001, 5.4.2. LinAlgError for a singular covariance.
    """
    return float(error @ np.linalg.solve(covariance, error))


def gospa(truths: FloatArray, estimates: FloatArray, cutoff_m: float, order: float = 2.0) -> Gospa:
    """Generalised optimal sub-pattern assignment, alpha = 2, between points (d, T) and (d, E); either may be none.

    Rahmathullah, Garcia-Fernandez and Svensson 2017, proposition 1: pairs nearer than the cutoff cost their distance,
    what has no such partner is missed or false.
    """
    if not (cutoff_m > 0.0 and order >= 1.0):
        raise ValueError(f"cutoff_m must be > 0 and order >= 1, got {cutoff_m} and {order}")
    distances_m = np.linalg.norm(truths[:, :, None] - estimates[:, None, :], axis=0)
    costs = np.minimum(distances_m, cutoff_m) ** order
    near = [costs[pair] for pair in assignment(costs) if distances_m[pair] < cutoff_m]
    missed, false = truths.shape[1] - len(near), estimates.shape[1] - len(near)
    located = float(sum(near))
    total = located + cutoff_m**order / 2.0 * (missed + false)
    return Gospa(float(total ** (1.0 / order)), float(located ** (1.0 / order)), missed, false)


def assignment(costs: FloatArray) -> list[tuple[int, int]]:
    """The pairs (row, column) of least total cost that use every row or every column of (M, N), whichever are fewer.

    Exact, by dynamic programming over the sets of taken columns: N 2^N steps, for the larger side up to about 12.
    """
    if costs.shape[0] > costs.shape[1]:
        return sorted((row, column) for column, row in assignment(costs.T))
    best: dict[int, tuple[float, tuple[int, ...]]] = {0: (0.0, ())}
    for row in costs:
        grown: dict[int, tuple[float, tuple[int, ...]]] = {}
        for taken, (total, columns) in best.items():
            for column, cost in enumerate(row):
                key = taken | 1 << column
                if key != taken and total + cost < grown.get(key, (np.inf, ()))[0]:
                    grown[key] = (total + float(cost), (*columns, column))
        best = grown
    return list(enumerate(min(best.values())[1]))


def wilson_interval(hits: float, trials: float) -> tuple[float, float]:
    """The 95 % interval of a share of independent trials (Wilson 1927); 0 and 1 where there is none.

    Parts of a trial count where each trial has a share of its own.
    """
    if not 0 <= hits <= trials:
        raise ValueError(f"hits must be within 0 and trials, got {hits} of {trials}")
    if trials == 0:
        return 0.0, 1.0
    share, z2 = hits / trials, _NORMAL_975**2
    centre = (share + z2 / (2 * trials)) / (1.0 + z2 / trials)
    half = _NORMAL_975 * np.sqrt(share * (1.0 - share) / trials + z2 / (4.0 * trials**2)) / (1.0 + z2 / trials)
    return max(0.0, float(centre - half)), min(1.0, float(centre + half))
