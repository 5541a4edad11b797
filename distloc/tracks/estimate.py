"""What is reported of a target after a step; its track calls it."""

from typing import Literal

import numpy as np

from distloc.filter.moments import Cloud
from distloc.filter.uncertainty import grown
from distloc.tracks.life import TrackLife
from distloc.tracks.motion.motion import Verdict
from distloc.tracks.place import Place
from distloc.types import AttitudeError, Extent, FloatArray, PoseErrors, TargetEstimate, TargetState

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
    cloud: Cloud,
    place: Place,
    extent: Extent,
    also_m2: FloatArray,
    up_m2: float,
    is_over: bool,
    motion: Verdict,
    aim: Literal["centre", "base"],
    attitude: AttitudeError | None,
    errors: PoseErrors,
) -> TargetEstimate:
    """The parts put together; what the cloud lacks is `also_m2` (2, 2) on the ground, east and north, `up_m2` above."""
    covariance_enu_m2 = cloud.covariance_enu_m2.copy()
    covariance_enu_m2[:2, :2] += also_m2
    covariance_enu_m2[2, 2] += up_m2
    return TargetEstimate(
        id=life.id,
        state=TargetState.DISMISSED if is_over else life.state,
        position_enu_m=place.position_enu_m,
        covariance_enu_m2=covariance_enu_m2,
        ellipse95=place.ellipse95,
        vertical95_m=place.vertical95_m,
        region95=grown(place.ellipse95, extent.width_m / 2.0),
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
        attitude="autopilot" if attitude is None else attitude.source,
        heading_sigma_rad=errors.heading_bias_rad,
    )
