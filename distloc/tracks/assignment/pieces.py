"""The pieces of a target whose segment is in parts; the tracker asks."""

from collections.abc import Collection, Sequence

import numpy as np

from distloc.sights.detections import joined
from distloc.sights.sights import Ray, size_px
from distloc.tracks.expected import is_within
from distloc.tracks.looks.sightings import MUCH_LARGER
from distloc.types import FloatArray

_WHOLE = 0.75  # of the expected size


def pieces_of(
    pixel: FloatArray, expected_px: FloatArray, rays: Sequence[Ray], own: int, used: Collection[int]
) -> set[int]:
    """Those of the rays' segments that make a target's whole again, with its own; none where they would make more.

    It is expected at a pixel (2,), so large (2,), in pixels; NaN where nobody knows. What is used is another's.
    """
    if np.isnan(expected_px[0]) or np.isnan(pixel[0]) or (rays[own].size_px >= _WHOLE * expected_px).all():
        return set()  # it lacks nothing: what is beside it is something else
    pieces = {
        i
        for i, ray in enumerate(rays)
        if i not in used and is_within(ray.detection.centre_px, pixel, MUCH_LARGER * expected_px - ray.size_px)
    }
    if not pieces:
        return set()
    whole = joined([rays[index].detection for index in (own, *pieces)])
    return pieces if (size_px(whole) <= MUCH_LARGER * expected_px).all() else set()
