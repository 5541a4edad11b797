"""How far the middle of a silhouette strays from the middle of the body, as the view turns about it. A track has one.

The near side of a body looks larger than its far side. The ray midway between the edges of a square block of half-width
a at range r passes its centre by (a / r)^2 cos 2t, t being the angle between the line of sight and the normal of the
nearer face, so it jumps from one side to the other where a face is seen head on; a round plume has no such error.
A Gauss-Markov process in the angle that the view has turned has that size, changes about so fast, and knows nothing of
faces: the longer the turn, the more the error averages out, and a view that hardly turns takes it for a nearer or
farther target. What is seen again from the same side errs as before, so a second look tells little that is new.
docs/study.md has what comes of it.
"""

import math
from dataclasses import dataclass

import numpy as np

from distloc.snapshot import AspectSnapshot
from distloc.types import FloatArray

_RMS = 0.7  # of cos 2t
_TURN_RAD = 0.1  # over which the error forgets itself: between the jump, about 2a / r, and the 0.8 between zeros
_CUT_TURN_RAD = 1.0  # the same for what the image's border cuts
_SIDES = 63  # of about that width all around


@dataclass(frozen=True, slots=True)
class Turn:
    """The share of the last sighting's error that is `kept`, which `visit` to a side it is, the sightings of one.

    Of what the border cuts `kept_cut` stays: how a plume goes on beyond it changes as the whole of it is seen to turn.
    """

    kept: float
    kept_cut: float
    visit: int
    sightings: float

    def doubt(self, aim_variance: float, white_variance: float) -> float:
        """By what a sighting's white variance must grow for the visits to a side to tell together what one aim can.

        All of them know the place to the aim's variance and the white one over their number. Both in the same unit.
        """
        ratio = self.sightings * aim_variance / white_variance
        return (1.0 + self.visit * ratio) * (1.0 + (self.visit - 1) * ratio) - ratio


class Aspect:
    """From where a target was seen last, and how often from each side."""

    def __init__(self, target_enu_m: FloatArray, camera_enu_m: FloatArray) -> None:
        self._camera_enu_m = camera_enu_m
        self._side = 0
        self._visits, self._sightings = np.zeros(_SIDES, np.int64), np.zeros(_SIDES, np.int64)
        self._visit(_azimuth_rad(target_enu_m, camera_enu_m))

    def turned(self, target_enu_m: FloatArray, camera_enu_m: FloatArray) -> Turn:
        """A sighting from `camera_enu_m` (3,)."""
        ax, ay, az = (self._camera_enu_m - target_enu_m).tolist()
        bx, by, bz = (camera_enu_m - target_enu_m).tolist()
        self._camera_enu_m = camera_enu_m
        across = math.hypot(ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx)
        turn_rad = math.atan2(across, ax * bx + ay * by + az * bz)
        azimuth_rad = _azimuth_rad(target_enu_m, camera_enu_m)
        off = (azimuth_rad / (2.0 * np.pi) * _SIDES - self._side - 0.5 + _SIDES / 2.0) % _SIDES - _SIDES / 2.0
        if abs(off) > 0.75:  # not at every step to and fro over a side's edge
            self._visit(azimuth_rad)
        else:
            self._sightings[self._side] += 1
        visit = int(self._visits[self._side])
        seen = int(self._sightings[self._side])
        kept, kept_cut = math.exp(-turn_rad / _TURN_RAD), math.exp(-turn_rad / _CUT_TURN_RAD)
        return Turn(kept, kept_cut, visit, seen / visit)

    def snapshot(self) -> AspectSnapshot:
        """What it needs to go on."""
        return AspectSnapshot(self._camera_enu_m.copy(), self._side, self._visits.copy(), self._sightings.copy())

    @classmethod
    def restored(cls, saved: AspectSnapshot) -> "Aspect":
        """It goes on. ValueError for another number of sides."""
        if saved.visits.size != _SIDES:
            raise ValueError(f"visits must be of {_SIDES} sides, got {saved.visits.size}")
        aspect = cls(np.zeros(3), saved.camera_enu_m)
        aspect._camera_enu_m, aspect._side = saved.camera_enu_m.copy(), saved.side
        aspect._visits, aspect._sightings = saved.visits.copy(), saved.sightings.copy()
        return aspect

    def _visit(self, azimuth_rad: float) -> None:
        self._side = int(azimuth_rad / (2.0 * np.pi) * _SIDES) % _SIDES
        self._visits[self._side] += 1
        self._sightings[self._side] += 1


def aim_sigma_rad(size_rad: FloatArray) -> FloatArray:
    """One standard deviation (2,) of the error right and up, of what looks so wide and high (2,)."""
    return np.asarray(_RMS * np.square(size_rad / 2.0))


def _azimuth_rad(target_enu_m: FloatArray, camera_enu_m: FloatArray) -> float:
    east_m, north_m, _ = (camera_enu_m - target_enu_m).tolist()
    return math.atan2(east_m, north_m) % (2.0 * math.pi)
