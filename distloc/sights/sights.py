"""From a segment and a pose to a sight: the direction in which something is seen, and how sure that direction is."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from distloc.geometry.camera import Camera
from distloc.sights.sight import Sight, Sights
from distloc.types import CameraPose, Detection, FloatArray, PoseErrors

_CUT_SHARE = 0.05  # of the image's width: how far off the middle may be of something cut that nobody has seen whole


@dataclass(frozen=True, slots=True)
class Ray:
    """A detection's aim point through the lens: axes (3, 3) as a sight's, their tangents' derivative by the pixel.

    The segment's foot is `below_tangent` times the distance on the map under the aim point; `px_rad` is the angle of a
    pixel there, at the most; `size_px` the segment's width and height (2,).
    """

    pose: CameraPose
    detection: Detection
    axes: FloatArray
    by_pixel: FloatArray
    px_rad: float
    size_px: FloatArray
    cut_px: float
    below_tangent: float


@dataclass(frozen=True, slots=True)
class Expected:
    """What k tracks expect of their targets' segments.

    How far the targets are (k,), the width and height (k, 2), NaN where nothing was seen whole, and the variance
    (k, 2), right and up in squared tangents, by which their segments stray.
    """

    range_m: FloatArray
    size_px: FloatArray
    scatter: FloatArray

    def white(self, errors: PoseErrors) -> FloatArray:
        """The variance (k,) of a frame's own errors, in squared tangents."""
        position = np.square(errors.position_m / np.maximum(self.range_m, 1.0))
        return np.asarray(errors.attitude_white_rad**2 + position)

    def chosen(self, which: NDArray[np.intp]) -> "Expected":
        """Some of them, any as often as it comes."""
        return Expected(self.range_m[which], self.size_px[which], self.scatter[which])


def size_px(detection: Detection) -> FloatArray:
    """Width and height (2,) of a segment."""
    return np.array([detection.width_px, detection.height_px])


def ray_of(camera: Camera, pose: CameraPose, detection: Detection, aim: Literal["centre", "base"]) -> Ray:
    """What all tracks share of a detection."""
    return rays_of(camera, pose, [detection], aim)[0]


def rays_of(
    camera: Camera, pose: CameraPose, detections: Sequence[Detection], aim: Literal["centre", "base"]
) -> list[Ray]:
    """The same of all detections of a frame."""
    if not detections:
        return []
    k = len(detections)
    sizes_px = np.array([(one.width_px, one.height_px) for one in detections])
    bases_px = np.array([one.base_px for one in detections])
    aims_px = bases_px
    if aim == "centre":
        aims_px = bisectors_px(camera, np.array([one.centre_px for one in detections]), sizes_px)
    step_px = 0.5
    steps_px = step_px * np.array([[0.0, 0.0], [1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]])
    pixels = np.concatenate([(aims_px[:, None] + steps_px).reshape(-1, 2), bases_px])
    rays = camera.rays(pixels.T).T @ pose.R_cam_from_enu
    around, feet = rays[: 5 * k].reshape(k, 5, 3), rays[5 * k :]
    axes = axes_along(around[:, 0])
    seen = around @ axes.swapaxes(1, 2)
    tangents = seen[:, :, :2] / seen[:, :, 2:]
    by_pixel = ((tangents[:, 1::2] - tangents[:, 2::2]) / (2.0 * step_px)).swapaxes(1, 2)
    px_rad = np.linalg.norm(by_pixel, ord=2, axis=(1, 2)).tolist()
    below = (_elevation_tangent(around[:, 0]) - _elevation_tangent(feet)).tolist()
    cut_px = _CUT_SHARE * camera.width
    return [
        Ray(pose, one, axes[i], by_pixel[i], px_rad[i], sizes_px[i], cut_px, below[i])
        for i, one in enumerate(detections)
    ]


