"""From a mask to detections: connected components with what a tracker needs of each."""

import math
from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from distloc.geometry.camera import Camera
from distloc.sights.components import Component, largest_components
from distloc.sights.feet import plumes_of
from distloc.sights.root import foot_of
from distloc.types import Detection, MaskArray, Root

MIN_AREA_PX = 12  # of the mask's own pixels; a target of 100 m at 30 km is 4 x 4 px at f = 1200
MAX_DETECTIONS = 96
_ROOT_SIGMA = 0.02  # of its width: how far its middle is off, where it does not jump about


def checked_mask(mask: MaskArray, camera: Camera) -> tuple[NDArray[np.uint8], int]:
    """The mask as contiguous uint8 (h, w), and the whole number of camera pixels to each of its own.

    Raises ValueError unless it is 2-D and the camera's size or an exact fraction of it.
    """
    if mask.ndim == 2 and mask.dtype in (np.uint8, np.bool_) and mask.shape[0] > 0 and mask.shape[1] > 0:
        height, width = mask.shape
        scale = camera.width // width
        if scale >= 1 and width * scale == camera.width and height * scale == camera.height:
            return np.ascontiguousarray(mask).view(np.uint8), scale
    raise ValueError(
        f"mask must be bool or uint8 of {camera.height} x {camera.width} or an exact fraction of it, "
        f"got {mask.dtype} {mask.shape}"
    )


def detections_from_mask(mask: MaskArray, camera: Camera) -> list[Detection]:
    """Up to 96 plumes of a mask, those in the largest segments first; under 12 of the mask's pixels are left out."""
    pixels, scale = checked_mask(mask, camera)
    segments = largest_components(pixels, MIN_AREA_PX, MAX_DETECTIONS)
    plumes = [plume for segment in segments for plume in plumes_of(segment, MIN_AREA_PX)]
    return [_detection(one, scale, camera) for one in plumes[:MAX_DETECTIONS]]


def joined(pieces: Sequence[Detection]) -> Detection:
    """One detection of pieces of the same thing: their common bounding box, the foot of the lowest."""
    sizes = np.array([[one.width_px, one.height_px] for one in pieces])
    centres = np.array([one.centre_px for one in pieces])
    low, high = (centres - sizes / 2.0).min(axis=0), (centres + sizes / 2.0).max(axis=0)
    areas = np.maximum([one.area_px for one in pieces], 1e-6)
    middle = areas @ centres / areas.sum()
    lowest = max(pieces, key=lambda one: float(one.base_px[1]))
    cut = [one for one in pieces if one.touches_border]
    spread = np.stack([one.covariance_px2 + np.outer(one.centre_px - middle, one.centre_px - middle) for one in pieces])
    return Detection(
        centre_px=(low + high) / 2.0,
        base_px=lowest.base_px,
        covariance_px2=np.tensordot(areas / areas.sum(), spread, axes=1),
        area_px=float(areas.sum()),
        width_px=float(high[0] - low[0]),
        height_px=float(high[1] - low[1]),
        sigma_px=max(one.sigma_px for one in pieces),
        touches_border=bool(cut),
        is_cut=(any(one.is_cut[0] for one in cut), any(one.is_cut[1] for one in cut)),
        is_base_cut=lowest.is_base_cut if lowest.touches_border else (False, False),
        root=lowest.root,
    )


def _detection(component: Component, scale: int, camera: Camera) -> Detection:
    pixels, area = component.pixels, component.area
    height, width = pixels.shape
    offset = (scale - 1) / 2.0  # a coarse pixel's centre in the camera's pixels
    left, top = component.left * scale + offset, component.top * scale + offset
    right, bottom = left + (width - 1) * scale, top + (height - 1) * scale
    moments = cv2.moments(pixels)
    xx, xy, yy = (moments[name] / area * scale**2 for name in ("mu20", "mu11", "mu02"))
    within_a_pixel = scale**2 / 12.0
    foot = foot_of(pixels)
    is_left, is_right = left < scale, right > camera.width - 1 - scale
    is_top, is_bottom = top < scale, bottom > camera.height - 1 - scale
    is_base_beside = (is_left and foot.is_at_left) or (is_right and foot.is_at_right)
    return Detection(
        centre_px=np.array([(left + right) / 2.0, (top + bottom) / 2.0]),
        base_px=np.array([left + foot.middle * scale, bottom + scale / 2.0]),
        covariance_px2=np.array([[xx + within_a_pixel, xy], [xy, yy + within_a_pixel]]),
        area_px=float(area * scale**2),
        width_px=float(width * scale),
        height_px=float(height * scale),
        sigma_px=scale / math.sqrt(12.0) + 0.02 * math.hypot(width, height) * scale,
        touches_border=is_left or is_right or is_top or is_bottom,
        is_cut=(is_left or is_right, is_top or is_bottom),
        is_base_cut=(is_base_beside, is_bottom),
        root=Root(foot.width * scale, (1.0 / math.sqrt(12.0) + _ROOT_SIGMA * foot.width) * scale, foot.lean),
    )
