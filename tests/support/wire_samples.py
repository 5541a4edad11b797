"""Targets that the tests of the publishers share."""

import numpy as np

from distloc.types import CameraPose, Ellipse, Extent, Plume, TargetEstimate, TargetState
from service.common.messages import Geodetic, LocatedTarget, VehicleState


def located(
    target_id: int = 3,
    state: TargetState = TargetState.CONFIRMED,
    semi_major_m: float = 180.0,
    lat_deg: float = 47.42774,
    lon_deg: float = 8.60559,
    range_m: float = 4100.0,
) -> LocatedTarget:
    """A target 4 km east of the origin."""
    estimate = TargetEstimate(
        id=target_id,
        state=state,
        position_enu_m=np.array([4000.0, 0.0, 100.0]),
        covariance_enu_m2=np.diag([5400.0, 600.0, 100.0]),
        ellipse95=Ellipse(semi_major_m, 60.0, np.radians(90.0)),
        vertical95_m=19.6,
        region95=Ellipse(220.0, 100.0, np.radians(90.0)),
        extent=Extent(40.0, 4.0, 80.0, 8.0),
        range_m=range_m,
        range95_m=(3900.0, 4300.0),
        bearing_rad=np.radians(-270.0),
        existence=0.98,
        observations=12,
        misses=1,
        baseline_m=350.0,
        first_seen_s=10.0,
        last_seen_s=20.0,
        degraded=("clock",),
        aim="base",
        motion="unresolved",
        plume=Plume(np.array([4030.0, 10.0, 160.0]), np.radians(25.0), np.radians(-280.0)),
    )
    place = Geodetic(lat_deg, lon_deg, 512.3456)
    return LocatedTarget(
        estimate,
        place,
        560.1,
        0,
        7,
        1_800_000_000.9996,
        "gps",
        1.8e9 - 20.0,
        1.8e9,
        ("link", "clock"),
        Geodetic(47.42776, 8.60561, 572.3),
    )


def vehicle() -> VehicleState:
    """At the origin, 100 m up, looking east and level: x right is south, y down, z east."""
    R_cam_from_enu = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]])
    pose = CameraPose(20.0, np.array([0.0, 0.0, 100.0]), R_cam_from_enu)
    return VehicleState(1.8e9, "gps", Geodetic(47.4, 8.55, 500.0), 90.0, pose, ())
