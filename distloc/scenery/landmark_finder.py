"""Finds landmarks of known place in frames by how they look: a template that the operator cut from a frame.

Searched for by normalised cross-correlation, at a few scales, where the pose and its covariance say that it must be;
taken where the best place stands out from the second best. From then on it is found again in each frame near where
the pose's motion puts it, by the template at the scale of its range: that does not drift, nor slide along a mast.
Once it was not found for some time, or where what was found is doubted, it is searched for at all scales as at first.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from distloc.geometry.camera import Camera
from distloc.scenery.corner_tracker import Grey, grey_of, tracked_size
from distloc.scenery.corners import KnownCorners
from distloc.types import BoolArray, CameraPose, FloatArray, MaskArray

_SIGMAS = 3.0  # of the pose, about where it must be
_LEAST_REACH_RAD = 0.03  # so that one whose place is wrong is seen, and told
_MARGIN_PX, _FOLLOWED_PX = 6, 8
_MOST_PX = 240  # from the middle of what is searched
_SCALES = 2.0 ** (np.arange(-3, 4) / 3.0)  # of the template while nothing is known of its range
_FINER = 2.0 ** (np.arange(-1, 2) / 6.0)  # about the scale that its range tells
_LEAST_SCORE, _LEAST_FOLLOWED = 0.75, 0.7  # correlation
_STANDS_OUT = 0.1  # of the best place from the second best
_LEAST_SIDE_PX = 7
_SEARCH_S = 0.5  # apart: a search costs as much as following all corners
_LATELY_S = 2.0  # since it was found: a match that was false comes seldom again
_SIGMA_PX = 0.7


@dataclass(frozen=True, slots=True)
class _Match:
    """Where the template's middle (2,) is, how well it correlates there and at the next best place."""

    pixel: FloatArray
    score: float
    second: float
    scale: float


