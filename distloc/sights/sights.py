"""From a segment and a pose to a sight: the direction in which something is seen, and how sure that direction is."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from distloc.geometry.camera import Camera
from distloc.sights.border import Border, beyond, border_of
from distloc.sights.sight import Sight, Sights
from distloc.types import CameraPose, Detection, FloatArray, PoseErrors

_RAGGED_SHARE = 0.5  # of its size: how far the middle of a part is beside that of the whole, where it leans nowhere
_MOST_LEAN = 4.0
SOMEWHERE_SHARE = 0.25  # of the size, one standard deviation: what holds 95 % then holds all of it
_LEAST_UPRIGHT = 0.42  # a sine: 25 degrees off straight down or up
_CUT_SHARE = 0.05  # of the image's width: how far off the middle may be of something cut that nobody has seen whole


@dataclass(frozen=True, slots=True)
class Ray:
    """A detection's aim point through the lens: axes (3, 3) as a sight's, their tangents' derivative by the pixel.

    The segment's foot is `foot_tangent` times the distance on the map above the camera, `below_tangent` times that
    under the aim point; `px_rad` is the angle of a pixel there, at the most; `size_px` the segment's width and height
    (2,). `aim_px` is the size (2,) of what is aimed at, the whole segment or its root, and `sigma_px` one standard
    deviation of its middle; `lean` is how far the smoke over the root goes to the right for each step up. `is_cut` says
    which axes of what is aimed at, across and upright, the image's border cuts; `cut_px` is how far its middle may be
    off at least. A root that a side cuts has a `border`, and then its uncut edge is the aim point.
    """

    pose: CameraPose
    detection: Detection
    axes: FloatArray
    by_pixel: FloatArray
    px_rad: float
    size_px: FloatArray
    aim_px: FloatArray
    sigma_px: float
    lean: float
    is_cut: tuple[bool, bool]
    cut_px: float
    below_tangent: float
    foot_tangent: float
    border: Border | None = None


@dataclass(frozen=True, slots=True)
class Expected:
    """What k tracks expect of their targets' segments.

    How far the targets are (k,), the width and height (k, 2), NaN where nothing was seen whole, and the variance
    (k, 2), right and up in squared tangents, by which their segments stray. `border_rad` (k, 3) is how wide their roots
    are and what may be beyond the border that cuts them, and how wide they looked when they were whole; NaN while
    nobody knows.
    """

    range_m: FloatArray
    size_px: FloatArray
    scatter: FloatArray
    border_rad: FloatArray

    def white(self, errors: PoseErrors) -> FloatArray:
        """The variance (k,) of a frame's own errors, in squared tangents."""
        position = np.square(errors.position_m / np.maximum(self.range_m, 1.0))
        return np.asarray(errors.attitude_white_rad**2 + position)

    def chosen(self, which: NDArray[np.intp]) -> "Expected":
        """Some of them, any as often as it comes."""
        return Expected(self.range_m[which], self.size_px[which], self.scatter[which], self.border_rad[which])


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
    if aim == "base" and not stands_upright(pose):
        detections = [_without_root(one) for one in detections]
    k = len(detections)
    sizes_px = np.array([(one.width_px, one.height_px) for one in detections])
    bases_px = np.array([one.base_px for one in detections])
    borders = [border_of(one, camera, aim) for one in detections]
    aims_px = bases_px
    if aim == "centre":
        aims_px = bisectors_px(camera, np.array([one.centre_px for one in detections]), sizes_px)
    elif any(borders):
        edges_px = [base if one is None else one.edge_px for one, base in zip(borders, bases_px[:, 0], strict=True)]
        aims_px = np.column_stack([edges_px, bases_px[:, 1]])
    step_px = 0.5
    steps_px = step_px * np.array([[0.0, 0.0], [1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]])
    pixels = np.concatenate([(aims_px[:, None] + steps_px).reshape(-1, 2), bases_px])
    rays = camera.rays(pixels.T).T @ pose.R_cam_from_enu
    around, feet = rays[: 5 * k].reshape(k, 5, 3), rays[5 * k :]
    axes = axes_along(around[:, 0])
    seen = around @ axes.swapaxes(1, 2)
    tangents = seen[:, :, :2] / seen[:, :, 2:]
    by_pixel = ((tangents[:, 1::2] - tangents[:, 2::2]) / (2.0 * step_px)).swapaxes(1, 2)
    # the larger singular value
    squared, area = np.square(by_pixel).sum(axis=(1, 2)), np.linalg.det(by_pixel)
    px_rad = np.sqrt((squared + np.sqrt(np.maximum(squared**2 - 4.0 * area**2, 0.0))) / 2.0).tolist()
    foot = _elevation_tangent(feet)
    below, foot = (_elevation_tangent(around[:, 0]) - foot).tolist(), foot.tolist()
    cut_px = _CUT_SHARE * camera.width
    roots = [one.root for one in detections]
    leans = _leans(np.array([0.0 if root is None else root.lean for root in roots]), by_pixel)
    leans = np.where([root is None for root in roots], 0.0, leans).tolist()
    return [
        Ray(
            pose=pose,
            detection=one,
            axes=axes[i],
            by_pixel=by_pixel[i],
            px_rad=px_rad[i],
            size_px=sizes_px[i],
            aim_px=sizes_px[i] if aim == "centre" or one.root is None else np.full(2, one.root.width_px),
            sigma_px=_sigma_px(one, borders[i], aim),
            lean=leans[i],
            is_cut=_is_cut(one, aim),
            cut_px=cut_px,
            below_tangent=below[i],
            foot_tangent=foot[i],
            border=borders[i],
        )
        for i, one in enumerate(detections)
    ]


