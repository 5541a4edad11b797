"""Errors of an estimate against the truth."""

import numpy as np

from distloc.types import FloatArray


def horizontal_error_m(estimate_enu_m: FloatArray, truth_enu_m: FloatArray) -> float:
    """Distance on the map between two positions (3,)."""
    return float(np.hypot(*(estimate_enu_m - truth_enu_m)[:2]))


def share_inside(particles_enu_m: FloatArray, is_inside: np.ndarray[tuple[int], np.dtype[np.bool_]]) -> float:
    """The paper's ratio: the share of particles (3, N) for which `is_inside` (N,) holds."""
    return float(np.count_nonzero(is_inside) / particles_enu_m.shape[1])
