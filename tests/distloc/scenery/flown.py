"""A simulated flight with corner tracks and wrong poses, for the tests of the scenery."""

from dataclasses import dataclass, replace

import numpy as np

from distloc.geometry.camera import Camera
from distloc.geometry.rotations import matrix_from_rotation_vector
from distloc.scenery.corners import Corners, mended
from distloc.simulation.corners import SimulatedCorners, landscape_points
from distloc.simulation.errors import GaussMarkov
from distloc.simulation.flights import Flight, Geometry, flight_past
from distloc.types import CameraPose, FloatArray, PoseErrors

CAMERA = Camera(1280, 720, 900.0, 900.0, 639.5, 359.5)
TOLD = PoseErrors(
    heading_bias_rad=float(np.radians(2.0)),
    tilt_bias_rad=float(np.radians(0.5)),
    attitude_white_rad=float(np.radians(0.1)),
    position_m=0.1,
    bias_time_constant_s=120.0,
)


@dataclass(frozen=True)
class Keyframe:
    """The reported pose, the corners, and what the report is wrong by (6,): attitude about ENU, position."""

    pose: CameraPose
    corners: Corners
    error: FloatArray


def flown(
    seed: int,
    geometry: Geometry = "perpendicular",
    *,
    heading_deg: float = 2.0,
    range_m: float = 2000.0,
    steps: int = 45,
    corners: int = 40,
    focal: float = 0.0,
    radial: float = 0.0,
) -> list[Keyframe]:
    """`focal` is the share by which the true focal length is longer than the camera's, `radial` what its k1 is more."""
    rng = np.random.default_rng(seed)
    length_m = 0.5 * range_m
    flight: Flight = flight_past(
        geometry, np.array([0.0, range_m, 80.0]), range_m, length_m, length_m / steps, 120.0, wobble_rad=0.02, seed=seed
    )
    path = np.stack([flight.pose_at(stamp_s).position_enu_m for stamp_s in flight.stamps_s], axis=1)
    true_camera = mended(CAMERA, focal, radial)
    scenery = SimulatedCorners(true_camera, landscape_points(rng, path), rng, most=corners)
    sigmas = np.array([TOLD.tilt_bias_rad, TOLD.tilt_bias_rad, np.radians(heading_deg)])
    attitude = GaussMarkov(sigmas, TOLD.bias_time_constant_s, rng)
    place = GaussMarkov(np.full(3, TOLD.position_bias_m), TOLD.bias_time_constant_s, rng)
    frames = []
    for stamp_s in flight.stamps_s:
        true = flight.pose_at(stamp_s)
        attitude.advance(stamp_s)
        place.advance(stamp_s)
        theta = attitude.value + TOLD.attitude_white_rad * rng.standard_normal(3)
        off_m = place.value + TOLD.position_m * rng.standard_normal(3)
        pose = replace(
            true,
            position_enu_m=true.position_enu_m + off_m,
            R_cam_from_enu=true.R_cam_from_enu @ matrix_from_rotation_vector(-theta),
        )
        frames.append(Keyframe(pose, scenery.at(true), np.concatenate([theta, off_m])))
    return frames