def stands_upright(pose: CameraPose) -> bool:
    """Whether smoke stands on its lowest rows in the picture: not where this is rolled or looks straight down."""
    right, down, _ = (-pose.R_cam_from_enu[:, 2]).tolist()
    return bool(down >= abs(right) and math.hypot(right, down) >= _LEAST_UPRIGHT)


def _sigma_px(detection: Detection, border: Border | None, aim: Literal["centre", "base"]) -> float:
    if aim == "centre" or detection.root is None:
        return detection.sigma_px
    return detection.root.sigma_px if border is None else math.hypot(detection.root.sigma_px, border.jumps_px)


def _without_root(one: Detection) -> Detection:
    return one if one.root is None else replace(one, root=None, base_px=one.centre_px, is_base_cut=one.is_cut)


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
    """The sights of k rays of one frame, each by a track; what the border cuts is told of apart."""
    variances_px2 = _middles_px2(rays, expected.size_px, pixel_sigma_px)
    by_pixel = np.array([one.by_pixel for one in rays])
    covariance = by_pixel * variances_px2[:, None, :] @ by_pixel.swapaxes(1, 2)
    covariance[:, [0, 1], [0, 1]] += expected.white(errors)[:, None] + expected.scatter
    pose, axes = rays[0].pose, np.array([one.axes for one in rays])
    borders = [one.border for one in rays]
    if any(borders):
        right, _ = beyond(borders, np.array([one.px_rad for one in rays]), expected.border_rad)
        along = axes[:, 2] + right[:, None] * axes[:, 0]
        is_moved = (right != 0.0)[:, None, None]
        axes = np.where(is_moved, axes_along(along / np.linalg.norm(along, axis=1)[:, None]), axes)
    return Sights(pose.stamp_s, pose.position_enu_m, axes, covariance)


