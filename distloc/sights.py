"""From a segment and a pose to a sight: the direction in which something is seen, and how sure that direction is."""

from typing import Literal

import numpy as np

from distloc.calibrated_filter import Sight
from distloc.camera import Camera
from distloc.types import CameraPose, Detection, FloatArray, PoseErrors

_UP = np.array([0.0, 0.0, 1.0])


def sight_of(
    camera: Camera,
    pose: CameraPose,
    errors: PoseErrors,
    detection: Detection,
    aim: Literal["centre", "base"],
    pixel_sigma_px: float,
    range_m: float,
    size_change_px: FloatArray,
) -> Sight:
    """The sight of a detection's aim point; `range_m` is about how far it is: nearer, the position's error counts more.

    `size_change_px` (2,) is by how much width and height differ from what was expected: an edge that moved by so much
    moved the centre by half of it. A segment that touches the border ends nobody knows where: by half its size.
    """
    pixel = detection.base_px if aim == "base" else detection.centre_px
    variances_px2 = detection.sigma_px**2 + pixel_sigma_px**2 + np.square(size_change_px / 2.0)
    if detection.touches_border:
        variances_px2 = variances_px2 + np.square([detection.width_px / 2.0, detection.height_px / 2.0])
    # the ray and its derivative by the pixel, through the lens
    step_px = 0.5
    pixels = pixel[:, None] + step_px * np.array([[0.0, 1.0, -1.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0, -1.0]])
    rays = pose.R_cam_from_enu.T @ camera.rays(pixels)
    axes = _axes(rays[:, 0])
    tangents = (axes @ rays)[:2] / (axes @ rays)[2]
    by_pixel = np.stack([tangents[:, 1] - tangents[:, 2], tangents[:, 3] - tangents[:, 4]], axis=1) / (2.0 * step_px)
    white = errors.attitude_white_rad**2 + (errors.position_m / max(range_m, 1.0)) ** 2
    covariance = by_pixel * variances_px2 @ by_pixel.T + white * np.eye(2)
    return Sight(pose.stamp_s, pose.position_enu_m, axes, covariance)


def _axes(ray_enu: FloatArray) -> FloatArray:
    """Rows right (level), up and along a unit vector."""
    level = np.cross(ray_enu, _UP)
    length = float(np.linalg.norm(level))
    right = level / length if length > 1e-6 else np.array([1.0, 0.0, 0.0])
    return np.stack([right, np.cross(right, ray_enu), ray_enu])
