"""What the tracks see in a step: how that looks is learnt, and the filters weigh it, all targets at once."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from distloc.filter.bank import Bank
from distloc.filter.particles import Places
from distloc.sights.sight import Sight, Sights
from distloc.sights.sights import Ray
from distloc.tracks.looks.aim_error import AimErrors
from distloc.tracks.target_track import Track
from distloc.types import FloatArray

MUCH_LARGER = 1.25  # than expected: what was seen before was a part
_OTHER_SIZE = 0.1  # change of the expected size in one step that moves the middle


@dataclass(frozen=True, slots=True)
class Seen:
    """A track's ray and its sight, how far that is from what is expected (2,), and the square by the covariance of it.

    The ray may be of pieces that were joined.
    """

    track: Track
    ray: Ray
    sight: Sight
    innovation: FloatArray
    squared: float
    is_joined: bool


def weigh(bank: Bank, aims: AimErrors, seen: Sequence[Seen]) -> None:
    """The tracks take what they see, at least one sighting, and their filters weigh it.

    Where the size that is expected jumps, the middle may have moved by half of that, and stay; a size that changes by
    little from step to step is that of a target seen from another side or from nearer.
    """
    looks, rays = aims.looks, [one.ray for one in seen]
    places = np.array([one.track.filter.place for one in seen])
    rows = looks.own[places]
    before_px = looks.sizes.expected_px[rows]
    looks.learn(places, rays, np.array([one.innovation for one in seen]), [one.sight for one in seen])
    looks.saw(places, rays, [one.is_joined for one in seen])
    is_whole = np.array([not ray.detection.touches_border for ray in rays])
    is_larger = is_whole & (np.array([ray.size_px for ray in rays]) > MUCH_LARGER * before_px).any(axis=1)
    is_hit = [one.track.hit(one.ray, one.squared, bool(so)) for one, so in zip(seen, is_larger, strict=True)]
    order = [index for index in np.argsort(places).tolist() if is_hit[index]]
    if not order:
        return
    hit = [seen[index] for index in order]
    aims.weigh(bank, places[order], [one.ray for one in hit], _told(bank, aims, places[order], hit))
    change_px = np.abs(looks.sizes.expected_px[rows] - before_px)
    is_other = (change_px > _OTHER_SIZE * before_px).any(axis=1)
    for index in order:
        if is_other[index]:
            seen[index].track.filter.doubt_aim(float(change_px[index].max()) / 2.0 * rays[index].px_rad)


def _told(bank: Bank, aims: AimErrors, places: Places, hit: Sequence[Seen]) -> Sights:
    """What the rays tell: of what is cut less than what was found, by what is expected by now."""
    told, is_cut = Sights.of([one.sight for one in hit]), np.array([any(one.ray.is_cut) for one in hit])
    if is_cut.any():
        pose, cut = hit[0].ray.pose, places[is_cut]
        range_m = np.linalg.norm(bank.particles.clouds.mean_enu_m[cut] - pose.position_enu_m, axis=1)
        expected = aims.looks.expected(cut, pose, range_m)
        rays = [one.ray for one in hit if any(one.ray.is_cut)]
        told.covariance[is_cut] = aims.looks.measured(rays, expected).covariance
    return told
