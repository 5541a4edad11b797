"""The Cramer-Rao bound of a target's place where corners of the scenery are seen with the same errors of the pose.

Unknown are the target, the corners' places and each frame's errors of attitude and position, whose covariance is the
prior. Each corner is eliminated from the information matrix by its Schur complement, then the frames' errors are.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from distloc.geometry.camera import Camera
from distloc.simulation.corners import SimulatedCorners
from distloc.study.bound import NoiseModel, covariance_of, pixels_by_cam
from distloc.types import CameraPose, FloatArray

_FAR_M = 1e4  # standard deviation of a corner's place before it is seen
_X = 6  # of a frame: errors of attitude about east, north and up, and of position


@dataclass(frozen=True, slots=True)
class Followed:
    """Sightings (n,) of corners in the order of the frames: the frame, which corner, and where that is (n, 3)."""

    frames: NDArray[np.intp]
    corners: NDArray[np.intp]
    places_enu_m: FloatArray


def followed_on(poses: Sequence[CameraPose], corners: SimulatedCorners) -> Followed:
    """The corners of a flight's true poses."""
    names, frames, places = [], [], []
    for frame, pose in enumerate(poses):
        names.append(corners.at(pose).names)
        frames.append(np.full(names[-1].size, frame))
        places.append(corners.places_enu_m.T)
    _, which = np.unique(np.concatenate(names), return_inverse=True)
    return Followed(np.concatenate(frames), which, np.concatenate(places))


def scenery_bound(
    camera: Camera,
    poses: Sequence[CameraPose],
    point_enu_m: FloatArray,
    noise: NoiseModel,
    followed: Followed,
    corner_px: float = 0.7,
) -> FloatArray:
    """As `position_bound`: the least covariance (N, 3, 3) of the point after each of N poses, with the corners.

    ValueError for a time offset, a position bias that stays, missed frames or rotations about the world's origin.
    """
    if noise.time_offset_s or noise.position_bias_m or noise.missed or noise.rotation_about != "camera":
        raise ValueError(
            "time_offset_s, position_bias_m and missed must be 0 and rotation_about 'camera' where corners are seen, "
            f"got {noise}"
        )
    frames = np.arange(len(poses))
    by_target, by_error = _derivatives(camera, poses, frames, np.tile(point_enu_m, (len(poses), 1)))
    by_target, by_error = by_target / noise.pixel_px, by_error / noise.pixel_px
    of_target = by_target.transpose(0, 2, 1) @ by_target
    mixed = by_error.transpose(0, 2, 1) @ by_target
    of_error = by_error.transpose(0, 2, 1) @ by_error
    scenery = _Scenery(camera, poses, followed, corner_px)
    bounds = []
    for n in range(1, len(poses) + 1):
        A = _prior(poses[:n], noise) + scenery.information(n)
        _add_blocks(A, of_error[:n])
        B = mixed[:n].reshape(_X * n, 3)
        bounds.append(covariance_of(of_target[:n].sum(axis=0) - B.T @ np.linalg.solve(A, B)))
    return np.stack(bounds)


class _Scenery:
    """What corners tell of the frames' errors."""

    def __init__(self, camera: Camera, poses: Sequence[CameraPose], followed: Followed, corner_px: float) -> None:
        count, n = len(poses), int(followed.corners.max(initial=-1)) + 1
        by_place, by_error = _derivatives(camera, poses, followed.frames, followed.places_enu_m)
        by_place, by_error = by_place / corner_px, by_error / corner_px
        self._frames, self._corners = followed.frames, followed.corners
        self._of_place = by_place.transpose(0, 2, 1) @ by_place
        self._mixed = np.zeros((n, 3, count, _X))
        self._mixed[followed.corners, :, followed.frames] = by_place.transpose(0, 2, 1) @ by_error
        self._of_error = np.zeros((count, _X, _X))
        np.add.at(self._of_error, followed.frames, by_error.transpose(0, 2, 1) @ by_error)

    def information(self, n: int) -> FloatArray:
        """Of the errors of the first n frames (6n, 6n), from what these saw."""
        shown = self._frames < n
        H = np.tile(np.eye(3) / _FAR_M**2, (len(self._mixed), 1, 1))
        np.add.at(H, self._corners[shown], self._of_place[shown])
        root = np.linalg.inv(np.linalg.cholesky(H))
        Y = (root @ self._mixed[:, :, :n].reshape(-1, 3, _X * n)).reshape(-1, _X * n)
        full = -Y.T @ Y
        _add_blocks(full, self._of_error[:n])
        return np.asarray(full)


def _derivatives(
    camera: Camera, poses: Sequence[CameraPose], frames: NDArray[np.intp], places_enu_m: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Of pixels by the places (n, 2, 3) and by the frames' errors (n, 2, 6); zero where a place is not in the image."""
    R = np.stack([pose.R_cam_from_enu for pose in poses])[frames]
    offsets_m = places_enu_m - np.stack([pose.position_enu_m for pose in poses])[frames]
    cam_m = np.einsum("nij,nj->ni", R, offsets_m)
    _, is_seen = camera.project(cam_m.T)
    by_place = pixels_by_cam(camera, cam_m) @ R
    by_place[~(is_seen & np.isfinite(by_place).all(axis=(1, 2)))] = 0.0
    by_turn = np.cross(by_place, offsets_m[:, None])
    return by_place, np.concatenate([by_turn, by_place], axis=2)


def _prior(poses: Sequence[CameraPose], noise: NoiseModel) -> FloatArray:
    """Information (6n, 6n) of n frames' errors before anything is seen."""
    n = len(poses)
    stamps_s = np.array([pose.stamp_s for pose in poses])
    kept = np.exp(-np.abs(stamps_s[:, None] - stamps_s) / noise.tau_s)
    slow = [noise.tilt_bias_rad, noise.tilt_bias_rad, noise.heading_bias_rad, *[noise.position_drift_m] * 3]
    white = [noise.rotation_white_rad] * 3 + [noise.translation_white_m] * 3
    least = np.array([1e-7] * 3 + [1e-4] * 3)
    full = np.zeros((n, _X, n, _X))
    for axis in range(_X):
        covariance = slow[axis] ** 2 * kept + (white[axis] ** 2 + least[axis] ** 2) * np.eye(n)
        full[:, axis, :, axis] = np.linalg.inv(covariance)
    return full.reshape(_X * n, _X * n)


def _add_blocks(full: FloatArray, blocks: FloatArray) -> None:
    """Add n blocks (n, 6, 6) to the diagonal of (6n, 6n), in place."""
    n = len(blocks)
    full.reshape(n, _X, n, _X)[np.arange(n), :, np.arange(n)] += blocks
