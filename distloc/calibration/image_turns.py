"""How far the camera turned from frame to frame, by following corners in the images.

`calibrate --time-offset` and the importers' clock tie use it.
What is near moves by the flight as well. On flat ground at home's height that is known and taken off; what hills leave
of it is mostly slow, and the estimate of the time offset takes off what is slow.
"""

import cv2
import numpy as np
from numpy.typing import NDArray

from distloc.geometry.camera import Camera
from distloc.types import CameraPose, FloatArray

_WIDTH = 960  # pixels of 0.06 deg with a usual lens, followed to a tenth; more is only slower
_CORNERS = 300
LEAST_FOLLOWED = 30
_MOST_BACK_PX = 0.5  # followed there and back, a corner must come home
_ROUNDS = 6
_FARTHEST_M = 20_000.0  # what is farther stands still


class TurnMeter:
    """Holds the last frame; a frame at a time in."""

    def __init__(self, camera: Camera) -> None:
        self._camera = camera
        self._last: tuple[NDArray[np.uint8], CameraPose | None] | None = None

    def turn(self, image: NDArray[np.uint8], pose: CameraPose | None, ground_up_m: float | None) -> FloatArray | None:
        """R (3, 3) of the camera's axes now from those at the last frame; None at the first or with too few corners.

        `pose` and the ground's height in its axes say only how things on the ground move by the flight; without one of
        them that stays in.
        """
        scale = max(1, self._camera.width // _WIDTH)
        grey = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
        size = (self._camera.width // scale, self._camera.height // scale)
        now = np.asarray(cv2.resize(grey, size, interpolation=cv2.INTER_AREA), dtype=np.uint8)
        last, self._last = self._last, (now, pose)
        if last is None:
            return None
        followed = _followed(last[0], now)
        if followed is None:
            return None
        before, after = (self._camera.rays((pixels + 0.5) * scale - 0.5).T for pixels in followed)
        if ground_up_m is not None and pose is not None and last[1] is not None:
            before = _flown(before, last[1], pose.position_enu_m, ground_up_m)
        return _rotation(before, after)

    def forget(self) -> None:
        """The next frame has none before it."""
        self._last = None


def _followed(before: NDArray[np.uint8], now: NDArray[np.uint8]) -> tuple[FloatArray, FloatArray] | None:
    """Pixels (2, n) of the same corners in both."""
    corners = cv2.goodFeaturesToTrack(before, _CORNERS, 0.01, 10)
    if corners is None or len(corners) < LEAST_FOLLOWED:
        return None
    ahead, is_found, _ = cv2.calcOpticalFlowPyrLK(before, now, corners, None)  # type: ignore[call-overload]
    back, is_back, _ = cv2.calcOpticalFlowPyrLK(now, before, ahead, None)  # type: ignore[call-overload]
    home = np.linalg.norm((back - corners).reshape(-1, 2), axis=1) < _MOST_BACK_PX
    good = home & (is_found.ravel() == 1) & (is_back.ravel() == 1)
    if good.sum() < LEAST_FOLLOWED:
        return None
    pairs = [np.asarray(points, dtype=np.float64).reshape(-1, 2)[good].T for points in (corners, ahead)]
    return pairs[0], pairs[1]


def _flown(rays: FloatArray, pose: CameraPose, position_enu_m: FloatArray, ground_up_m: float) -> FloatArray:
    """The rays (n, 3) of a pose's camera as they were if it stood elsewhere: they end on the ground or in the sky."""
    rays_enu = rays @ pose.R_cam_from_enu
    height_m = float(pose.position_enu_m[2]) - ground_up_m
    is_ground = (rays_enu[:, 2] * _FARTHEST_M < -height_m) & (height_m > 0.0)
    reach_m = np.where(is_ground, height_m / np.where(is_ground, -rays_enu[:, 2], 1.0), np.inf)
    moved = rays_enu - (position_enu_m - pose.position_enu_m) / reach_m[:, None]
    return np.asarray(moved / np.linalg.norm(moved, axis=1, keepdims=True) @ pose.R_cam_from_enu.T)


def _rotation(before: FloatArray, now: FloatArray) -> FloatArray:
    """The rotation (3, 3) that takes rays (n, 3) to rays (n, 3), by Wahba's problem; what does not fit weighs less."""
    weights = np.ones(len(before))
    R = np.eye(3)
    for _ in range(_ROUNDS):
        U, _, Vt = np.linalg.svd((weights[:, None] * now).T @ before)
        R = U @ np.diag([1.0, 1.0, np.sign(np.linalg.det(U @ Vt))]) @ Vt
        off = np.linalg.norm(now - before @ R.T, axis=1)
        scale = max(float(np.median(off)), 1e-6)
        weights = 1.0 / (1.0 + (off / (2.0 * scale)) ** 2)
    return np.asarray(R)
