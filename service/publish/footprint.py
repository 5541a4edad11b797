"""What the camera sees of flat ground at the height of the autopilot's first position."""

import numpy as np

from distloc.geometry.camera import Camera
from distloc.geometry.geodesy import LocalFrame
from distloc.types import CameraPose

_MAX_RANGE_M = 30_000.0


def footprint(pose: CameraPose, camera: Camera, frame_enu: LocalFrame) -> tuple[tuple[float, float], ...]:
    """(lon, lat) in degrees of the image's four corners on the ground; rays above the horizon end at 30 km."""
    u = np.array([0.0, camera.width - 1.0, camera.width - 1.0, 0.0])
    v = np.array([camera.height - 1.0, camera.height - 1.0, 0.0, 0.0])
    rays_enu = pose.R_cam_from_enu.T @ camera.rays(np.stack([u, v]))
    corners = []
    for ray in rays_enu.T:
        distance_m = _MAX_RANGE_M if ray[2] >= -1e-6 else min(max(pose.position_enu_m[2], 0.0) / -ray[2], _MAX_RANGE_M)
        lat, lon, _ = frame_enu.geodetic_from_enu(pose.position_enu_m + ray * distance_m)
        corners.append((round(lon, 8), round(lat, 8)))
    return tuple(corners)
