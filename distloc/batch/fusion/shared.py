"""What drones err by together: fused, it is not averaged away. The ground and `study fleets` split reports by it.

Who looks at the same smoke aims at the same root. Where trees hide its foot, that is downwind of the fire from every
side; all receivers of a place have some of the GNSS error in common, and the geoid; and who takes ranges from the same
terrain is off with it.
"""

import math

import numpy as np

from distloc.types import FloatArray

GNSS_M = 2.0  # one standard deviation on each axis
AIM_M = 30.0  # the same, of an aim at smoke of which nothing is told
MOST_SHARE = 0.8  # of a report's variance in any direction: the rest is its compass and its own noise
# `study scenes` with true poses: behind trees of 60 m the root was 33 to 43 m over the fire though what may be hidden
# was allowed for, and 17 to 24 m under it in the open. Downwind that was 23 to 129 m, and 30 m or less.
_UNDER_M = 30.0
_BELOW = 0.65  # of the lean that is seen, that under it (`distloc/tracks/looks/lean.py`)
_LEAST_LEAN, _MOST_LEAN_RAD = 0.6, math.radians(70.0)  # metres downwind for each metre up: unseen along the sight


def aim_sigma_m(lean_rad: float | None) -> float:
    """One standard deviation of the aim on each axis, by how far the smoke leans off the vertical; None: not told."""
    if lean_rad is None or not math.isfinite(lean_rad):
        return AIM_M
    return _UNDER_M * max(_BELOW * math.tan(min(abs(lean_rad), _MOST_LEAN_RAD)), _LEAST_LEAN)


def shared_part(covariance_m2: FloatArray, aim_m: float = AIM_M, terrain_rad: float | None = None) -> FloatArray:
    """Of a report's covariance (2, 2) the part (2, 2) that others may have in common with it, in any correlation.

    `aim_m` is as `aim_sigma_m` has it. With `terrain_rad`, the azimuth of the line of sight, all of the error along
    that, as it has its range from the terrain. At most MOST_SHARE of the covariance in any direction.
    """
    common = (GNSS_M**2 + aim_m**2) * np.eye(2)
    root = np.linalg.cholesky(covariance_m2)
    inverse = np.linalg.inv(root)
    whitened = inverse @ common @ inverse.T
    if terrain_rad is not None:
        along = inverse @ np.array([math.sin(terrain_rad), math.cos(terrain_rad)])
        whitened += np.outer(along, along) / float(along @ along)
    values, vectors = np.linalg.eigh(0.5 * (whitened + whitened.T))
    part = root @ vectors
    return np.asarray((part * np.minimum(values, MOST_SHARE)) @ part.T)
