"""How the middles of targets' segments stray from the targets' own, and so how sightings are weighed."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from distloc.filter.bank import Bank
from distloc.filter.particles import Places
from distloc.sights.aspect import Aspect
from distloc.sights.sight import Sights
from distloc.sights.sights import Ray
from distloc.snapshot import AspectSnapshot, TrackSnapshot
from distloc.tracks.looks.looks import Looks
from distloc.types import FloatArray


class AimErrors:
    """From where targets were seen, and what the border cut of them when they were seen last: a row for each place."""

    def __init__(self, places: int, looks: Looks) -> None:
        self.looks = looks
        self._aspects: list[Aspect | None] = [None] * places  # there once it was seen first
        self._is_cut = np.zeros((places, 2), np.bool_)  # across and upright

    def restore(self, place: int, saved: TrackSnapshot) -> None:
        """Go on. ValueError for another number of sides."""
        self.clear(place)
        self.looks.restore(place, saved)
        self._aspects[place] = Aspect.restored(saved.aspect)

    def snapshot(self, place: int) -> AspectSnapshot:
        """What it needs to go on."""
        return self._aspect(place).snapshot()

    def clear(self, place: int) -> None:
        """A new target."""
        self.looks.clear(place)
        self._is_cut[place] = False

    def seen_first(self, place: int, ray: Ray, target_enu_m: FloatArray) -> None:
        """From this side, the target at about (3,)."""
        self._aspects[place] = Aspect(target_enu_m, ray.pose.position_enu_m)

    def sigma_rad(self, place: int, ray: Ray) -> FloatArray:
        """One standard deviation (2,), what lies beyond the border included: as long as that is cut it may be off."""
        return np.asarray(self._sigmas_rad(np.array([place]), [ray])[1][0])

    def weigh(self, bank: Bank, places: Places, rays: Sequence[Ray], sights: Sights) -> None:
        """The filters weigh what k rays of one frame tell, the sights: the oftener seen from there, the less.

        Of the aims' errors a share is kept; they grow where a target looks larger.
        """
        targets_enu_m = bank.particles.clouds.mean_enu_m[places]
        camera_enu_m, was_cut = sights.position_enu_m, self._is_cut[places]
        turns = [self._aspect(at).turned(one, camera_enu_m) for at, one in zip(places, targets_enu_m, strict=True)]
        aim_rad, sigma_rad = self._sigmas_rad(places, rays)
        is_cut, shares = self._is_cut[places], np.array([(turn.kept, turn.kept_cut) for turn in turns])
        # another error altogether where the border begins or ends to cut
        kept = np.where(was_cut == is_cut, np.where(is_cut, shares[:, 1:], shares[:, :1]), 0.0)
        aim = np.square(aim_rad.max(axis=1)).tolist()
        white = np.diagonal(sights.covariance, axis1=1, axis2=2).min(axis=1).tolist()
        doubt = np.array([turn.doubt(*variances) for turn, *variances in zip(turns, aim, white, strict=True)])
        bank.turn(places, kept, sigma_rad, ~is_cut)
        bank.update(places, replace(sights, covariance=doubt[:, None, None] * sights.covariance))

    def _sigmas_rad(self, places: Places, rays: Sequence[Ray]) -> tuple[FloatArray, FloatArray]:
        """Without what lies beyond the border (k, 2), and with it (k, 2)."""
        aim_rad, cut_rad = self.looks.aim_sigma_rad(places, rays), self.looks.cut_sigma_rad(places, rays)
        self._is_cut[places] = cut_rad > aim_rad
        return aim_rad, np.hypot(aim_rad, cut_rad)

    def _aspect(self, place: int) -> Aspect:
        aspect = self._aspects[place]
        assert aspect is not None
        return aspect
