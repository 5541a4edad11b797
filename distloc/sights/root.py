"""A segment's root: the narrow foot of a plume, where the fire is, and how the smoke leans over it."""

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

_HIGH = 0.5  # of its mean width: a root is as high as that,
_LEAST, _MOST = 0.01, 0.15  # if it has at least and at most so much of the segment's pixels
_OVER = 0.2  # of the segment's height over the root: there the lean is measured, at least a root's height
_MOST_LEAN = 4.0


@dataclass(frozen=True, slots=True)
class Foot:
    """In pixels of the segment's box: the middle at its lower edge, from the box' left, and the width across the lean.

    `lean` is how far the smoke over it goes to the right for each pixel up. Whether it is at the box' left and right.
    """

    middle: float
    width: float
    lean: float
    is_at_left: bool
    is_at_right: bool


def foot_of(pixels: NDArray[np.uint8]) -> Foot:
    """Of a component's pixels (h, w), 1 where they are.

    A root is half as high as it is wide, whatever the plume's size: less tells little of it, more is smoke on its way.
    """
    height = pixels.shape[0]
    counts: list[int] = cv2.reduce(pixels, 1, cv2.REDUCE_SUM, dtype=cv2.CV_32S)[::-1, 0].tolist()
    total, area, rise = sum(counts), 0, 0
    for count in counts:
        area += count
        rise += 1
        if area >= _MOST * total or (rise * rise >= _HIGH * area and area >= _LEAST * total):
            break
    band = pixels[height - rise :]
    middle = _middle(band)
    over = pixels[max(height - rise - max(rise, round(_OVER * height)), 0) : height - rise]
    lean = 0.0
    if over.size:
        moved = _middle(over) - middle
        lean = min(max(2.0 * moved / (rise + over.shape[0]), -_MOST_LEAN), _MOST_LEAN)
    # as far back as the smoke leans, never beyond the lowest pixels
    left, _, across, _ = cv2.boundingRect(band)
    foot = min(max(middle - lean * rise / 2.0, left), left + across - 1.0)
    width = area / rise / math.hypot(1.0, lean)
    return Foot(foot, width, lean, left == 0, left + across == pixels.shape[1])


def _middle(band: NDArray[np.uint8]) -> float:
    moments = cv2.moments(band)
    return float(moments["m10"] / moments["m00"])
