"""Dirt on the lens, by all that the pictures show: where segments stay at a pixel while the camera shakes.

A place on the ground is seen in a direction that does not shake with the camera, also where a gimbal follows it; dirt
is seen at a pixel that does not. Each track asks so of its last sightings. But dirt loses its track, or hides a fire
that goes by behind it and is taken for that. So spots in the picture are remembered for the whole flight, whatever
track their segments go to, and what is known to be dirt goes to none. A platform has one memory.
"""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from distloc.geometry.camera import Camera
from distloc.types import BoolArray, CameraPose, Detection, FloatArray

MOST_SPOTS = 64
_NEAR_SHARE = 0.01  # of the picture's width
_OTHER_SIZE, _LEAST_PX = 1.5, 4.0  # times as large or small is another thing; what is smaller is taken as so large
_STILL_SHARE = 0.2  # of how a place on the ground would have shaken
_SHAKEN = 2.0  # times what each frame's own errors make of it,
_MOST_SHAKEN = 3.0  # and no one frame counts for more: where a reported heading jumps nothing shakes
_LEAST = 20  # second differences
_LATELY, _KEPT = 0.1, 0.99  # of the last sighting's pixel; of what was summed up before it
_OF_A_TRACK = 0.75  # of its last sightings: then all that it is is the spot


class Dirt:
    """At most `MOST_SPOTS` places in the picture, with how segments there shook in the picture and in the world.

    `seen` are the segments of the last frame that are dirt.
    """

    def __init__(self, camera: Camera, pixel_sigma_px: float) -> None:
        self._camera, self._pixel_sigma_px, self._near_px = camera, pixel_sigma_px, _NEAR_SHARE * camera.width
        self._place_px, self._size_px = np.full((MOST_SPOTS, 2), np.nan), np.ones((MOST_SPOTS, 2))
        self._pixels, self._along = np.zeros((MOST_SPOTS, 2, 2)), np.zeros((MOST_SPOTS, 2, 3))  # of the last two
        self._row, self._frame = np.zeros(MOST_SPOTS, np.int64), np.zeros(MOST_SPOTS, np.int64)  # frames in a row; last
        self._sums = np.zeros((MOST_SPOTS, 4))  # of squares in the picture and in the world, by their errors, how many
        self._frames = 0
        self.seen: list[Detection] = []

    def split(self, pose: CameraPose, detections: Sequence[Detection], white_rad: float) -> list[Detection]:
        """Those that are no known dirt, in their order; `white_rad` is each frame's own error of the attitude."""
        self._frames += 1
        segments = [index for index, one in enumerate(detections) if not (one.is_point or one.touches_border)]
        self.seen = []
        if not segments:
            return list(detections)
        centres_px = np.array([detections[index].centre_px for index in segments])
        sizes_px = np.array([(detections[index].width_px, detections[index].height_px) for index in segments])
        spots = self._spots_of(centres_px, sizes_px)
        is_held = spots >= 0
        rays = self._camera.rays(centres_px[is_held].T).T @ pose.R_cam_from_enu
        sigma_px = math.hypot(self._pixel_sigma_px, self._camera.fx * white_rad)
        self._take(spots[is_held], centres_px[is_held], sizes_px[is_held], rays, sigma_px)
        is_dirt = np.zeros(len(detections), np.bool_)
        is_dirt[segments] = is_held & self._is_dirt()[spots]
        self.seen = [one for one, so in zip(detections, is_dirt, strict=True) if so]
        return [one for one, so in zip(detections, is_dirt, strict=True) if not so]

    def is_all_of(self, seen_px: FloatArray, sizes_px: FloatArray) -> bool:
        """Whether a track that saw its target at these pixels, so large (m, 2), is of one spot of dirt."""
        is_dirt = self._is_dirt()
        if not (is_dirt.any() and seen_px.size):
            return False
        is_there = (np.abs(seen_px[:, None] - self._place_px[is_dirt]) <= self._near_px).all(axis=2)
        is_there &= _are_like(sizes_px[:, None], self._size_px[is_dirt])
        return bool(is_there.mean(axis=0).max() >= _OF_A_TRACK)

    def _is_dirt(self) -> BoolArray:
        in_image, in_world, by_errors, number = self._sums.T
        is_shaken = (number >= _LEAST) & (by_errors > _SHAKEN**2 * number)
        return np.asarray(is_shaken & (in_image < _STILL_SHARE**2 * in_world))

    def _spots_of(self, centres_px: FloatArray, sizes_px: FloatArray) -> NDArray[np.intp]:
        """The spot (k,) of each segment, the nearest that it may be, or a new one in the place of the least known.

        -1 where another segment is nearer to it, or there are more than spots.
        """
        off_px = np.abs(self._place_px - centres_px[:, None]).max(axis=2)
        is_like = (off_px <= self._near_px) & _are_like(sizes_px[:, None], self._size_px)
        off_px = np.where(is_like, off_px, np.inf)
        spots, nearest_px, best_px = off_px.argmin(axis=1), off_px.min(axis=1), np.full(MOST_SPOTS, np.inf)
        np.minimum.at(best_px, spots, nearest_px)
        is_new = np.isinf(nearest_px)
        is_held = ~is_new & (nearest_px <= best_px[spots])
        free = np.lexsort((self._frame, self._sums[:, 3]))
        free = free[~np.isin(free, spots[is_held])]
        new = np.flatnonzero(is_new)[: free.size]
        spots[~is_held] = -1
        spots[new] = at = free[: new.size]
        self._place_px[at], self._size_px[at] = centres_px[new], sizes_px[new]
        self._row[at], self._sums[at] = 0, 0.0
        return np.asarray(spots)

    def _take(
        self,
        spots: NDArray[np.intp],
        centres_px: FloatArray,
        sizes_px: FloatArray,
        along_enu: FloatArray,
        sigma_px: float,
    ) -> None:
        pixels, along = self._pixels[spots], self._along[spots]
        shaken_px = centres_px - 2.0 * pixels[:, 1] + pixels[:, 0]
        shaken = self._camera.fx * (along_enu - 2.0 * along[:, 1] + along[:, 0])
        in_world = np.square(shaken).sum(axis=1)
        # the variance of a second difference is six times that of each, on either axis
        by_errors = np.minimum(in_world / (12.0 * sigma_px**2), _MOST_SHAKEN**2)
        squares = np.column_stack([np.square(shaken_px).sum(axis=1), in_world, by_errors, np.ones(spots.size)])
        row = np.where(self._frame[spots] == self._frames - 1, self._row[spots], 0)
        # where frames are left out, only those are seen in which it came back to the spot
        is_told = (row >= 2)[:, None]
        self._sums[spots] = np.where(is_told, _KEPT * self._sums[spots] + squares, self._sums[spots])
        self._pixels[spots] = np.stack([pixels[:, 1], centres_px], axis=1)
        self._along[spots] = np.stack([along[:, 1], along_enu], axis=1)
        self._place_px[spots] += _LATELY * (centres_px - self._place_px[spots])
        self._size_px[spots] += _LATELY * (sizes_px - self._size_px[spots])
        self._row[spots], self._frame[spots] = row + 1, self._frames


def _are_like(sizes_px: FloatArray, others_px: FloatArray) -> BoolArray:
    """Whether segments may be of one thing, by their widths and heights (..., 2)."""
    ratio = np.maximum(sizes_px, _LEAST_PX) / np.maximum(others_px, _LEAST_PX)
    return np.asarray((np.maximum(ratio, 1.0 / ratio) <= _OTHER_SIZE).all(axis=-1))
