"""A vehicle whose heading is a function of time, with gimbals and cameras beside it, fed to an `Autopilot`."""

import math
from collections.abc import Callable, Iterable
from typing import Any

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from distloc.geometry.rotations import quaternion_from_euler
from distloc.types import CameraPose, RejectReason
from service.autopilot.autopilot import Autopilot
from service.config.sections import CameraConfig, MavlinkConfig, MountConfig
from service.mavlink.framer import Framer

MS = 1_000_000
OFFSET_NS = 7_000_000_000_000
START_MS = 100_000
STEP_MS = 20
Message = Callable[[int], Any]


class Rig:
    """Times are milliseconds of the autopilot's since boot; what is sent arrives at that time and `late_ms`."""

    def __init__(self, gimbal_device: int = 0, camera: CameraConfig | None = None, *, gimbal: bool = True) -> None:
        mount = MountConfig(gimbal=gimbal, gimbal_device=gimbal_device)
        self.autopilot = Autopilot(MavlinkConfig(), mount, camera=camera)
        self.boot_ms = START_MS
        self._send(mavlink.MAVLink_heartbeat_message(2, 3, 0, 0, 4, 3))
        self._send(mavlink.MAVLink_gps_raw_int_message(0, 3, 0, 0, 100_000, 0, 0, 0, 0, 9, 147_000))

    @property
    def now_ns(self) -> int:
        return self.boot_ms * MS + OFFSET_NS

    def fly(
        self,
        seconds: float,
        heading_deg: Callable[[int], float] = lambda boot_ms: 0.0,
        gimbals: Iterable[tuple[int, int, Message]] = (),
    ) -> None:
        """Attitudes at 50 Hz and each gimbal's (component, interval in ms, message at a time)."""
        for boot_ms in range(self.boot_ms, self.boot_ms + round(seconds * 1000), STEP_MS):
            self.boot_ms = boot_ms
            yaw_rad = math.radians(heading_deg(boot_ms))
            rate_rps = (math.radians(heading_deg(boot_ms + 1)) - yaw_rad) * 1000.0
            if boot_ms % 1000 == 0:
                self._send(mavlink.MAVLink_heartbeat_message(2, 3, 0, 0, 4, 3))
            wrapped_rad = math.remainder(yaw_rad, 2.0 * math.pi)
            self._send(mavlink.MAVLink_attitude_message(boot_ms, 0, 0, wrapped_rad, 0, 0, rate_rps))
            place = (400_000_000, 30_000_000, 100_000, 50_000)
            self._send(mavlink.MAVLink_global_position_int_message(boot_ms, *place, 0, 0, 0, 0))
            for component, interval_ms, message in gimbals:
                if boot_ms % interval_ms == 0:
                    self._send(message(boot_ms), component)
        self.boot_ms += STEP_MS

    def hear(self, message: Any, component: int = 1, system: int = 1) -> None:
        self._send(message, component, system)

    def look(self, before_ms: int = 400) -> CameraPose | RejectReason | None:
        return self.autopilot.camera_pose(self.now_ns - before_ms * MS, self.now_ns)

    def azimuth_deg(self, before_ms: int = 400) -> float | RejectReason | None:
        """Where the camera looks, clockwise from north; else why there is no pose."""
        pose = self.look(before_ms)
        if not isinstance(pose, CameraPose):
            return pose
        east, north, _ = pose.R_cam_from_enu.T @ np.array([0.0, 0.0, 1.0])
        return math.degrees(math.atan2(east, north)) % 360.0

    def degraded(self) -> set[str]:
        return {str(name) for name in self.autopilot.degraded(self.now_ns)}

    def _send(self, message: Any, component: int = 1, system: int = 1) -> None:
        (frame,) = Framer().feed(bytes(message.pack(mavlink.MAVLink(None, system, component))))
        self.autopilot.receive(frame, self.now_ns)


def device(
    boot_ms: int,
    yaw_deg: float = 0.0,
    flags: int = 32,
    *,
    delta_yaw_deg: float = math.nan,
    device_id: int = 0,
    failures: int = 0,
    q: Any = None,
) -> Any:
    """A GIMBAL_DEVICE_ATTITUDE_STATUS."""
    quaternion = quaternion_from_euler(math.radians(yaw_deg), 0.0, 0.0) if q is None else q
    tail = (failures, math.radians(delta_yaw_deg), math.nan, device_id)
    return mavlink.MAVLink_gimbal_device_attitude_status_message(0, 0, boot_ms, flags, list(quaternion), 0, 0, 0, *tail)


def mount_status(yaw_deg: float) -> Any:
    return mavlink.MAVLink_mount_status_message(0, 0, 0, 0, round(yaw_deg * 100))


def mount_orientation(boot_ms: int, yaw_deg: float) -> Any:
    return mavlink.MAVLink_mount_orientation_message(boot_ms, 0.0, 0.0, yaw_deg)
