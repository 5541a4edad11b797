"""The camera's pose at any time and how wrong it may be, from the vehicle's attitudes and positions and the gimbal's.

The autopilot's follower owns it. `boot_ns` is the autopilot's time since boot, `now_ns` the host's clock. Free of I/O.
"""

import math
from typing import Any

import numpy as np

from distloc.geometry.rotations import R_ENU_FROM_NED, R_cam_from_enu, heading_rad, matrix_from_quaternion
from distloc.types import CameraPose, FloatArray, PoseErrors, RejectReason
from service.autopilot.payload.gimbal import Gimbal
from service.autopilot.pose_jumps import JumpWatch
from service.autopilot.pose_quality import PoseQuality
from service.autopilot.poses import PoseHistory
from service.config.sections import MountConfig

TURN_SPAN_NS = 100_000_000
TURN_RATE_RPS = 0.26  # 15 deg/s: 20 ms of time error and of motion blur are then 0.3 deg


class CameraPoses:
    """Keeps what came and watches it for jumps; `position_fault` is why the last position was refused, if it was."""

    def __init__(self, mount: MountConfig, pose_errors: PoseErrors, vehicle: PoseHistory | None = None) -> None:
        self.vehicle = vehicle or PoseHistory()
        self.gimbal = Gimbal(mount.gimbal_device) if mount.gimbal else None
        self.jumps = JumpWatch()
        self.quality = PoseQuality(pose_errors)
        self.heading_deg = 0.0
        self._R_ned_from_body: FloatArray | None = None
        self.position_fault: RejectReason | None = None
        self._R_body_from_mount = mount.R_body_from_mount
        self._lever_arm_body_m = mount.lever_arm_body_m

    def forget(self) -> None:
        """The times of what came were wrong."""
        self.vehicle.clear()
        self._R_ned_from_body = None
        if self.gimbal is not None:
            self.gimbal.clear()

    def restart(self) -> None:
        """The autopilot rebooted: nothing that it said still holds."""
        self.forget()
        self.quality.clear()
        self.jumps.clear()

    def add_attitude(self, boot_ns: int, q_ned_from_body: FloatArray, body_rate_rps: FloatArray, now_ns: int) -> None:
        """Keep the vehicle's unit quaternion (4,); with the body's rates (3,) a jump of the heading shows."""
        if not self.vehicle.add_attitude(boot_ns, q_ned_from_body):
            return
        self._R_ned_from_body = R_ned_from_body = matrix_from_quaternion(q_ned_from_body)
        self.heading_deg = math.degrees(heading_rad(R_ned_from_body))
        turns_camera = self.gimbal is None or not self.gimbal.is_from_north
        jumps = self.jumps.counts["heading"]
        self.jumps.attitude(boot_ns, R_ned_from_body, body_rate_rps, now_ns, turns_camera=turns_camera)
        if self.gimbal is not None:
            self.gimbal.expected(now_ns)
            if self.jumps.counts["heading"] != jumps:
                self.gimbal.heading_jumped()
        self.quality.heading_jumped(self.jumps.heading_rad(now_ns), now_ns)

    def add_position(self, boot_ns: int, position_enu_m: FloatArray, velocity_enu_mps: FloatArray, now_ns: int) -> None:
        """Keep the vehicle's position (3,) and velocity (3,), in which a jump shows."""
        if self.vehicle.add_position(boot_ns, position_enu_m, velocity_enu_mps):
            self.jumps.position(boot_ns, position_enu_m, velocity_enu_mps, now_ns)

    def add_gimbal(self, message: Any, stamp_boot_ns: int | None, now_boot_ns: int, now_ns: int) -> bool:
        """Take a gimbal's message, stamped so if its clock is the autopilot's; False if it tells no attitude."""
        if self.gimbal is None:
            return True
        return self.gimbal.receive(message, stamp_boot_ns, now_boot_ns, now_ns, self._R_ned_from_body)

    def at(
        self, boot_ns: int, now_boot_ns: int, now_ns: int, stamp_s: float, clock_spread_s: float
    ) -> CameraPose | RejectReason | None:
        """The camera's pose, stamped `stamp_s`; None: a later sample may still come."""
        found = self.vehicle.lookup(boot_ns, now_boot_ns)
        if found in (RejectReason.NO_POSE, RejectReason.STALE_POSE) and self.position_fault is not None:
            return self.position_fault
        if not isinstance(found, tuple):
            return found
        if self.jumps.is_position_doubted(now_ns):
            return RejectReason.POSITION_JUMPED
        q_ned_from_body, position_enu_m = found
        R_ned_from_body = matrix_from_quaternion(q_ned_from_body)
        R_ned_from_base = self._R_ned_from_base(boot_ns, now_boot_ns, R_ned_from_body)
        if not isinstance(R_ned_from_base, np.ndarray):
            return R_ned_from_base
        turn_rate_rps = self._turn_rate_rps(boot_ns, now_boot_ns, R_ned_from_body, R_ned_from_base)
        if turn_rate_rps is None or turn_rate_rps > TURN_RATE_RPS:
            return RejectReason.GIMBAL_UNKNOWN if turn_rate_rps is None else RejectReason.TURNING
        if self.gimbal is not None:
            clock_spread_s = max(clock_spread_s, self.gimbal.clock_spread_s)
        camera_position_enu_m = position_enu_m + R_ENU_FROM_NED @ R_ned_from_body @ self._lever_arm_body_m
        errors = self.quality.errors(turn_rate_rps, clock_spread_s, now_ns)
        R = R_cam_from_enu(R_ned_from_base, self._R_body_from_mount)
        return CameraPose(stamp_s, camera_position_enu_m, R, errors, heading_rad(R_ned_from_body))

    def R_ned_from_body(self, boot_ns: int, now_boot_ns: int) -> FloatArray | None:
        """The vehicle's attitude (3, 3), None where it is not known."""
        found = self.vehicle.lookup(boot_ns, now_boot_ns)
        return matrix_from_quaternion(found[0]) if isinstance(found, tuple) else None

    def _R_ned_from_base(
        self, boot_ns: int, now_boot_ns: int, R_ned_from_body: FloatArray
    ) -> FloatArray | RejectReason | None:
        """What the mount's angles are relative to: the gimbal's attitude (3, 3), or without one the body's."""
        if self.gimbal is None:
            return R_ned_from_body
        return self.gimbal.R_ned_from_gimbal(boot_ns, now_boot_ns, R_ned_from_body)

    def _turn_rate_rps(
        self, boot_ns: int, now_boot_ns: int, R_ned_from_body: FloatArray, R_ned_from_base: FloatArray
    ) -> float | None:
        """How fast the camera turned before this time: a small error of time turns it away; None: the gimbal's unknown.

        Where a gimbal tells its yaw from the vehicle's nose, the heading's own rate counts too: the two are then
        added up from messages that may be late by different times. 0 where the vehicle's attitude is unknown.
        """
        earlier = self.vehicle.attitudes.at(boot_ns - TURN_SPAN_NS, now_boot_ns)
        if not isinstance(earlier, np.ndarray):
            return 0.0
        R_ned_from_earlier_body = matrix_from_quaternion(earlier)
        R_ned_from_earlier = self._R_ned_from_base(boot_ns - TURN_SPAN_NS, now_boot_ns, R_ned_from_earlier_body)
        if not isinstance(R_ned_from_earlier, np.ndarray):
            return None
        cosine = (np.trace(R_ned_from_earlier.T @ R_ned_from_base) - 1.0) / 2.0
        turned_rad = float(np.arccos(np.clip(cosine, -1.0, 1.0)))
        if self.gimbal is not None and not self.gimbal.is_from_north:
            heading_turned_rad = heading_rad(R_ned_from_body) - heading_rad(R_ned_from_earlier_body)
            turned_rad = max(turned_rad, abs(math.remainder(heading_turned_rad, 2.0 * math.pi)))
        return turned_rad / (TURN_SPAN_NS * 1e-9)