def cuts_of(rays: Sequence[Ray], expected_px: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Of what the border cuts: the covariance (k, 2, 2) of its middle along the segment, a sigma (k, 2) across it.

    What is cut along one axis goes on along the segment's own: its middle is off by half of what is missing, or by its
    size while nothing was seen whole (NaN). Across, the middle of a part is not quite that of the whole. Both are 0
    where nothing is cut; right and up, in tangents.
    """
    if not any(any(one.is_cut) for one in rays):
        return np.zeros((len(rays), 2, 2)), np.zeros((len(rays), 2))
    along_px, across_px2 = _beyond_px(rays, expected_px)
    by_pixel = np.array([one.by_pixel for one in rays])
    along = by_pixel @ along_px.swapaxes(1, 2)
    return along @ along.swapaxes(1, 2), np.sqrt((np.square(by_pixel) @ across_px2[:, :, None])[:, :, 0])


def most_off_px(rays: Sequence[Ray], expected_px: FloatArray, pixel_sigma_px: float) -> FloatArray:
    """One standard deviation (t, k), at the most, of the middles of k segments, t tracks expecting a size (t, 2) each.

    What is cut is in it.
    """
    variance_px2 = _middles_px2(rays, expected_px[:, None], pixel_sigma_px).max(axis=2)
    if any(any(one.is_cut) for one in rays):
        along_px, across_px2 = _beyond_px(rays, expected_px[:, None])
        variance_px2 = variance_px2 + np.square(along_px).sum(axis=(2, 3)) + across_px2.max(axis=1)
        hidden_px = [one.border.width_px + one.border.scale_px if one.border else 0.0 for one in rays]
        variance_px2 = variance_px2 + np.square(hidden_px)
    return np.asarray(np.sqrt(variance_px2))


def _middles_px2(rays: Sequence[Ray], expected_px: FloatArray, pixel_sigma_px: float) -> FloatArray:
    """The variances (..., k, 2) of the middles of k rays' segments, expected to be so large (..., k or 1, 2).

    An edge that moved against what is expected moved the middle by half of it, unless the border cuts it.
    """
    size_px, is_cut = np.array([one.size_px for one in rays]), np.array([one.is_cut for one in rays])
    is_cut |= np.array([one.detection.is_cut if one.detection.touches_border else (False, False) for one in rays])
    sigma_px = np.array([one.sigma_px for one in rays])[:, None]
    off_px = np.where(is_cut | np.isnan(expected_px), 0.0, (size_px - expected_px) / 2.0)
    return np.asarray(sigma_px**2 + pixel_sigma_px**2 + np.square(off_px))


def _beyond_px(rays: Sequence[Ray], expected_px: FloatArray) -> tuple[FloatArray, FloatArray]:
    """How far the middles may be off along the segments, a row (..., k, 2, 2) for each axis that is cut, else 0.

    And the variance (k, 2) across. The segments are expected to be so large (..., k or 1, 2).
    """
    size_px, is_cut = np.array([one.size_px for one in rays]), np.array([one.is_cut for one in rays])
    is_sided = np.array([one.border is not None for one in rays])
    is_cut[is_sided, 0] = False  # that is told by its uncut edge
    below_px = np.array([one.border.below_px if one.border else 0.0 for one in rays])
    shape_px2 = np.array([one.detection.covariance_px2 for one in rays])
    least_px = np.maximum(size_px, np.array([one.cut_px for one in rays])[:, None])
    missing_px = np.maximum(size_px, np.abs(expected_px - size_px)) / 2.0
    off_px = is_cut * np.where(np.isnan(expected_px), least_px, missing_px)
    slopes = shape_px2 / np.maximum(np.diagonal(shape_px2, axis1=1, axis2=2), 1e-6)[:, :, None]
    ragged_px2 = is_cut[:, ::-1] * np.square(_RAGGED_SHARE * np.array([one.aim_px for one in rays]))
    ragged_px2[:, 1] += np.square(below_px)
    return off_px[..., None] * slopes, ragged_px2


def sight_of(
    ray: Ray, errors: PoseErrors, pixel_sigma_px: float, range_m: float, expected_size_px: FloatArray | None
) -> Sight:
    """The same of one ray, by a track that is about `range_m` away and expects a width and height (2,)."""
    expected = Expected(np.array([range_m]), _sizes(expected_size_px), np.zeros((1, 2)), np.full((1, 3), np.nan))
    return sights_of([ray], expected, errors, pixel_sigma_px).one(0)


def _sizes(expected_size_px: FloatArray | None) -> FloatArray:
    return np.full((1, 2), np.nan) if expected_size_px is None else expected_size_px[None]


def _is_cut(detection: Detection, aim: Literal["centre", "base"]) -> tuple[bool, bool]:
    is_cut = detection.is_base_cut if aim == "base" else detection.is_cut
    return is_cut if detection.touches_border else (False, False)


def _leans(leans: FloatArray, by_pixel: FloatArray) -> FloatArray:
    """Of the pictures' (k,), right for each step up, in the world's."""
    right, up = (by_pixel[:, :, 0] * leans[:, None] - by_pixel[:, :, 1]).T
    return np.asarray(np.clip(right / np.maximum(up, 1e-9), -_MOST_LEAN, _MOST_LEAN))


def _elevation_tangent(rays_enu: FloatArray) -> FloatArray:
    """Of rays (k, 3)."""
    return np.asarray(rays_enu[:, 2] / np.maximum(np.hypot(rays_enu[:, 0], rays_enu[:, 1]), 1e-6))


def axes_along(rays_enu: FloatArray) -> FloatArray:
    """Sights' axes (k, 3, 3): rows right (level), up and along unit vectors (k, 3)."""
    east, north, up = rays_enu.T
    level = np.hypot(east, north)
    is_up = level <= 1e-6
    scale = 1.0 / np.where(is_up, 1.0, level)
    axes = np.zeros((len(rays_enu), 3, 3))
    axes[:, 0, 0], axes[:, 0, 1] = np.where(is_up, 1.0, scale * north), np.where(is_up, 0.0, -scale * east)
    axes[:, 1, 0], axes[:, 1, 1] = axes[:, 0, 1] * up, -axes[:, 0, 0] * up
    axes[:, 1, 2] = axes[:, 0, 0] * north - axes[:, 0, 1] * east
    axes[:, 2] = rays_enu
    return axes
