"""Target estimates by hand, for what only reads where they are, their state and how often they were seen."""

from distloc.types import Ellipse, Extent, FloatArray, TargetEstimate, TargetState


def estimate(
    id_: int,
    state: TargetState,
    position_enu_m: FloatArray,
    covariance_enu_m2: FloatArray,
    ellipse: Ellipse,
    observations: int,
) -> TargetEstimate:
    """At 1000 m, seen from the first frame on."""
    return TargetEstimate(
        id=id_,
        state=state,
        position_enu_m=position_enu_m,
        covariance_enu_m2=covariance_enu_m2,
        ellipse95=ellipse,
        vertical95_m=10.0,
        region95=ellipse,
        extent=Extent(1.0, 1.0, 1.0, 1.0),
        range_m=1000.0,
        range95_m=(900.0, 1100.0),
        bearing_rad=0.0,
        existence=0.9,
        observations=observations,
        misses=0,
        baseline_m=1.0,
        first_seen_s=0.0,
        last_seen_s=1.0,
    )
