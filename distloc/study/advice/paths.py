"""A craft that flies one way after another, and a camera on a target as the craft can keep it there."""

from dataclasses import dataclass

import numpy as np

from distloc.advice.ways import Craft
from distloc.geometry.rotations import R_cam_from_enu, matrix_from_euler
from distloc.types import CameraPose, FloatArray

STEP_S = 1.0


@dataclass(frozen=True, slots=True)
class LookingFlight:
    """From corner to corner (K, 2) at a height, the camera level or on the target.

    `about_enu_m` (3,) is where the pilot takes the target to be. `stamps_s` are the frames'.
    """

    craft: Craft
    corners_en_m: FloatArray
    height_m: float
    about_enu_m: FloatArray
    stamps_s: FloatArray

    def pose_at(self, stamp_s: float) -> CameraPose:
        """The camera's true pose; the heading is the craft's."""
        lengths_m = np.linalg.norm(np.diff(self.corners_en_m, axis=0), axis=1)
        ends_m = np.cumsum(lengths_m)
        flown_m = min(max(stamp_s, 0.0) * self.craft.speed_mps, float(ends_m[-1]))
        piece = min(int(np.searchsorted(ends_m, flown_m, side="right")), len(lengths_m) - 1)
        along = (self.corners_en_m[piece + 1] - self.corners_en_m[piece]) / lengths_m[piece]
        place_m = self.corners_en_m[piece] + (flown_m - ends_m[piece] + lengths_m[piece]) * along
        position = np.array([*place_m, self.height_m])
        offset_m = self.about_enu_m - position
        towards_rad = float(np.arctan2(offset_m[0], offset_m[1]))
        course_rad = float(np.arctan2(*along))
        nose_rad = course_rad if self.craft.is_nose_along else towards_rad
        camera_rad = towards_rad if self.craft.keeps_target else nose_rad
        pitch_rad = float(np.arctan2(offset_m[2], np.hypot(offset_m[0], offset_m[1])))
        R = R_cam_from_enu(matrix_from_euler(camera_rad, pitch_rad, 0.0), np.eye(3))
        return CameraPose(stamp_s, position, R, heading_rad=nose_rad)


def end_s(craft: Craft, corners_en_m: FloatArray) -> float:
    """When the last corner is reached."""
    return float(np.linalg.norm(np.diff(corners_en_m, axis=0), axis=1).sum()) / craft.speed_mps
