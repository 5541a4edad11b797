"""What segments hide; the tracker asks."""

from collections.abc import Sequence
from typing import Literal

import numpy as np

from distloc.sights.sights import size_px
from distloc.tracks.expected import is_within
from distloc.types import Detection, FloatArray


def covering(pixel: FloatArray, detections: Sequence[Detection]) -> int | None:
    """The first of the detections that cover a pixel (2,)."""
    return next((i for i, one in enumerate(detections) if is_within(pixel, one.centre_px, size_px(one))), None)


def is_hidden(
    pixel: FloatArray, expected_px: FloatArray, detections: Sequence[Detection], aim: Literal["centre", "base"]
) -> bool:
    """Whether a segment touches what is expected, so large (2,), at a pixel (2,): smoke grows together."""
    if np.isnan(expected_px[0]):
        return False
    middle_px = pixel - [0.0, expected_px[1] / 2.0] if aim == "base" else pixel
    return any(is_within(middle_px, one.centre_px, size_px(one) + expected_px) for one in detections)
