"""Where a point of the landscape is seen, worked out slowly and in another way than the renderer's."""

import numpy as np

from distloc.geometry.camera import Camera
from distloc.geometry.rotations import R_cam_from_enu, matrix_from_euler
from distloc.simulation.landscape.terrain import Terrain
from distloc.types import CameraPose, FloatArray

CAMERA = Camera(640, 360, 450.0, 450.0, 320.0, 180.0, (-0.1, 0.02, 0.0, 0.0, 0.0))
_STEP_M = 4.0
_FAR_M = 12_000.0


def pose_at(
    east_m: float, north_m: float, up_m: float = 120.0, angles_deg: tuple[float, ...] = (0, -8, 0)
) -> CameraPose:
    """A camera at a place with a yaw, pitch and roll."""
    R = R_cam_from_enu(matrix_from_euler(*np.radians(angles_deg)), np.eye(3))
    return CameraPose(10.0, np.array([east_m, north_m, up_m]), R)


def height(terrain: Terrain, east: FloatArray, north: FloatArray) -> FloatArray:
    """The ground's height at lists of places, in their shape."""
    shape, flat = east.shape, np.zeros((2, -(-east.size // 4096) * 4096), np.float32)
    flat[0, : east.size], flat[1, : east.size] = east.ravel(), north.ravel()
    return np.asarray(terrain.height_m(*flat.reshape(2, -1, 4096)).ravel()[: east.size].reshape(shape), np.float64)


def met(terrain: Terrain, pose: CameraPose, pixels: FloatArray, camera: Camera = CAMERA) -> FloatArray:
    """The places (3, N) that pixels (2, N) show: small steps along each ray, then bisection. NaN for the sky."""
    rays = pose.R_cam_from_enu.T @ camera.rays(pixels)
    start = pose.position_enu_m[:, None]

    def above(way_m: FloatArray) -> FloatArray:
        places = start[..., None] + rays[..., None] * way_m
        return places[2] - height(terrain, places[0], places[1])

    ways = np.arange(0.0, _FAR_M, _STEP_M)
    is_under = above(np.broadcast_to(ways, (rays.shape[1], ways.size))) < 0.0
    first = np.where(is_under.any(axis=1), is_under.argmax(axis=1), 0)
    low, high = ways[np.maximum(first - 1, 0)], ways[first]
    for _ in range(30):
        middle = 0.5 * (low + high)
        is_over = above(middle[:, None])[:, 0] >= 0.0
        low, high = np.where(is_over, middle, low), np.where(is_over, high, middle)
    return np.where(is_under.any(axis=1), start + rays * high, np.nan)


def seen(pose: CameraPose, places: FloatArray, camera: Camera = CAMERA) -> FloatArray:
    """The pixels (2, N) of places (3, N)."""
    return camera.project(pose.R_cam_from_enu @ (places - pose.position_enu_m[:, None]))[0]
