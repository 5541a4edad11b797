"""How the middle of a target's segments strays from the target's own, and so how a sighting is to be weighed."""

from dataclasses import dataclass

import numpy as np

from distloc.sights.aspect import Aspect
from distloc.sights.sight import Sight
from distloc.sights.sights import Ray
from distloc.snapshot import AspectSnapshot
from distloc.tracks.looks.looks import Looks
from distloc.types import BoolArray, FloatArray


@dataclass(frozen=True, slots=True)
class Weighing:
    """How a sight is to be weighed: by its covariance (2, 2), which grows the oftener its target was seen from there.

    Of the aim's error, of `aim_sigma_rad` (2,) now, a share (2,) is `kept`; it `grows` (2,) as the target looks larger.
    """

    kept: FloatArray
    aim_sigma_rad: FloatArray
    grows: BoolArray
    covariance: FloatArray


class AimError:
    """From where a target was seen, and what the border cut of it when it was seen last; its track has one."""

    _aspect: Aspect  # there once it was seen first

    def __init__(self, looks: Looks) -> None:
        self._looks = looks
        self._is_cut = np.zeros(2, np.bool_)  # across and upright

    @classmethod
    def restored(cls, looks: Looks, saved: AspectSnapshot) -> "AimError":
        """It goes on. ValueError for another number of sides."""
        error = cls(looks)
        error._aspect = Aspect.restored(saved)
        return error

    def snapshot(self) -> AspectSnapshot:
        """What it needs to go on."""
        return self._aspect.snapshot()

    def seen_first(self, ray: Ray, target_enu_m: FloatArray) -> None:
        """From this side, the target at about (3,)."""
        self._aspect = Aspect(target_enu_m, ray.pose.position_enu_m)

    def sigma_rad(self, ray: Ray) -> FloatArray:
        """One standard deviation (2,), what lies beyond the border included: as long as it is cut that may be off."""
        aim_rad = self._looks.aim_sigma_rad(ray)
        if not any(ray.is_cut):
            self._is_cut = np.zeros(2, np.bool_)
            return aim_rad
        cut_rad = self._looks.cut_sigma_rad(ray)
        self._is_cut = cut_rad > aim_rad
        return np.hypot(aim_rad, cut_rad)

    def weighing(self, ray: Ray, sight: Sight, target_enu_m: FloatArray) -> Weighing:
        """How a filter that has the target at about (3,) is to weigh what a ray tells, the sight."""
        aim_rad = self._looks.aim_sigma_rad(ray)
        turn = self._aspect.turned(target_enu_m, sight.position_enu_m)
        was_cut, sigma_rad = self._is_cut, self.sigma_rad(ray)
        # another error altogether where the border begins or ends to cut
        kept = np.where(was_cut == self._is_cut, np.where(self._is_cut, turn.kept_cut, turn.kept), 0.0)
        doubt = turn.doubt(float(max(aim_rad)) ** 2, float(min(sight.covariance[0, 0], sight.covariance[1, 1])))
        return Weighing(kept, sigma_rad, ~self._is_cut, doubt * sight.covariance)
