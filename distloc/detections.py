"""From a mask to detections: connected components with what a tracker needs of each."""

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from distloc.camera import Camera
from distloc.types import Detection, MaskArray

MIN_AREA_PX = 12  # of the mask's own pixels; a target of 100 m at 30 km is 4 x 4 px at f = 1200
MAX_DETECTIONS = 32
_BASE_BAND = 0.15  # the lowest share of a segment's pixels that gives its base: robust against single pixels


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
    """Up to 32 segments of a mask, the largest first; segments under 12 of the mask's pixels are left out."""
    pixels, scale = checked_mask(mask, camera)
    x, y, width, height = cv2.boundingRect(pixels)
    if width == 0:
        return []
    crop = np.ascontiguousarray(pixels[y : y + height, x : x + width])
    count, labelled, table, _ = cv2.connectedComponentsWithStats(crop, connectivity=8)
    labels, stats = np.asarray(labelled, dtype=np.int32), np.asarray(table, dtype=np.int32)
    order = np.argsort(-stats[1:count, cv2.CC_STAT_AREA], kind="stable")[:MAX_DETECTIONS] + 1
    return [
        _detection(labels, stats[label], int(label), (x, y), scale, camera)
        for label in order
        if stats[label, cv2.CC_STAT_AREA] >= MIN_AREA_PX
    ]


def joined(pieces: Sequence[Detection]) -> Detection:
    """One detection of pieces of the same thing: their common bounding box, the foot of the lowest."""
    sizes = np.array([[one.width_px, one.height_px] for one in pieces])
    centres = np.array([one.centre_px for one in pieces])
    low, high = (centres - sizes / 2.0).min(axis=0), (centres + sizes / 2.0).max(axis=0)
    areas = np.maximum([one.area_px for one in pieces], 1e-6)
    middle = areas @ centres / areas.sum()
    spread = np.stack([one.covariance_px2 + np.outer(one.centre_px - middle, one.centre_px - middle) for one in pieces])
    return Detection(
        centre_px=(low + high) / 2.0,
        base_px=max(pieces, key=lambda one: float(one.base_px[1])).base_px,
        covariance_px2=np.tensordot(areas / areas.sum(), spread, axes=1),
        area_px=float(areas.sum()),
        width_px=float(high[0] - low[0]),
        height_px=float(high[1] - low[1]),
        sigma_px=max(one.sigma_px for one in pieces),
        touches_border=any(one.touches_border for one in pieces),
    )


def _detection(
    labels: NDArray[np.int32], stats: NDArray[np.int32], label: int, corner: tuple[int, int], scale: int, camera: Camera
) -> Detection:
    left, top, width, height, area = (int(value) for value in stats)
    rows, columns = np.nonzero(labels[top : top + height, left : left + width] == label)
    offset = (scale - 1) / 2.0  # a coarse pixel's centre in the camera's pixels
    u = (columns + (left + corner[0])) * scale + offset
    v = (rows + (top + corner[1])) * scale + offset
    spread = np.stack([u - u.mean(), v - v.mean()])
    centre = np.array([u.min() + u.max(), v.min() + v.max()]) / 2.0
    band = v >= np.quantile(v, 1.0 - _BASE_BAND)
    base = np.array([u[band].mean(), v.max() + scale / 2.0])
    border = scale
    touches = bool(
        u.min() < border
        or v.min() < border
        or u.max() > camera.width - 1 - border
        or v.max() > camera.height - 1 - border
    )
    return Detection(
        centre_px=centre,
        base_px=base,
        covariance_px2=spread @ spread.T / area + np.eye(2) * scale**2 / 12.0,
        area_px=float(area * scale**2),
        width_px=float(width * scale),
        height_px=float(height * scale),
        sigma_px=float(scale) / np.sqrt(12.0) + 0.02 * float(np.hypot(width, height)) * scale,
        touches_border=touches,
    )
