"""Pictures of textured flat ground through any lens, for what follows corners: quick to draw, and true to the pose."""

import cv2
import numpy as np
from numpy.typing import NDArray

from distloc.geometry.camera import Camera
from distloc.geometry.rotations import R_cam_from_enu, matrix_from_euler
from distloc.types import CameraPose, FloatArray

_TEXELS, _TEXEL_M = 1024, 0.5
_SPEED_MPS, _HEIGHT_M = 12.0, 80.0


class GroundPictures:
    """Ground at height 0 with a texture that `seed` makes; grey above the horizon."""

    def __init__(self, camera: Camera, seed: int = 0) -> None:
        rng = np.random.default_rng(seed)
        self._size = (camera.height, camera.width)
        pixels = np.stack(np.meshgrid(*(np.arange(float(side)) for side in (camera.width, camera.height))))
        self._rays = camera.rays(pixels.reshape(2, -1))
        texture = np.zeros((_TEXELS, _TEXELS))
        for step in (2, 8, 32):
            coarse = rng.normal(size=(_TEXELS // step, _TEXELS // step))
            texture += cv2.resize(coarse, (_TEXELS, _TEXELS), interpolation=cv2.INTER_CUBIC)
        self._texture = np.clip(120.0 + 35.0 * texture, 0.0, 255.0).astype(np.uint8)

    def at(self, pose: CameraPose) -> NDArray[np.uint8]:
        """The image (H, W, 3) at a true pose."""
        east, north, up = pose.R_cam_from_enu.T @ self._rays
        is_ground = np.nan_to_num(up, nan=1.0) < -0.05
        far_m = pose.position_enu_m[2] / np.where(is_ground, -up, 1.0)
        u, v = (
            np.mod(np.where(is_ground, start_m + far_m * part, 0.0) / _TEXEL_M, _TEXELS).astype(np.float32)
            for start_m, part in zip(pose.position_enu_m[:2], (east, north), strict=True)
        )
        grey = cv2.remap(
            self._texture, u.reshape(self._size), v.reshape(self._size), cv2.INTER_LINEAR, borderMode=cv2.BORDER_WRAP
        )
        grey[~is_ground.reshape(self._size)] = 200
        return np.asarray(cv2.cvtColor(grey, cv2.COLOR_GRAY2BGR), dtype=np.uint8)


def board(seed: int = 0) -> NDArray[np.uint8]:
    """A pattern (48, 48) in grey levels that looks like nothing else."""
    blocks = np.random.default_rng(seed).integers(0, 2, (6, 6)).astype(np.uint8) * 190 + 30
    return np.asarray(cv2.resize(blocks, (48, 48), interpolation=cv2.INTER_NEAREST), dtype=np.uint8)


def put_board(
    image: NDArray[np.uint8], camera: Camera, pose: CameraPose, place_enu_m: FloatArray, side_m: float, seed: int = 0
) -> None:
    """Draw a board that faces the camera into its picture (H, W, 3), in place; its middle is at (3,)."""
    line_m = pose.R_cam_from_enu @ (place_enu_m - pose.position_enu_m)
    (u,), (v,) = camera.project(line_m[:, None])[0]
    scale = camera.fx * side_m / float(line_m[2]) / 48.0
    if not (line_m[2] > 1.0 and np.isfinite([u, v]).all()):
        return
    warp = np.array([[scale, 0.0, u - scale * 23.5], [0.0, scale, v - scale * 23.5]])
    size = image.shape[1::-1]
    drawn = cv2.warpAffine(board(seed), warp, size, flags=cv2.INTER_AREA, borderValue=0)
    covered = cv2.warpAffine(np.full((48, 48), 255, np.uint8), warp, size, flags=cv2.INTER_NEAREST)
    image[covered > 0] = drawn[covered > 0, None]


def flown(t_s: float, heading_error_deg: float = 0.0) -> CameraPose:
    """North at 12 m/s and 80 m, the camera looking 60 degrees to the right and 30 down; `heading_rad` is not told.

    The heading is wrong by the error, clockwise, as a compass that reads too much makes it.
    """
    R_ned_from_body = matrix_from_euler(np.radians(heading_error_deg), 0.0, 0.0)
    R_body_from_mount = matrix_from_euler(np.radians(60.0), np.radians(-30.0), 0.0)
    position_enu_m = np.array([0.0, _SPEED_MPS * t_s, _HEIGHT_M])
    return CameraPose(t_s, position_enu_m, R_cam_from_enu(R_ned_from_body, R_body_from_mount))