class LandmarkFinder:
    """One template (h, w) of grey levels for each landmark, of the full-size image; fixed memory."""

    def __init__(self, camera: Camera, templates: Sequence[NDArray[np.uint8]]) -> None:
        self._camera, self._templates = camera, [np.asarray(one, dtype=np.uint8) for one in templates]
        self._by, self._size = tracked_size(camera)
        most = len(self._templates)
        self._pixels, self._expected = np.full((most, 2), np.nan), np.full((most, 2), np.nan)
        self._scale_m = np.full(most, np.nan)  # scale times range where it was last found
        self._found_s = np.full(most, -np.inf)  # and when
        self._is_doubted: BoolArray = np.zeros(most, dtype=np.bool_)
        self._searched_s, self._turn = -np.inf, 0

    def forget(self) -> None:
        """The next frame has none before it."""
        self._pixels.fill(np.nan)
        self._found_s.fill(-np.inf)

    def doubt(self, which: BoolArray) -> None:
        """These (m,), and no others, seem to be something else: followed on, to be told, and searched for as well."""
        self._is_doubted = which

    def find(
        self,
        image: NDArray[np.uint8],
        pose: CameraPose,
        places_enu_m: FloatArray,
        sigma_rad: float,
        smoke: MaskArray | None = None,
    ) -> KnownCorners:
        """The landmarks at (m, 3) in a frame (H, W, 3) or (H, W), none of them in the smoke (h, w).

        `pose` is the best that is known, `sigma_rad` one standard deviation of its attitude about the worst axis.
        """
        grey = grey_of(image, self._size)
        lines_m = places_enu_m - pose.position_enu_m
        pixels, in_view = self._camera.project(pose.R_cam_from_enu @ lines_m.T)
        expected, before = (pixels.T + 0.5) / self._by - 0.5, self._expected
        ranges_m = np.maximum(np.linalg.norm(lines_m, axis=1), 1.0)
        matches: dict[int, _Match] = {}
        for i in np.flatnonzero(in_view & np.isfinite(self._pixels).all(axis=1)).tolist():
            near = self._pixels[i] + expected[i] - before[i]
            if (match := self._followed(i, grey, near, float(ranges_m[i]))) is not None:
                matches[i] = match
        is_lost = np.array([i not in matches for i in range(in_view.size)], dtype=np.bool_)
        if (which := self._next(in_view & (is_lost | self._is_doubted), pose.stamp_s)) is not None:
            reach_px = (
                max(_SIGMAS * sigma_rad, _LEAST_REACH_RAD) * max(self._camera.fx, self._camera.fy) / self._by
                + _MARGIN_PX
            )
            reach_px = min(reach_px, _MOST_PX)
            is_known = 0.0 <= pose.stamp_s - self._found_s[which] <= _LATELY_S and not self._is_doubted[which]
            scales = self._scale_m[which] / ranges_m[which] * _FINER if is_known else _SCALES
            if (match := self._searched(which, grey, expected[which], reach_px, scales)) is not None:
                matches[which] = match
        matches = {i: one for i, one in sorted(matches.items()) if not self._is_hidden(one.pixel, smoke)}
        self._pixels, self._expected = np.full_like(self._pixels, np.nan), expected
        for i, one in matches.items():
            self._pixels[i], self._scale_m[i], self._found_s[i] = one.pixel, one.scale * ranges_m[i], pose.stamp_s
        found = np.array(list(matches), dtype=np.int64)
        coarse = self._camera.width / min(image.shape[1], self._size[0])
        full_px = (self._pixels[found].T + 0.5) * self._by - 0.5
        return KnownCorners(found, full_px, np.full(found.size, _SIGMA_PX * coarse), places_enu_m[found])

    def outside(self, known: KnownCorners, smoke: MaskArray) -> KnownCorners:
        """Those of a frame's landmarks that are not in its smoke (h, w), found later; the others are given up."""
        tracked_px = (known.pixels.T + 0.5) / self._by - 0.5
        is_hidden = np.array([self._is_hidden(one, smoke) for one in tracked_px], dtype=np.bool_)
        if not is_hidden.any():
            return known
        self._pixels[known.names[is_hidden]] = np.nan
        free = ~is_hidden
        return KnownCorners(known.names[free], known.pixels[:, free], known.sigma_px[free], known.places_enu_m[free])

    def _next(self, wanted: BoolArray, stamp_s: float) -> int | None:
        """Whose turn it is to be searched for, where it is time for that."""
        if not wanted.any() or 0.0 <= stamp_s - self._searched_s < _SEARCH_S:
            return None
        self._searched_s = stamp_s
        order = (self._turn + np.arange(wanted.size)) % wanted.size
        which = int(order[wanted[order]][0])
        self._turn = which + 1
        return which

    def _followed(self, i: int, grey: Grey, near: FloatArray, range_m: float) -> _Match | None:
        match = self._matched(i, grey, near, _FOLLOWED_PX, float(self._scale_m[i]) / range_m)
        return match if match is not None and match.score > _LEAST_FOLLOWED else None

    def _searched(self, i: int, grey: Grey, near: FloatArray, reach_px: float, scales: FloatArray) -> _Match | None:
        matches = [self._matched(i, grey, near, reach_px, float(scale)) for scale in scales]
        best = max((one for one in matches if one is not None), key=lambda one: one.score, default=None)
        if best is None or best.score < _LEAST_SCORE or best.score - best.second < _STANDS_OUT:
            return None
        return best

    def _matched(self, i: int, grey: Grey, near: FloatArray, reach_px: float, scale: float) -> _Match | None:
        """The best place within reach of a pixel; None where the template does not fit into the image there."""
        template = self._templates[i]
        width, height = (round(side * scale / self._by) for side in template.shape[::-1])
        if not np.isfinite(near).all() or min(width, height) < _LEAST_SIDE_PX:
            return None
        low = np.floor(near - reach_px - [width / 2.0, height / 2.0]).astype(int)
        high = np.ceil(near + reach_px + [width / 2.0, height / 2.0]).astype(int) + 1
        (left, top), (right, bottom) = np.maximum(low, 0), np.minimum(high, self._size)
        if right - left <= width or bottom - top <= height:
            return None
        scaled = cv2.resize(
            template, (width, height), interpolation=cv2.INTER_AREA if scale < self._by else cv2.INTER_LINEAR
        )
        scores = cv2.matchTemplate(grey[top:bottom, left:right], scaled, cv2.TM_CCOEFF_NORMED)
        scores = np.where(np.isfinite(scores) & (np.abs(scores) <= 1.001), scores, -1.0)
        v, u = np.unravel_index(int(scores.argmax()), scores.shape)
        score = float(scores[v, u])
        offset = np.array([_peak(scores[v, :], int(u)), _peak(scores[:, u], int(v))])
        scores[max(v - height // 2, 0) : v + height // 2 + 1, max(u - width // 2, 0) : u + width // 2 + 1] = -1.0
        middle = np.array([left + u + (width - 1) / 2.0, top + v + (height - 1) / 2.0])
        return _Match(middle + offset, score, float(scores.max()), scale)

    def _is_hidden(self, pixel: FloatArray, smoke: MaskArray | None) -> bool:
        """Whether there is smoke (h, w), of any size, where its middle is."""
        if smoke is None or not smoke.size:
            return False
        at = (pixel + 0.5) / self._size * smoke.shape[::-1]
        u, v = np.clip(at.astype(int), 0, np.array(smoke.shape[::-1]) - 1)
        return bool(smoke[v, u])


def _peak(scores: NDArray[Any], at: int) -> float:
    """How far from a place the top of the parabola through it and its neighbours is, up to half a pixel."""
    if not 0 < at < scores.size - 1:
        return 0.0
    before, here, after = scores[at - 1 : at + 2]
    bend = before - 2.0 * here + after
    return float(np.clip(0.5 * (before - after) / bend, -0.5, 0.5)) if bend < -1e-12 else 0.0
