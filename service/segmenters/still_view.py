"""What changes in a view that stands still: smoke grows and churns; rocks, roads and haze don't. A segmenter asks."""

from collections import deque
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from distloc.geometry.camera import Camera
from distloc.types import CameraPose
from service.common.messages import Frame

_SHRINK = 8  # pixels of a side in one of what is kept: JPEG's blocks, and less than smoke that can be told
_KEPT, _EVERY_S = 6, 5.0
_LEAST_S, _MOST_S = 10.0, 120.0  # between two frames that are compared
_NEAR_M = 30.0  # that the camera may have moved meanwhile: a hundredth of the range
_STILL_SHARE, _STILL_LEVELS = 0.8, 2.5  # of the picture changes by so many levels of 255 at the most: else it moves
_LEAST_LEVELS, _LEAST_TIMES = 3.0, 3.0  # what has changed: at least, and against what the rest of the picture did


@dataclass(frozen=True, slots=True)
class _Kept:
    stamp_s: float
    image: NDArray[np.float32]
    pose: CameraPose | None


class StillView:
    """A few frames of the last half minute, shrunk, that later ones are compared with."""

    def __init__(self, camera: Camera) -> None:
        self._camera = camera
        self._size = max(1, camera.width // _SHRINK), max(1, camera.height // _SHRINK)
        self._kept: deque[_Kept] = deque(maxlen=_KEPT)
        self._scale = np.array(self._size) / (camera.width, camera.height)
        x, y = np.meshgrid(np.arange(self._size[0]), np.arange(self._size[1]))
        self._rays = camera.rays((np.stack([x.ravel(), y.ravel()]) + 0.5) / self._scale[:, None] - 0.5)

    def change(self, frame: Frame, pose: CameraPose | None) -> NDArray[np.float32] | None:
        """How much has changed (h, w), 1 and more being what only moves or grows; None where nothing can be compared.

        Against the oldest frame of 10 s to two minutes ago, turned as this one is. Where the camera moved so far that
        the scenery is another, or its lens looks elsewhere, the picture as a whole has changed, and none can be told.
        """
        if frame.image is None or frame.image.ndim != 3:
            return None
        stamp_s = frame.stamp_ns / 1e9
        if self._kept and stamp_s < self._kept[-1].stamp_s:
            self._kept.clear()
        before = next((one for one in self._kept if _LEAST_S <= stamp_s - one.stamp_s <= _MOST_S), None)
        is_near = before is not None and _is_near(before.pose, pose)
        is_due = not self._kept or stamp_s - self._kept[-1].stamp_s >= _EVERY_S
        if not (is_near or is_due):
            return None
        image = cv2.resize(frame.image, self._size, interpolation=cv2.INTER_AREA).astype(np.float32)
        if is_due:
            self._kept.append(_Kept(stamp_s, image, pose))
        return self._against(before, image, pose) if before is not None and is_near else None

    def _against(
        self, before: _Kept, image: NDArray[np.float32], pose: CameraPose | None
    ) -> NDArray[np.float32] | None:
        was, is_seen = before.image, np.ones(image.shape[:2], np.bool_)
        if before.pose is not None and pose is not None:
            was, is_seen = self._turned(before.image, before.pose, pose)
            if is_seen.mean() < _STILL_SHARE:
                return None
        difference = image - was
        difference -= np.median(difference[is_seen], axis=0)  # the exposure, the sun
        levels = np.abs(difference).mean(axis=2)
        rest = float(np.quantile(levels[is_seen], _STILL_SHARE))
        if rest > _STILL_LEVELS:
            return None
        return np.where(is_seen, levels / max(_LEAST_LEVELS, _LEAST_TIMES * rest), 0.0).astype(np.float32)

    def _turned(
        self, image: NDArray[np.float32], was: CameraPose, now: CameraPose
    ) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
        """An earlier picture as it would look now, if all were far, and where it has anything to show."""
        rays = was.R_cam_from_enu @ now.R_cam_from_enu.T @ self._rays
        pixels, is_seen = self._camera.project(rays)
        x, y = np.where(is_seen, (pixels + 0.5) * self._scale[:, None] - 0.5, 0.0).astype(np.float32)
        shape = image.shape[:2]
        turned = cv2.remap(image, x.reshape(shape), y.reshape(shape), cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        return np.asarray(turned, np.float32), np.asarray(is_seen.reshape(shape))


def _is_near(was: CameraPose | None, now: CameraPose | None) -> bool:
    """Whether nothing but turning may be between them: both are fixed cameras', or of nearly the same place."""
    if was is None or now is None:
        return was is now
    return bool(np.linalg.norm(now.position_enu_m - was.position_enu_m) <= _NEAR_M)


def with_changed(
    mask: NDArray[np.uint8], faint: NDArray[np.bool_], change: NDArray[np.float32] | None
) -> NDArray[np.uint8]:
    """The mask (h, w) with the segments of `faint` (h, w) that hold none of it and have changed."""
    if change is None or not faint.any():
        return mask
    count, labels = cv2.connectedComponents(faint.astype(np.uint8))
    area = np.bincount(labels.ravel(), minlength=count)
    held = np.bincount(labels[mask > 0], minlength=count) > 0
    levels = cv2.resize(change, mask.shape[::-1], interpolation=cv2.INTER_LINEAR)
    mean = np.bincount(labels.ravel(), weights=levels.ravel(), minlength=count) / np.maximum(area, 1)
    is_added = ~held & (mean >= 1.0)
    is_added[0] = False
    return np.where(is_added[labels], 255, mask).astype(np.uint8)
