"""The camera model: pinhole with OpenCV's Brown-Conrady or fisheye distortion."""

import math
from dataclasses import dataclass, field
from typing import Literal

import cv2
import numpy as np

from distloc.types import FloatArray

_BROWN_CONRADY_SIZES = (0, 4, 5, 8, 12, 14)  # what OpenCV's projectPoints accepts


@dataclass(frozen=True, slots=True)
class Camera:
    """Intrinsics in pixels of the full-size image; pixel centres lie at whole numbers, as OpenCV has them.

    `distortion` holds OpenCV's coefficients in its order; empty is a pinhole. Raises ValueError on impossible values.
    """

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float
    distortion: tuple[float, ...] = ()
    model: Literal["brown-conrady", "fisheye"] = "brown-conrady"
    _max_tangent: float = field(init=False, repr=False, compare=False, default=np.inf)

    def __post_init__(self) -> None:
        if self.width < 1 or self.height < 1:
            raise ValueError(f"width and height must be at least 1, got {self.width} x {self.height}")
        if not (np.isfinite([self.fx, self.fy, self.cx, self.cy]).all() and self.fx > 0 and self.fy > 0):
            raise ValueError(f"fx, fy must be > 0 and cx, cy finite, got {self.fx}, {self.fy}, {self.cx}, {self.cy}")
        sizes = (4,) if self.model == "fisheye" else _BROWN_CONRADY_SIZES
        if len(self.distortion) not in sizes or not np.isfinite(self.distortion).all():
            raise ValueError(f"distortion ({self.model}) must have {sizes} finite numbers, got {self.distortion}")
        if self.distortion:
            object.__setattr__(self, "_max_tangent", 1.1 * self._tangent_of_border())

    @property
    def matrix(self) -> FloatArray:
        """K (3, 3)."""
        return np.array([[self.fx, 0.0, self.cx], [0.0, self.fy, self.cy], [0.0, 0.0, 1.0]])

    @property
    def fov_rad(self) -> tuple[float, float]:
        """Horizontal and vertical angle of view through the image's middle, distortion and all."""
        u, v = (self.width - 1) / 2, (self.height - 1) / 2
        ends = np.array([[-0.5, self.width - 0.5, u, u], [v, v, -0.5, self.height - 0.5]])
        left, right, top, bottom = self.rays(ends).T
        return math.acos(np.clip(left @ right, -1, 1)), math.acos(np.clip(top @ bottom, -1, 1))

    def project(self, points_cam_m: FloatArray) -> tuple[FloatArray, np.ndarray[tuple[int], np.dtype[np.bool_]]]:
        """Pixels (2, N) of points (3, N), and which of them (N,) lie in front of the camera and inside the image.

        Points behind the camera have NaN for pixels, and so have those far outside the field of view, where a
        distortion polynomial folds back into the image.
        """
        z = points_cam_m[2]
        in_front = z > 1e-6
        xy = points_cam_m[:2] / np.where(in_front, z, 1.0)
        if self.distortion:
            in_front = in_front & (np.hypot(xy[0], xy[1]) <= self._max_tangent)
            pixels = self._distorted(np.where(in_front, xy, 0.0))
        else:
            pixels = np.stack([self.fx * xy[0] + self.cx, self.fy * xy[1] + self.cy])
        pixels = np.where(in_front, pixels, np.nan)
        u, v = pixels
        inside = in_front & (u >= -0.5) & (u < self.width - 0.5) & (v >= -0.5) & (v < self.height - 0.5)
        return pixels, inside

    def rays(self, pixels: FloatArray) -> FloatArray:
        """Unit vectors (3, N) in the camera's axes through pixels (2, N)."""
        xy = self._undistorted(np.asarray(pixels, dtype=np.float64))
        rays = np.vstack([xy, np.ones(xy.shape[1])])
        return np.asarray(rays / np.linalg.norm(rays, axis=0))

    def _distorted(self, xy: FloatArray) -> FloatArray:
        points = np.vstack([xy, np.ones(xy.shape[1])]).T.reshape(-1, 1, 3)
        if points.shape[0] == 0:
            return np.zeros((2, 0))
        zero, coefficients = np.zeros(3), np.asarray(self.distortion)
        if self.model == "fisheye":
            pixels = cv2.fisheye.distortPoints(np.ascontiguousarray(points[:, :, :2]), self.matrix, coefficients)
        else:
            pixels, _ = cv2.projectPoints(points, zero, zero, self.matrix, coefficients)
        return np.asarray(pixels, dtype=np.float64).reshape(-1, 2).T

    def _undistorted(self, pixels: FloatArray) -> FloatArray:
        if not self.distortion or pixels.shape[1] == 0:
            return np.stack([(pixels[0] - self.cx) / self.fx, (pixels[1] - self.cy) / self.fy])
        points = np.ascontiguousarray(pixels.T.reshape(-1, 1, 2))
        coefficients = np.asarray(self.distortion)
        if self.model == "fisheye":
            xy = cv2.fisheye.undistortPoints(points, self.matrix, coefficients)
        else:
            criteria = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 50, 1e-10)
            xy = cv2.undistortPoints(points, self.matrix, coefficients, criteria=criteria)
        return np.asarray(xy, dtype=np.float64).reshape(-1, 2).T

    def _tangent_of_border(self) -> float:
        u = np.linspace(0.0, self.width - 1.0, 17)
        v = np.linspace(0.0, self.height - 1.0, 17)
        rows = [np.stack([u, np.full(17, y)]) for y in (0.0, self.height - 1.0)]
        columns = [np.stack([np.full(17, x), v]) for x in (0.0, self.width - 1.0)]
        xy = self._undistorted(np.hstack(rows + columns))
        return float(np.hypot(xy[0], xy[1]).max())
