"""The orientation of the autopilot's gimbal over time; used by the autopilot where the mount says `gimbal`."""

import math
from typing import Any

import numpy as np

from distloc.geometry.rotations import matrix_from_euler, matrix_from_quaternion, quaternion_from_euler
from distloc.types import FloatArray, RejectReason
from service.autopilot.poses import AttitudeTrack

YAW_LOCK = 16
YAW_IN_VEHICLE_FRAME = 32
YAW_IN_EARTH_FRAME = 64


class Gimbal:
    """Attitudes of the gimbal with yaw either from north or from the vehicle's heading, whichever is reported.

    `is_from_north` says which: such attitudes owe nothing to the vehicle's heading.
    """

    def __init__(self, gap_ns: int = 500_000_000) -> None:
        self._track = AttitudeTrack(gap_ns=gap_ns)
        self.is_from_north = False
        self._has_device = False

    def clear(self) -> None:
        """Forget everything."""
        self._track.clear()

    def device_status(self, message: Any, boot_ns: int) -> bool:
        """Take a GIMBAL_DEVICE_ATTITUDE_STATUS; False if its quaternion is no rotation."""
        self._has_device = True
        flags = int(message.flags)
        is_from_north = bool(flags & YAW_IN_EARTH_FRAME)
        if not flags & (YAW_IN_EARTH_FRAME | YAW_IN_VEHICLE_FRAME):
            is_from_north = bool(flags & YAW_LOCK)  # older senders: the lock tells the frame
        return self._add(boot_ns, np.array(message.q, dtype=np.float64), is_from_north)

    def mount_orientation(self, message: Any, boot_ns: int) -> bool:
        """Take a MOUNT_ORIENTATION, unless the newer message was heard; False if it is not finite."""
        if self._has_device:
            return True
        angles_rad = [math.radians(angle) for angle in (message.yaw, message.pitch, message.roll)]
        is_finite = all(map(math.isfinite, angles_rad))
        return is_finite and self._add(boot_ns, quaternion_from_euler(*angles_rad), False)

    def R_ned_from_gimbal(
        self, boot_ns: int, now_boot_ns: int, R_ned_from_body: FloatArray
    ) -> FloatArray | RejectReason | None:
        """(3, 3); None: a later sample may still come."""
        q = self._track.at(boot_ns, now_boot_ns)
        if not isinstance(q, np.ndarray):
            return q
        R_level_from_gimbal = matrix_from_quaternion(q)
        if self.is_from_north:
            return R_level_from_gimbal
        heading_rad = math.atan2(R_ned_from_body[1, 0], R_ned_from_body[0, 0])
        return np.asarray(matrix_from_euler(heading_rad, 0.0, 0.0) @ R_level_from_gimbal)

    def _add(self, boot_ns: int, q: FloatArray, is_from_north: bool) -> bool:
        norm = float(np.linalg.norm(q))
        if not math.isfinite(norm) or not 0.5 < norm < 1.5:
            return False
        if is_from_north != self.is_from_north:
            self._track.clear()
            self.is_from_north = is_from_north
        self._track.add(boot_ns, q / norm)
        return True
