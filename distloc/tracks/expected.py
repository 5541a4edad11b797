"""Where a target is expected in an image, and how surely; its track asks, and the tracker of what is in view."""

import numpy as np

from distloc.filter.calibrated_filter import CalibratedFilter
from distloc.filter.particles import Cloud
from distloc.geometry.camera import Camera
from distloc.geometry.rotations import skew
from distloc.types import CameraPose, FloatArray

_REACH_SIGMAS = 6.0
_VIEW_MARGIN = 0.02  # of the image's size: so near the border it may be out of view


def expected_pixels(cloud: Cloud, camera: Camera, poses: list[CameraPose]) -> FloatArray:
    """Where the cloud's mean is in the images (2, n) of n poses, the attitude's bias in; NaN behind a camera."""
    offsets_enu_m = cloud.mean_enu_m - np.array([pose.position_enu_m for pose in poses])
    turned_enu_m = offsets_enu_m + offsets_enu_m @ skew(cloud.bias_rad).T
    R_cam_from_enu = np.array([pose.R_cam_from_enu for pose in poses])
    pixels, _ = camera.project((R_cam_from_enu @ turned_enu_m[:, :, None])[:, :, 0].T)
    return pixels


def reach_px(
    filter_: CalibratedFilter, camera: Camera, pose: CameraPose, attitude_white_rad: float
) -> tuple[FloatArray, FloatArray]:
    """Least and greatest pixel (2,), (2,) at which the target can be: what lies outside need not be weighed."""
    offsets_enu_m = filter_.particles.reach_enu_m() - pose.position_enu_m[:, None]
    offsets_enu_m += skew(filter_.cloud.bias_rad) @ offsets_enu_m
    pixels, _ = camera.project(pose.R_cam_from_enu @ offsets_enu_m)
    seen = pixels[:, np.isfinite(pixels[0])]
    if seen.shape[1] == 0:
        return np.full(2, np.inf), np.full(2, -np.inf)
    slack_px = _REACH_SIGMAS * camera.fx * np.hypot(filter_.bias_sigma_rad, attitude_white_rad)
    return seen.min(axis=1) - slack_px, seen.max(axis=1) + slack_px


def range_sigma_m(cloud: Cloud, pose: CameraPose) -> float:
    """One standard deviation of the cloud along the line of sight."""
    along_enu = cloud.mean_enu_m - pose.position_enu_m
    along_enu = along_enu / max(float(np.linalg.norm(along_enu)), 1.0)
    return float(np.sqrt(max(float(along_enu @ cloud.covariance_enu_m2 @ along_enu), 0.0)))


def is_well_inside(pixel: FloatArray, camera: Camera) -> bool:
    """Whether a pixel (2,) is in the image and not at its very border."""
    size = np.array([camera.width, camera.height])
    return bool(((pixel >= _VIEW_MARGIN * size) & (pixel <= (1.0 - _VIEW_MARGIN) * size)).all())
