"""What is reported of all targets after a step; the tracker asks."""

from collections.abc import Container, Sequence

import numpy as np

from distloc.filter.bank import Bank
from distloc.filter.ground import Ground
from distloc.filter.turning import covariances_m2
from distloc.tracks.estimates.place import beside_of, places_of
from distloc.tracks.looks.looks import Looks
from distloc.tracks.looks.plume import plumes_of
from distloc.tracks.motion.heading_scale import HeadingScale
from distloc.tracks.motion.motion import judge
from distloc.tracks.target_track import Track
from distloc.types import CameraPose, Plume, PoseErrors, TargetEstimate

_JUDGED_AT_ONCE = 2  # how targets move is judged of so many in a step


def estimates_of(
    told: Sequence[Track],
    seen: Container[Track],
    bank: Bank,
    looks: Looks,
    pose: CameraPose,
    errors: PoseErrors,
    ground: Ground,
) -> list[TargetEstimate]:
    """Of at least one track that has a life; some were seen in this step."""
    at, beliefs = np.array([track.filter.place for track in told]), [track.belief for track in told]
    clouds = bank.particles.clouds
    turning_m2 = covariances_m2([one.views.all for one in beliefs], clouds.mean_enu_m[at], errors)
    also_m2 = np.array([track.also_m2(pose, one, errors) for track, one in zip(told, turning_m2, strict=True)])
    beside = beside_of(looks, [one.motion for one in beliefs], clouds, at, pose.stamp_s, also_m2, ground)
    places = places_of(bank.particles, at, pose.position_enu_m, beside)
    plumes: Sequence[Plume | None] = [None] * len(told)
    if looks.aim == "base":
        rows, roots_enu_m = looks.latest[at], np.array([place.position_enu_m for place in places])
        plumes = plumes_of(looks.middles.off[rows], looks.camera_enu_m[rows], roots_enu_m, beside.lean)
    return [
        track.estimate(pose, place, plume, errors, track in seen)
        for track, place, plume in zip(told, places, plumes, strict=True)
    ]


def judge_motion(told: Sequence[Track], bank: Bank, looks: Looks, scale: HeadingScale) -> None:
    """Of some of the targets in each step, those never judged, then those judged longest ago."""
    due = [one for one in told if one.belief.motion.is_due]
    due = sorted(due, key=lambda one: (one.belief.motion.is_judged, -one.belief.motion.steps))[:_JUDGED_AT_ONCE]
    if not due:
        return
    at, motions = np.array([track.filter.place for track in due]), [track.belief.motion for track in due]
    about_m, scales = bank.particles.clouds.mean_enu_m[at, :2], np.array([scale.before(one) for one in motions])
    judge(motions, about_m, bank.aim_sigma_rad[at, 0], looks.appearance(at), scales)
    scale.weigh([one.belief.motion for one in told if one.is_plausible])
