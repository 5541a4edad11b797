"""From a segment and a pose to a sight: the direction in which something is seen, and how sure that direction is."""

from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np

from distloc.geometry.camera import Camera
from distloc.geometry.rotations import skew
from distloc.sights.sight import Sight
from distloc.types import CameraPose, Detection, FloatArray, PoseErrors

_CUT_SHARE = 0.05  # of the image's width: how far off the middle may be of something cut that nobody has seen whole


@dataclass(frozen=True)
class Ray:
    """A detection's aim point through the lens: axes (3, 3) as a sight's, their tangents' derivative by the pixel.

    The segment's foot is `below_tangent` times the distance on the map under the aim point.
    """

    pose: CameraPose
    detection: Detection
    axes: FloatArray
    by_pixel: FloatArray
    cut_px: float
    below_tangent: float

    @cached_property
    def px_rad(self) -> float:
        """The angle of a pixel there, at the most."""
        return float(np.linalg.norm(self.by_pixel, ord=2))

    @cached_property
    def size_px(self) -> FloatArray:
        """Width and height (2,) of the segment."""
        return size_px(self.detection)


def size_px(detection: Detection) -> FloatArray:
    """Width and height (2,) of a segment."""
    return np.array([detection.width_px, detection.height_px])


def ray_of(camera: Camera, pose: CameraPose, detection: Detection, aim: Literal["centre", "base"]) -> Ray:
    """What all tracks share of a detection."""
    pixel = detection.base_px if aim == "base" else bisector_px(camera, detection.centre_px, size_px(detection))
    step_px = 0.5
    pixels = pixel[:, None] + step_px * np.array([[0.0, 1.0, -1.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0, -1.0]])
    rays = pose.R_cam_from_enu.T @ camera.rays(pixels)
    axes = axes_along(rays[:, 0])
    seen = axes @ rays
    tangents = seen[:2] / seen[2]
    by_pixel = (tangents[:, 1::2] - tangents[:, 2::2]) / (2.0 * step_px)
    foot = pose.R_cam_from_enu.T @ camera.rays(detection.base_px[:, None])[:, 0]
    below = _elevation_tangent(rays[:, 0]) - _elevation_tangent(foot)
    return Ray(pose, detection, axes, by_pixel, _CUT_SHARE * camera.width, below)


def bisector_px(camera: Camera, centre_px: FloatArray, size_px: FloatArray) -> FloatArray:
    """Where the middle ray (2,) between the edges of a segment of `size_px` (2,) about `centre_px` (2,) goes through.

    The lens stretches what is off its axis, so the pixel midway between the edges is not midway between their rays:
    for a round plume of width w at range r that makes the range w^2 / 4r too small, whatever the number of frames.
    """
    half = size_px / 2.0
    edges = centre_px[:, None] + np.array([[-half[0], half[0], 0.0, 0.0], [0.0, 0.0, -half[1], half[1]]])
    rays = camera.rays(edges)
    middles = np.stack([rays[:, 0] + rays[:, 1], rays[:, 2] + rays[:, 3]], axis=1)
    pixels, _ = camera.project(middles)
    middle = np.array([pixels[0, 0], pixels[1, 1]])
    # beyond the lens' model an edge's ray may be anything
    return middle if (np.abs(middle - centre_px) <= half).all() else centre_px


def sight_of(
    ray: Ray, errors: PoseErrors, pixel_sigma_px: float, range_m: float, expected_size_px: FloatArray | None
) -> Sight:
    """The sight of a ray by a track that is about `range_m` away and expects a width and height (2,).

    An edge that moved against what is expected moved the middle by half of it. A segment that touches the border ends
    nobody knows where: its middle is in doubt by half its size, or by more while nothing was seen whole (None).
    """
    detection = ray.detection
    size_px = ray.size_px
    variances_px2 = np.full(2, detection.sigma_px**2 + pixel_sigma_px**2)
    if expected_size_px is not None:
        variances_px2 += np.square((size_px - expected_size_px) / 2.0)
    if detection.touches_border:
        in_doubt_px = size_px / 2.0 if expected_size_px is not None else np.maximum(size_px, ray.cut_px)
        variances_px2 += np.square(in_doubt_px)
    white = errors.attitude_white_rad**2 + (errors.position_m / max(range_m, 1.0)) ** 2
    covariance = ray.by_pixel * variances_px2 @ ray.by_pixel.T + white * np.eye(2)
    return Sight(ray.pose.stamp_s, ray.pose.position_enu_m, ray.axes, covariance)


def _elevation_tangent(ray_enu: FloatArray) -> float:
    return float(ray_enu[2] / max(float(np.hypot(ray_enu[0], ray_enu[1])), 1e-6))


def axes_along(ray_enu: FloatArray) -> FloatArray:
    """A sight's axes (3, 3): rows right (level), up and along a unit vector (3,)."""
    level = np.array([ray_enu[1], -ray_enu[0], 0.0])
    length = float(np.linalg.norm(level))
    right = level / length if length > 1e-6 else np.array([1.0, 0.0, 0.0])
    return np.array([right, skew(right) @ ray_enu, ray_enu])
