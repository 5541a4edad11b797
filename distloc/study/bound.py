"""The Cramer-Rao bound: the least error that an unbiased estimate of a static point can have, frame by frame.

The noise is taken as Gaussian of the given variances. For the paper's uniform angles that is the bound of every method
that uses no more of the noise than its variance: see docs/study.md.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from distloc.geometry.camera import Camera
from distloc.types import BoolArray, CameraPose, FloatArray


@dataclass(frozen=True, slots=True)
class NoiseModel:
    """One standard deviation of each error; nuisances that last are marginalised with these as their priors.

    White rotations turn the camera about itself, or about the world's origin as the paper's M_nu literally does. Biases
    are Gauss-Markov about up (heading) and about east and north (tilt), and so is the position's drift on each axis;
    its bias stays. A share `missed` of the frames shows nothing.
    """

    pixel_px: float = 1.0 / float(np.sqrt(12.0))
    rotation_white_rad: float = 0.0
    rotation_about: Literal["camera", "origin"] = "camera"
    translation_white_m: float = 0.0
    heading_bias_rad: float = 0.0
    tilt_bias_rad: float = 0.0
    tau_s: float = 300.0
    position_bias_m: float = 0.0
    time_offset_s: float = 0.0
    missed: float = 0.0
    position_drift_m: float = 0.0

    def __post_init__(self) -> None:
        sigmas = (
            self.rotation_white_rad,
            self.translation_white_m,
            self.heading_bias_rad,
            self.tilt_bias_rad,
            self.position_bias_m,
            self.time_offset_s,
            self.position_drift_m,
        )
        if not (0.0 < self.pixel_px < np.inf and self.tau_s > 0.0 and all(0.0 <= sigma < np.inf for sigma in sigmas)):
            raise ValueError(f"pixel_px and tau_s must be > 0, the other sigmas finite and >= 0, got {self}")
        if not 0.0 <= self.missed < 1.0:
            raise ValueError(f"missed must be at least 0 and under 1, got {self.missed}")


def position_bound(
    camera: Camera, poses: Sequence[CameraPose], point_enu_m: FloatArray, noise: NoiseModel
) -> FloatArray:
    """The least covariance (N, 3, 3) in ENU of an unbiased estimate after each of N poses; infinite if there is none.

    J = H' C^-1 H with H the pixels' derivative by the point and C the covariance of all pixels, linearised at the truth
    (Kay 1993, 3.9, for a covariance that does not depend on the parameter). Frames that don't show the point add
    nothing.
    """
    if not poses:
        raise ValueError("poses must hold at least one pose")
    geometry = _Geometry(camera, poses, np.asarray(point_enu_m, dtype=np.float64))
    covariance_px2 = geometry.white_px2(noise) + geometry.lasting_px2(noise)
    rows = np.repeat(geometry.is_seen, 2)
    information = np.zeros((rows.size, 3, 3))
    if rows.any():
        factor = np.linalg.cholesky(covariance_px2[np.ix_(rows, rows)])
        whitened = np.linalg.solve(factor, geometry.by_point.reshape(-1, 3)[rows])
        information[rows] = whitened[:, :, None] * whitened[:, None, :]
    return np.stack([covariance_of(J) for J in np.cumsum(information, axis=0)[1::2]])


def error_bound_m(covariance_enu_m2: FloatArray) -> FloatArray:
    """Root mean square distance (N,) of an estimate that attains the covariances (N, 3, 3)."""
    return np.asarray(np.sqrt(np.trace(covariance_enu_m2, axis1=1, axis2=2)))


def covariance_of(information: FloatArray) -> FloatArray:
    """The inverse (3, 3); infinite where nothing is known of a direction."""
    values, vectors = np.linalg.eigh(information)
    if not values[0] > 1e-12 * max(values[2], 1e-300):
        return np.diag([np.inf, np.inf, np.inf])
    return np.asarray(vectors / values @ vectors.T)


class _Geometry:
    """The pixels' derivatives at the true point."""

    def __init__(self, camera: Camera, poses: Sequence[CameraPose], point_enu_m: FloatArray) -> None:
        self._poses = poses
        self._stamps_s = np.array([pose.stamp_s for pose in poses])
        R = np.stack([pose.R_cam_from_enu for pose in poses])
        offsets_m = point_enu_m - np.stack([pose.position_enu_m for pose in poses])
        points_cam_m = np.einsum("nij,nj->ni", R, offsets_m)
        self._pixels, seen = camera.project(points_cam_m.T)
        self.is_seen: BoolArray = np.asarray(seen)
        by_cam = pixels_by_cam(camera, points_cam_m)
        self.is_seen &= np.isfinite(by_cam).all(axis=(1, 2))
        by_cam[~self.is_seen] = 0.0
        self._by_cam = by_cam
        self.by_point = by_cam @ R
        self._by_bias = np.stack([J @ _cross(v) for J, v in zip(self.by_point, offsets_m, strict=True)])
        self._by_origin_rotation = np.stack([J @ -_cross(M @ point_enu_m) for J, M in zip(by_cam, R, strict=True)])
        self._by_camera_rotation = np.stack([J @ -_cross(p) for J, p in zip(by_cam, points_cam_m, strict=True)])

    def white_px2(self, noise: NoiseModel) -> FloatArray:
        """(2N, 2N), block-diagonal."""
        turned = self._by_camera_rotation if noise.rotation_about == "camera" else self._by_origin_rotation
        blocks = noise.pixel_px**2 * np.eye(2) + (
            noise.rotation_white_rad**2 * turned @ turned.transpose(0, 2, 1)
            + noise.translation_white_m**2 * self._by_cam @ self._by_cam.transpose(0, 2, 1)
        )
        full = np.zeros((2 * len(self._poses), 2 * len(self._poses)))
        for i, block in enumerate(blocks / (1.0 - noise.missed)):
            full[2 * i : 2 * i + 2, 2 * i : 2 * i + 2] = block
        return full

    def lasting_px2(self, noise: NoiseModel) -> FloatArray:
        """(2N, 2N), of the errors that frames share."""
        n = len(self._poses)
        apart_s = np.abs(self._stamps_s[:, None] - self._stamps_s[None])
        kept = np.exp(-apart_s / noise.tau_s)
        full = np.zeros((2 * n, 2 * n))
        sigmas = (noise.tilt_bias_rad, noise.tilt_bias_rad, noise.heading_bias_rad)
        for axis, sigma in enumerate(sigmas):
            column = self._by_bias[:, :, axis].reshape(-1)
            full += sigma**2 * np.outer(column, column) * np.kron(kept, np.ones((2, 2)))
        for axis in range(3):
            column = self.by_point[:, :, axis].reshape(-1)
            alike = noise.position_bias_m**2 + noise.position_drift_m**2 * np.kron(kept, np.ones((2, 2)))
            full += alike * np.outer(column, column)
        if noise.time_offset_s > 0.0:
            column = self._pixel_speed().T.reshape(-1)
            full += noise.time_offset_s**2 * np.outer(column, column)
        return full

    def _pixel_speed(self) -> FloatArray:
        """Pixels a second (2, N) of the point, from the frames that show it."""
        speed = np.zeros((2, len(self._poses)))
        shown = np.flatnonzero(self.is_seen)
        _, first = np.unique(self._stamps_s[shown], return_index=True)
        if first.size > 1:
            stamps_s, pixels = self._stamps_s[shown[first]], self._pixels[:, shown[first]]
            slopes = np.gradient(pixels, stamps_s, axis=1)
            for axis in range(2):
                speed[axis, shown] = np.interp(self._stamps_s[shown], stamps_s, slopes[axis])
        return speed


def pixels_by_cam(camera: Camera, points_cam_m: FloatArray) -> FloatArray:
    """Derivatives (N, 2, 3) of the pixels by points (N, 3) in the camera's axes, by central differences: any lens."""
    steps_m = 1e-4 * np.linalg.norm(points_cam_m, axis=1)
    ends = points_cam_m[:, None] + steps_m[:, None, None] * np.vstack([np.eye(3), -np.eye(3)])
    pixels, _ = camera.project(ends.reshape(-1, 3).T)
    pixels = pixels.reshape(2, -1, 6)
    return np.asarray(((pixels[..., :3] - pixels[..., 3:]) / (2.0 * steps_m[:, None])).transpose(1, 0, 2))


def _cross(v: FloatArray) -> FloatArray:
    """The matrix (3, 3) of v x."""
    return np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])
