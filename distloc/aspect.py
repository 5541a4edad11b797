"""How far the middle of a silhouette strays from the middle of the body, as the view turns about it. A track has one.

The near side of a body looks larger than its far side. The ray midway between the edges of a square block of half-width
a at range r passes its centre by (a / r)^2 cos 2t, t being the angle between the line of sight and the normal of the
nearer face, so it jumps from one side to the other where a face is seen head on; a round plume has no such error.
A Gauss-Markov process in the angle that the view has turned has that size, changes about so fast, and knows nothing of
faces: the longer the turn, the more the error averages out, and a view that hardly turns takes it for a nearer or
farther target. docs/study.md has what comes of it.
"""

import numpy as np

from distloc.types import FloatArray

_RMS = 0.7  # of cos 2t
_TURN_RAD = 0.1  # over which the error forgets itself: between the jump, about 2a / r, and the 0.8 between zeros


class Aspect:
    """From where a target was seen last."""

    def __init__(self, camera_enu_m: FloatArray) -> None:
        self._camera_enu_m = camera_enu_m

    def turned(self, target_enu_m: FloatArray, camera_enu_m: FloatArray) -> float:
        """The share of the error at the last sighting that is left at a sighting from `camera_enu_m` (3,)."""
        before, now = self._camera_enu_m - target_enu_m, camera_enu_m - target_enu_m
        self._camera_enu_m = camera_enu_m
        turn_rad = np.arctan2(np.linalg.norm(np.cross(before, now)), before @ now)
        return float(np.exp(-turn_rad / _TURN_RAD))


def aim_sigma_rad(width_rad: float) -> float:
    """One standard deviation of the error, level, of what looks `width_rad` wide."""
    return _RMS * (width_rad / 2.0) ** 2
