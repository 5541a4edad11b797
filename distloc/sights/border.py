"""What a root that the picture's left or right border cuts tells: its uncut edge, beyond which the fire is.

The edge is a limit on one side. How much lies beyond the border nobody sees, but it has a size: that of the root, and,
where the smoke comes in over the border, what it has drifted since it rose, some of its height times its lean. Taken
as exponential, so that a mean and a standard deviation of the same size hold 95 % of it on the far side, and a fire
right at the border is one standard deviation nearer.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from distloc.geometry.camera import Camera
from distloc.types import Detection, FloatArray

_LEAST_SHARE = 0.01  # of the picture's width: a sliver says nothing of the size
_OF_HEIGHT = 0.25  # of the smoke's height: what is seen may be the flank of a plume alone
_DRIFTED = 0.5  # of the height that is seen: how far down it goes on beyond the border
_LEANS_IN = 0.2  # less than that is how its outline widens
_MOSTLY = 0.5  # of a root
_JUMPS = 0.1  # of what may be hidden: the edge's from frame to frame


@dataclass(frozen=True, slots=True)
class Border:
    """A root cut at the right (`side` 1) or left (-1): its uncut edge, how wide it is at least, what may be hidden.

    All in pixels: the edge's column, the width that is seen, the scale of what is beyond, how far down the foot may go
    on, and how the edge jumps about.
    """

    side: float
    edge_px: float
    width_px: float
    scale_px: float
    below_px: float
    jumps_px: float


def border_of(detection: Detection, camera: Camera, aim: Literal["centre", "base"]) -> Border | None:
    """That of a segment; None where no side cuts its root, or both do, and where the middle is aimed at."""
    root = detection.root
    if aim == "centre" or root is None or not detection.touches_border or not detection.is_base_cut[0]:
        return None
    left, right = detection.centre_px[0] + np.array([-0.5, 0.5]) * detection.width_px
    off_left, off_right = left + 0.5, camera.width - 0.5 - right
    coarse = 0.01 * camera.width
    if off_left < coarse and off_right < coarse:
        return None
    side = 1.0 if off_right < off_left else -1.0
    width_px = min(root.width_px * math.hypot(1.0, root.lean), detection.width_px)
    inwards = max(-side * root.lean, 0.0)
    drifted_px = _DRIFTED * inwards * detection.height_px
    scale_px = max(width_px, _LEAST_SHARE * camera.width, _OF_HEIGHT * detection.height_px, drifted_px)
    return Border(
        side=side,
        edge_px=(camera.width - 0.5 if side > 0.0 else -0.5) - side * width_px,
        width_px=width_px,
        scale_px=scale_px,
        below_px=_DRIFTED * detection.height_px * min(inwards / _LEANS_IN, 1.0) / 2.0,
        jumps_px=_JUMPS * scale_px,
    )


def seen_rad_of(borders: Sequence[Border | None], px_rad: FloatArray) -> FloatArray:
    """How wide k roots look at least, and what may be hidden (k, 2), by the angles (k,) of a pixel; NaN of others."""
    seen_px = [(np.nan, np.nan) if one is None else (one.width_px, one.scale_px) for one in borders]
    return np.asarray(np.array(seen_px) * px_rad[:, None])


def beyond(
    borders: Sequence[Border | None], px_rad: FloatArray, known_rad: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """How far right of k uncut edges the roots' middles are (k,), and one standard deviation (k,); 0 of others.

    `known_rad` (k, 3) is how wide they look at least and what may be hidden, as was seen of late, and how wide they
    looked when they were whole; NaN where nobody knows. One that was seen whole, and of which half is seen now, hides
    no more than the rest.
    """
    if not any(borders):
        return np.zeros(len(borders)), np.zeros(len(borders))
    seen, whole = seen_rad_of(borders, px_rad), known_rad[:, 2]
    width, scale = np.where(np.isnan(known_rad[:, :2]), seen, known_rad[:, :2]).T
    is_known = seen[:, 0] > _MOSTLY * whole
    width = np.where(is_known, np.fmax(whole, seen[:, 0]), width)
    scale = np.where(is_known, _MOSTLY * whole, scale)
    sides = np.array([0.0 if one is None else one.side for one in borders])
    is_cut = sides != 0.0
    return np.where(is_cut, sides * (width + scale) / 2.0, 0.0), np.where(is_cut, scale / 2.0, 0.0)
