"""A gimbal's attitude and the frame of its yaw, as one of its messages tells them; for `gimbal`. Free of state."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from distloc.geometry.rotations import quaternion_from_euler
from distloc.types import FloatArray

RETRACT = mavlink.GIMBAL_DEVICE_FLAGS_RETRACT
NEUTRAL = mavlink.GIMBAL_DEVICE_FLAGS_NEUTRAL
YAW_LOCK = mavlink.GIMBAL_DEVICE_FLAGS_YAW_LOCK
IN_VEHICLE_FRAME = mavlink.GIMBAL_DEVICE_FLAGS_YAW_IN_VEHICLE_FRAME
IN_EARTH_FRAME = mavlink.GIMBAL_DEVICE_FLAGS_YAW_IN_EARTH_FRAME
# Failures after which its attitude is not to be believed; at a limit, or without a manager, it still is.
FAILURES = {
    mavlink.GIMBAL_DEVICE_ERROR_FLAGS_ENCODER_ERROR: "encoder",
    mavlink.GIMBAL_DEVICE_ERROR_FLAGS_POWER_ERROR: "power",
    mavlink.GIMBAL_DEVICE_ERROR_FLAGS_MOTOR_ERROR: "motor",
    mavlink.GIMBAL_DEVICE_ERROR_FLAGS_SOFTWARE_ERROR: "software",
    mavlink.GIMBAL_DEVICE_ERROR_FLAGS_COMMS_ERROR: "communication",
    mavlink.GIMBAL_DEVICE_ERROR_FLAGS_CALIBRATION_RUNNING: "calibration running",
}
_NO_ROTATION = "its attitude is no rotation"


@dataclass(frozen=True, slots=True)
class GimbalAttitude:
    """`q` (4,), unit w, x, y, z, is relative to north, east, down, or to these turned by the vehicle's heading.

    `is_locked` says whether it holds its yaw while the vehicle turns; None where the message does not say.
    """

    q: FloatArray
    is_from_north: bool
    is_locked: bool | None


def attitude_of(message: Any, gives_delta_yaw: bool) -> GimbalAttitude | str:
    """The attitude of a GIMBAL_DEVICE_ATTITUDE_STATUS, MOUNT_ORIENTATION or MOUNT_STATUS, or why it tells none.

    `gives_delta_yaw` says whether the sender was ever heard to know its yaw's zero: 0 is then a value, else unknown.
    """
    kind = message.get_type()
    if kind == "GIMBAL_DEVICE_ATTITUDE_STATUS":
        return _of_device(message, gives_delta_yaw)
    if kind == "MOUNT_ORIENTATION":
        angles_deg = (message.yaw, message.pitch, message.roll)
    else:  # hundredths of a degree: a is pitch, b roll, c yaw
        angles_deg = (message.pointing_c * 1e-2, message.pointing_a * 1e-2, message.pointing_b * 1e-2)
    if not all(map(math.isfinite, angles_deg)):
        return _NO_ROTATION
    return GimbalAttitude(quaternion_from_euler(*np.radians(angles_deg)), False, None)


def has_delta_yaw(message: Any) -> bool:
    """Whether it says how its yaw's zero lies to the vehicle; senders of older definitions leave 0."""
    delta_yaw_rad = getattr(message, "delta_yaw", math.nan)
    return math.isfinite(delta_yaw_rad) and delta_yaw_rad != 0.0


def _of_device(message: Any, gives_delta_yaw: bool) -> GimbalAttitude | str:
    norm = math.hypot(*message.q)
    if not math.isfinite(norm) or not 0.5 < norm < 1.5:
        return _NO_ROTATION
    if failures := [name for flag, name in FAILURES.items() if int(message.failure_flags) & flag]:
        return f"it reports a failure: {', '.join(failures)}"
    is_from_north = _is_from_north(int(message.flags))
    if isinstance(is_from_north, str):
        return is_from_north
    q = np.array(message.q, dtype=np.float64) / norm
    return _about_the_vehicle(q, message, gives_delta_yaw) if is_from_north else _attitude(q, message, False)


def _about_the_vehicle(q_earth: FloatArray, message: Any, gives_delta_yaw: bool) -> GimbalAttitude | str:
    """By delta_yaw, for the gimbal's earth frame may have a zero of its own; from north where that is not known."""
    delta_yaw_rad = float(message.delta_yaw)
    if not gives_delta_yaw and (math.isnan(delta_yaw_rad) or delta_yaw_rad == 0.0):
        return _attitude(q_earth, message, True)
    if not abs(delta_yaw_rad) <= 2.0 * math.pi:
        return f"its delta_yaw is {delta_yaw_rad:g}: radians from -2 pi to 2 pi are wanted"
    # q_earth = q_delta_yaw * q_vehicle: common.xml, GIMBAL_DEVICE_ATTITUDE_STATUS
    return _attitude(_turned_about_down(q_earth, -delta_yaw_rad), message, False)


def _attitude(q: FloatArray, message: Any, is_from_north: bool) -> GimbalAttitude:
    is_locked: bool | None = bool(message.flags & YAW_LOCK) and not message.flags & NEUTRAL
    if int(message.failure_flags) & mavlink.GIMBAL_DEVICE_ERROR_FLAGS_AT_YAW_LIMIT:
        is_locked = None  # at its limit it cannot hold
    return GimbalAttitude(q, is_from_north, is_locked)


def _is_from_north(flags: int) -> bool | str:
    """Whether the yaw is in the earth's frame and not in the vehicle's, or why that cannot be told."""
    if flags & RETRACT:
        return "it is retracted"
    frames = flags & (IN_EARTH_FRAME | IN_VEHICLE_FRAME)
    if frames == IN_EARTH_FRAME | IN_VEHICLE_FRAME:
        return "its flags name both the earth's and the vehicle's frame for its yaw"
    if frames:
        return bool(frames == IN_EARTH_FRAME)
    if flags & NEUTRAL and flags & YAW_LOCK:
        return "its flags do not tell the frame of its yaw: neutral and locked"
    return bool(flags & YAW_LOCK)  # older senders: the lock tells the frame


def _turned_about_down(q: FloatArray, yaw_rad: float) -> FloatArray:
    """The quaternion (4,) with a turn about down put before it."""
    c, s = math.cos(yaw_rad / 2.0), math.sin(yaw_rad / 2.0)
    w, x, y, z = q
    return np.array([c * w - s * z, c * x - s * y, c * y + s * x, c * z + s * w])
