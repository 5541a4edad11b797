"""From a segment and a pose to a sight: the direction in which something is seen, and how sure that direction is."""

from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np

from distloc.geometry.camera import Camera
from distloc.geometry.rotations import skew
from distloc.sights.sight import Sight
from distloc.types import CameraPose, Detection, FloatArray, PoseErrors

_RAGGED_SHARE = 0.5  # of its size: how far the middle of a part is beside that of the whole, where it leans nowhere
_CUT_SHARE = 0.05  # of the image's width: how far off the middle may be of something cut that nobody has seen whole


@dataclass(frozen=True)
class Ray:
    """A detection's aim point through the lens: axes (3, 3) as a sight's, their tangents' derivative by the pixel.

    The segment's foot is `foot_tangent` times the distance on the map above the camera, `below_tangent` times that
    under the aim point. `is_cut` says which axes of what is aimed at, across and upright, the image's border cuts;
    `cut_px` is how far its middle may be off at least.
    """

    pose: CameraPose
    detection: Detection
    axes: FloatArray
    by_pixel: FloatArray
    is_cut: tuple[bool, bool]
    cut_px: float
    below_tangent: float
    foot_tangent: float

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
    foot_tangent = _elevation_tangent(foot)
    below_tangent = _elevation_tangent(rays[:, 0]) - foot_tangent
    is_cut = detection.is_base_cut if aim == "base" else detection.is_cut
    is_cut = is_cut if detection.touches_border else (False, False)
    return Ray(pose, detection, axes, by_pixel, is_cut, _CUT_SHARE * camera.width, below_tangent, foot_tangent)


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

    An edge that moved against what is expected moved the middle by half of it; what the border cuts is told of apart.
    """
    detection = ray.detection
    size_px = ray.size_px
    variances_px2 = np.full(2, detection.sigma_px**2 + pixel_sigma_px**2)
    if expected_size_px is not None:
        variances_px2 += np.where(ray.is_cut, 0.0, np.square((size_px - expected_size_px) / 2.0))
    white = errors.attitude_white_rad**2 + (errors.position_m / max(range_m, 1.0)) ** 2
    covariance = ray.by_pixel * variances_px2 @ ray.by_pixel.T + white * np.eye(2)
    return Sight(ray.pose.stamp_s, ray.pose.position_enu_m, ray.axes, covariance)


def cut_of(ray: Ray, expected_size_px: FloatArray | None) -> tuple[FloatArray, FloatArray]:
    """Of what the border cuts: the covariance (2, 2) of its middle along the segment, and a sigma (2,) across it.

    What is cut along one axis goes on along the segment's own: its middle is off by half of what is missing, or by its
    size while nothing was seen whole (None). Across, the middle of a part is not quite that of the whole. Both are 0
    where nothing is cut; right and up, in tangents.
    """
    if not any(ray.is_cut):
        return np.zeros((2, 2)), np.zeros(2)
    size_px, shape_px2 = ray.size_px, ray.detection.covariance_px2
    off_px = np.maximum(size_px, ray.cut_px)
    if expected_size_px is not None:
        off_px = np.maximum(size_px, np.abs(expected_size_px - size_px)) / 2.0
    along_px2, across_px2 = np.zeros((2, 2)), np.zeros(2)
    for axis in np.flatnonzero(ray.is_cut):
        along_px = off_px[axis] * shape_px2[axis] / max(float(shape_px2[axis, axis]), 1e-6)
        along_px2 += np.outer(along_px, along_px)
        across_px2[1 - axis] = (_RAGGED_SHARE * size_px[1 - axis]) ** 2
    B = ray.by_pixel
    return B @ along_px2 @ B.T, np.sqrt(np.diag(B * across_px2 @ B.T))


def _elevation_tangent(ray_enu: FloatArray) -> float:
    return float(ray_enu[2] / max(float(np.hypot(ray_enu[0], ray_enu[1])), 1e-6))


def axes_along(ray_enu: FloatArray) -> FloatArray:
    """A sight's axes (3, 3): rows right (level), up and along a unit vector (3,)."""
    level = np.array([ray_enu[1], -ray_enu[0], 0.0])
    length = float(np.linalg.norm(level))
    right = level / length if length > 1e-6 else np.array([1.0, 0.0, 0.0])
    return np.array([right, skew(right) @ ray_enu, ray_enu])
