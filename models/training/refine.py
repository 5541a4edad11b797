"""A rough outline of smoke becomes a mask: GrabCut finds its edge within a band; `draw_masks.py` calls it."""

import cv2
import numpy as np
from numpy.typing import NDArray

from outlines import Outlined, drawn_clear, drawn_smoke

_INSIDE, _OUTSIDE = 0.008, 0.005  # of the width: how far within and without the outline the smoke's edge may lie
_LEAST_PX = 2.0  # both, in small frames
_SHARE = 0.5  # of half a part's thickness, at most: so that a thin base is neither lost nor made twice as thick
_SURROUNDINGS = 0.08  # of the width: what is round the smoke tells what no smoke looks like
_ROUNDS = 4  # of GrabCut


def mask_from_outline(image: NDArray[np.uint8], outlined: Outlined) -> NDArray[np.uint8]:
    """Where the smoke of a BGR image (H, W, 3) is, 255 in (H, W), else 0: the outline, its edge found by GrabCut.

    The edge moves within a band along the outline only, and never into a part that was drawn as clear.
    """
    height, width = image.shape[:2]
    drawn = drawn_smoke(outlined, height, width)
    if not drawn.any():
        return drawn
    labels = _labels(drawn, width)
    labels[drawn_clear(outlined, height, width) > 0] = cv2.GC_BGD
    view = _surroundings(drawn, width)
    part = labels[view].copy()
    if (part == cv2.GC_BGD).any():  # else all that is seen is smoke
        smooth = cv2.GaussianBlur(image[view], (0, 0), 1.0)
        cv2.setRNGSeed(0)  # GrabCut's clusters begin at random
        cv2.grabCut(smooth, part, (0, 0, 0, 0), np.zeros((1, 65)), np.zeros((1, 65)), _ROUNDS, cv2.GC_INIT_WITH_MASK)
    mask = np.zeros_like(drawn)
    mask[view] = np.where(np.isin(part, (cv2.GC_FGD, cv2.GC_PR_FGD)), 255, 0)
    calm = cv2.medianBlur(mask, 5)  # no single pixels along the edge
    mask = np.where(labels == cv2.GC_FGD, 255, np.where(labels == cv2.GC_BGD, 0, calm)).astype(np.uint8)
    _, parts = cv2.connectedComponents(mask)
    mask[~np.isin(parts, np.unique(parts[labels == cv2.GC_FGD]))] = 0  # nor any beside it
    return mask


def _labels(drawn: NDArray[np.uint8], width: int) -> NDArray[np.uint8]:
    """GrabCut's labels (H, W): sure beyond the band along the outline, open within it."""
    inside, outside = (max(_LEAST_PX, share * width) for share in (_INSIDE, _OUTSIDE))
    within = np.asarray(cv2.distanceTransform(drawn, cv2.DIST_L2, cv2.DIST_MASK_PRECISE), dtype=np.float32)
    without, nearest = cv2.distanceTransformWithLabels(
        1 - drawn, cv2.DIST_L2, cv2.DIST_MASK_5, labelType=cv2.DIST_LABEL_PIXEL
    )
    radius = _half_thickness(drawn, within, max(inside, outside) / _SHARE)
    of_label = np.zeros(int(nearest.max()) + 1, np.float32)
    of_label[nearest[drawn > 0]] = radius[drawn > 0]
    is_smoke = within >= np.minimum(inside, _SHARE * radius)
    is_open = without <= np.minimum(outside, _SHARE * of_label[nearest])
    labels = np.where(is_smoke, cv2.GC_FGD, cv2.GC_PR_FGD)
    return np.where(drawn > 0, labels, np.where(is_open, cv2.GC_PR_BGD, cv2.GC_BGD)).astype(np.uint8)


def _half_thickness(drawn: NDArray[np.uint8], within: NDArray[np.float32], most: float) -> NDArray[np.float32]:
    """For each pixel drawn the radius of the largest disc drawn that covers it, in whole pixels up to `most`.

    `within` is how far each lies from what is not drawn.
    """
    radius = (drawn > 0).astype(np.float32)
    for size in range(2, int(min(within.max(), np.ceil(most))) + 1):
        beside = cv2.distanceTransform((within < size).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
        radius[(beside < size) & (drawn > 0)] = size
    return radius


def _surroundings(drawn: NDArray[np.uint8], width: int) -> tuple[slice, slice]:
    """The rows and columns of the smoke and what is round it."""
    x, y, w, h = cv2.boundingRect(drawn)
    margin = round(_SURROUNDINGS * width)
    return slice(max(0, y - margin), y + h + margin), slice(max(0, x - margin), x + w + margin)
