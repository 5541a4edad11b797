"""What is reported of a target after a step; its track calls it."""

import math
from typing import Literal

import numpy as np

from distloc.filter.uncertainty import grown
from distloc.tracks.estimates.place import Place
from distloc.tracks.life import TrackLife
from distloc.tracks.motion.motion import Verdict
from distloc.types import AttitudeError, Extent, FloatArray, Plume, PoseErrors, TargetEstimate, TargetState

_AIM_SHARE = 0.06  # of its width: how far a plume's middle is from that of its outline, on average over the views


def beside_m2(errors: PoseErrors, extent: Extent, line_m: FloatArray) -> FloatArray:
    """Covariance (2, 2), east and north, of what no particle has, by the line (3,) from the camera: how far off the
    camera's place is, the focal length, and the smoke's middle.
    """
    aim_m, level_m = _AIM_SHARE * extent.width_m, line_m[:2]
    beside = (errors.position_bias_m**2 + aim_m**2) * np.eye(2) + errors.focal_sigma**2 * np.outer(level_m, level_m)
    return np.asarray(beside)


def estimate_of(
    life: TrackLife,
    place: Place,
    extent: Extent,
    plume: Plume | None,
    is_over: bool,
    motion: Verdict,
    aim: Literal["centre", "base"],
    attitude: AttitudeError | None,
    errors: PoseErrors,
) -> TargetEstimate:
    """The parts put together."""
    return TargetEstimate(
        id=life.id,
        state=TargetState.DISMISSED if is_over else life.state,
        position_enu_m=place.position_enu_m,
        covariance_enu_m2=place.covariance_enu_m2,
        ellipse95=place.ellipse95,
        vertical95_m=place.vertical95_m,
        region95=grown(place.ellipse95, reach_m(extent, plume, place.position_enu_m)),
        extent=extent,
        range_m=place.range_m,
        range95_m=place.range95_m,
        bearing_rad=place.bearing_rad,
        existence=life.existence,
        observations=life.observations,
        misses=life.misses,
        baseline_m=life.baseline_m,
        first_seen_s=life.first_seen_s,
        last_seen_s=life.last_seen_s,
        aim=aim,
        motion=motion,
        plume=plume,
        attitude="autopilot" if attitude is None else attitude.source,
        heading_sigma_rad=errors.heading_bias_rad,
    )


def reach_m(extent: Extent, plume: Plume | None, place_enu_m: FloatArray) -> float:
    """How far on the map a target's smoke reaches from its place (3,), along the line of sight as well."""
    if plume is None:
        return extent.width_m / 2.0
    away_m = math.hypot(*(plume.centre_enu_m - place_enu_m)[:2].tolist())
    return away_m + max(extent.width_m, extent.height_m * min(math.tan(plume.lean_rad), 4.0)) / 2.0
