"""The paper's geometry: a cube of 100 m, 2 km ahead of a level camera that looks north and flies east."""

import cv2
import numpy as np
from numpy.typing import NDArray

from distloc.geometry.camera import Camera
from distloc.types import CameraPose, FloatArray

CAMERA = Camera(1920, 1080, 1200.0, 1200.0, 959.5, 539.5)
R_NORTH: FloatArray = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
CUBE_ENU_M: FloatArray = np.array([500.0, 2000.0, 200.0])  # (500, -200, 2000) in the camera's axes
_CORNERS_M = np.array([[x, y, z] for x in (-50, 50) for y in (-50, 50) for z in (-50, 50)]).T


def pose_at(east_m: float) -> CameraPose:
    return CameraPose(east_m / 10.0, np.array([east_m, 0.0, 0.0]), R_NORTH)


def cube_mask(pose: CameraPose) -> NDArray[np.uint8]:
    corners_cam_m = pose.R_cam_from_enu @ (CUBE_ENU_M[:, None] + _CORNERS_M - pose.position_enu_m[:, None])
    corners_px = np.rint(CAMERA.project(corners_cam_m)[0].T).astype(np.int32)
    mask = empty_mask()
    cv2.fillConvexPoly(mask, cv2.convexHull(corners_px), 255)
    return mask


def empty_mask() -> NDArray[np.uint8]:
    return np.zeros((CAMERA.height, CAMERA.width), dtype=np.uint8)


def mask_elsewhere() -> NDArray[np.uint8]:
    mask = empty_mask()
    mask[900:950, 100:150] = 255
    return mask