def bisectors_px(camera: Camera, centres_px: FloatArray, sizes_px: FloatArray) -> FloatArray:
    """Where the middle rays (k, 2) between the edges of segments of `sizes_px` (k, 2) about `centres_px` go through.

    The lens stretches what is off its axis, so the pixel midway between the edges is not midway between their rays:
    for a round plume of width w at range r that makes the range w^2 / 4r too small, whatever the number of frames.
    """
    half = sizes_px / 2.0
    offsets = half[:, None] * np.array([[-1.0, 0.0], [1.0, 0.0], [0.0, -1.0], [0.0, 1.0]])
    rays = camera.rays((centres_px[:, None] + offsets).reshape(-1, 2).T).T.reshape(-1, 2, 2, 3)
    pixels, _ = camera.project(rays.sum(axis=2).reshape(-1, 3).T)
    middles = np.stack([pixels[0, ::2], pixels[1, 1::2]], axis=1)
    # beyond the lens' model an edge's ray may be anything
    is_between = (np.abs(middles - centres_px) <= half).all(axis=1, keepdims=True)
    return np.where(is_between, middles, centres_px)


def bisector_px(camera: Camera, centre_px: FloatArray, size_px: FloatArray) -> FloatArray:
    """The same of one segment (2,)."""
    return np.asarray(bisectors_px(camera, centre_px[None], size_px[None])[0])


def sights_of(rays: Sequence[Ray], expected: Expected, errors: PoseErrors, pixel_sigma_px: float) -> Sights:
    """The sights of k rays of one frame, each by a track."""
    variances_px2 = middles_px2(rays, expected.size_px, pixel_sigma_px)
    by_pixel = np.array([one.by_pixel for one in rays])
    covariance = by_pixel * variances_px2[:, None, :] @ by_pixel.swapaxes(1, 2)
    covariance[:, [0, 1], [0, 1]] += expected.white(errors)[:, None] + expected.scatter
    pose = rays[0].pose
    return Sights(pose.stamp_s, pose.position_enu_m, np.array([one.axes for one in rays]), covariance)


def middles_px2(rays: Sequence[Ray], expected_px: FloatArray, pixel_sigma_px: float) -> FloatArray:
    """The variances (..., k, 2) of the middles of k rays' segments, expected to be so large (..., k or 1, 2).

    An edge that moved against what is expected moved the middle by half of it. A segment that touches the border ends
    nobody knows where: its middle is in doubt by half its size, or by more while nothing was seen whole.
    """
    size_px = np.array([one.size_px for one in rays])
    of_segment = np.array([(one.detection.sigma_px, one.detection.touches_border, one.cut_px) for one in rays])
    sigma_px, is_cut, cut_px = of_segment.T[:, :, None]
    is_new = np.isnan(expected_px)
    off_px = np.where(is_new, 0.0, (size_px - expected_px) / 2.0)
    in_doubt_px = np.where(is_new, np.maximum(size_px, cut_px), size_px / 2.0)
    return np.asarray(sigma_px**2 + pixel_sigma_px**2 + np.square(off_px) + is_cut * np.square(in_doubt_px))


def sight_of(
    ray: Ray, errors: PoseErrors, pixel_sigma_px: float, range_m: float, expected_size_px: FloatArray | None
) -> Sight:
    """The sight of a ray by a track that is about `range_m` away and expects a width and height (2,)."""
    expected_px = np.full((1, 2), np.nan) if expected_size_px is None else expected_size_px[None]
    return sights_of([ray], Expected(np.array([range_m]), expected_px, np.zeros((1, 2))), errors, pixel_sigma_px).one(0)


def _elevation_tangent(rays_enu: FloatArray) -> FloatArray:
    """Of rays (k, 3)."""
    return np.asarray(rays_enu[:, 2] / np.maximum(np.hypot(rays_enu[:, 0], rays_enu[:, 1]), 1e-6))


def axes_along(rays_enu: FloatArray) -> FloatArray:
    """Sights' axes (k, 3, 3): rows right (level), up and along unit vectors (k, 3)."""
    level = np.stack([rays_enu[:, 1], -rays_enu[:, 0], np.zeros(len(rays_enu))], axis=1)
    length = np.linalg.norm(level, axis=1, keepdims=True)
    right = np.where(length > 1e-6, level / np.maximum(length, 1e-6), [1.0, 0.0, 0.0])
    return np.stack([right, np.cross(right, rays_enu), rays_enu], axis=1)
