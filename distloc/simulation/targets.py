"""Targets as a perfect segmenter sees them: boxes (the paper's cube, a mast) and a plume that drifts from its base."""

from dataclasses import dataclass
from typing import Protocol

import cv2
import numpy as np
from numpy.typing import NDArray

from distloc.geometry.camera import Camera
from distloc.simulation.plume import Plume
from distloc.types import BoolArray, CameraPose, FloatArray

_UNSEEN_PX = 30_000  # a corner so far outside the image is beyond what the polygon filler takes


class Target(Protocol):
    """What the simulation asks of a target; times are the pose's stamps."""

    def draw(self, mask: NDArray[np.uint8], camera: Camera, pose: CameraPose) -> None:
        """Set the pixels of `mask` (H, W) that the target covers to 255."""
        ...

    def centre_enu_m(self, stamp_s: float) -> FloatArray:
        """The centre (3,), which a localiser is to find."""
        ...

    def is_inside(self, points_enu_m: FloatArray, stamp_s: float) -> BoolArray:
        """Which of the points (3, N) lie inside the target (N,)."""
        ...


@dataclass(frozen=True, slots=True)
class Box:
    """A box with sides along east, north and up; the paper's cube is 100 m each way, its mast is thin and tall."""

    position_enu_m: FloatArray
    size_m: tuple[float, float, float] = (100.0, 100.0, 100.0)

    def __post_init__(self) -> None:
        if not all(side > 0.0 for side in self.size_m):
            raise ValueError(f"a box's sides must be > 0, got {self.size_m}")

    @property
    def corners_enu_m(self) -> FloatArray:
        """(3, 8)."""
        signs = np.array([[i, j, k] for i in (-0.5, 0.5) for j in (-0.5, 0.5) for k in (-0.5, 0.5)]).T
        return np.asarray(self.position_enu_m[:, None] + np.array(self.size_m)[:, None] * signs)

    def corners_px(self, camera: Camera, pose: CameraPose) -> FloatArray | None:
        """The corners' exact projections (2, 8); None where the lens does not see one of them."""
        corners_cam_m = pose.R_cam_from_enu @ (self.corners_enu_m - pose.position_enu_m[:, None])
        corners_px, _ = camera.project(corners_cam_m)
        return corners_px if np.isfinite(corners_px).all() else None

    def draw(self, mask: NDArray[np.uint8], camera: Camera, pose: CameraPose) -> None:
        """As the paper: the corners rounded to whole pixels, their convex hull filled."""
        corners = self.corners_px(camera, pose)
        if corners is not None:
            _fill_hull(mask, corners)

    def centre_enu_m(self, stamp_s: float) -> FloatArray:
        """Its position; it stands still."""
        return self.position_enu_m

    def is_inside(self, points_enu_m: FloatArray, stamp_s: float) -> BoolArray:
        """Inside or on a face."""
        half_m = np.array(self.size_m)[:, None] / 2.0
        return np.asarray((np.abs(points_enu_m - self.position_enu_m[:, None]) <= half_m).all(axis=0))


def mast(base_enu_m: FloatArray) -> Box:
    """A mast of 3 x 3 x 60 m that stands on its base."""
    return Box(np.asarray(base_enu_m) + np.array([0.0, 0.0, 30.0]), (3.0, 3.0, 60.0))


@dataclass(frozen=True, slots=True)
class DriftingPlume:
    """Smoke that grows downwind from its base, so that its centre drifts; a hard outline of the renderer's plume."""

    plume: Plume

    def draw(self, mask: NDArray[np.uint8], camera: Camera, pose: CameraPose) -> None:
        """Fill the hulls of neighbouring level discs along its middle line."""
        share = np.linspace(0.0, 1.0, 17)
        size = self.plume.size_share(pose.stamp_s)
        axis_enu_m = self._grown(self.plume.axis_enu_m(share * self.plume.reach), size)
        angle = np.linspace(0.0, 2.0 * np.pi, 24, endpoint=False)
        rim = np.stack([np.cos(angle), np.sin(angle), np.zeros(angle.size)])
        discs_enu_m = axis_enu_m[:, :, None] + size * self.plume.radius_m(share)[:, None] * rim[:, None, :]
        discs_cam_m = pose.R_cam_from_enu @ (discs_enu_m.reshape(3, -1) - pose.position_enu_m[:, None])
        discs_px = camera.project(discs_cam_m)[0].reshape(2, share.size, angle.size)
        if not np.isfinite(discs_px).all():
            return
        for i in range(share.size - 1):
            _fill_hull(mask, discs_px[:, i : i + 2].reshape(2, -1))

    def centre_enu_m(self, stamp_s: float) -> FloatArray:
        """The centre of what has grown by then."""
        return self._grown(self.plume.centre_enu_m[:, None], self.plume.size_share(stamp_s))[:, 0]

    def base_enu_m(self, stamp_s: float) -> FloatArray:
        """Where it stands: the fire."""
        return self.plume.base_enu_m

    def is_inside(self, points_enu_m: FloatArray, stamp_s: float) -> BoolArray:
        """Within its radius of the middle line at the point's own height."""
        size = self.plume.size_share(stamp_s)
        share = (points_enu_m[2] - self.plume.base_enu_m[2]) / (size * self.plume.height_m * self.plume.reach)
        held = np.clip(share, 0.0, 1.0)
        axis_enu_m = self._grown(self.plume.axis_enu_m(held * self.plume.reach), size)
        distance_m = np.hypot(*(points_enu_m - axis_enu_m)[:2])
        return np.asarray((share >= 0.0) & (share <= 1.0) & (distance_m <= size * self.plume.radius_m(held)))

    def _grown(self, points_enu_m: FloatArray, size: float) -> FloatArray:
        base = self.plume.base_enu_m[:, None]
        return np.asarray(base + size * (points_enu_m - base))


def _fill_hull(mask: NDArray[np.uint8], pixels: FloatArray) -> None:
    rounded = np.rint(pixels.T)
    height, width = mask.shape
    low, high = rounded.min(axis=0), rounded.max(axis=0)
    is_outside = bool((high < 0).any()) or low[0] >= width or low[1] >= height
    if is_outside or np.abs(rounded).max() > _UNSEEN_PX:
        return
    cv2.fillConvexPoly(mask, cv2.convexHull(rounded.astype(np.int32)), 255)
