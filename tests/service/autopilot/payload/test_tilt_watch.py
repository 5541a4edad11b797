"""Pitch and roll that are from the body are found by the vehicle's tilts; those from the horizon never are."""

import math
from typing import Any

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from distloc.geometry.rotations import euler_from_quaternion, quaternion_from_euler
from distloc.types import CameraPose, RejectReason
from service.autopilot.payload.tilt_watch import TiltWatch
from tests.service.autopilot.payload.rig import MS, START_MS, Rig, device

HEADING_RAD = 1.0


def tilts_rad(boot_ms: int) -> tuple[float, float]:
    """Pitch and roll of a copter that speeds up, slows down and leans, within 8 degrees."""
    t_s = (boot_ms - START_MS) * 1e-3
    return math.radians(8.0) * math.sin(0.9 * t_s), math.radians(5.0) * math.sin(0.6 * t_s + 1.0)


def flown(
    share: float, flags: int, pan_rad: float = 0.5, heading: float = HEADING_RAD, *, is_from_nose: bool | None = None
) -> Rig:
    """`share` of the vehicle's tilts is in the gimbal's angles, about the vehicle's axes; the flags may be wrong."""
    rig = Rig()
    for boot_ms in range(START_MS, START_MS + 15_000, 20):
        rig.boot_ms = boot_ms
        pitch_rad, roll_rad = tilts_rad(boot_ms)
        q = quaternion_from_euler(heading, pitch_rad, roll_rad)
        yaw, pitch, roll = euler_from_quaternion(q)
        rig.hear(mavlink.MAVLink_attitude_message(boot_ms, roll, pitch, yaw, math.nan, math.nan, math.nan))
        rig.hear(mavlink.MAVLink_global_position_int_message(boot_ms, 4 * 10**8, 3 * 10**7, 10**5, 0, 0, 0, 0, 0))
        zero_rad = 0.0 if (not flags & 64 if is_from_nose is None else is_from_nose) else heading
        base = quaternion_from_euler(zero_rad, share * pitch_rad, share * roll_rad)
        rig.hear(device(boot_ms, flags=flags, q=product(base, quaternion_from_euler(pan_rad, -0.1, 0.0))))
        if boot_ms % 1000 == 0:
            rig.hear(mavlink.MAVLink_heartbeat_message(2, 3, 0, 0, 4, 3))
    return rig


def product(p: Any, q: Any) -> Any:
    (w, x, y, z), v = p, q
    return np.array([[w, -x, -y, -z], [x, w, -z, y], [y, z, w, -x], [z, -y, x, w]]) @ v


@pytest.mark.parametrize("flags", [32 | 12, 64 | 16 | 12])
@pytest.mark.parametrize(("share", "is_from_body"), [(-1.0, True), (0.0, False), (1.0, False), (-0.3, False)])
def test_the_tilts_tell(share: float, is_from_body: bool, flags: int) -> None:
    rig = flown(share, flags)
    found = rig.look()
    assert ("gimbal" in rig.degraded()) is (found is RejectReason.GIMBAL_UNKNOWN) is is_from_body
    if is_from_body:
        assert "are from the body: they undo each tilt" in str(rig.autopilot.counters()["gimbal"])
    else:
        assert isinstance(found, CameraPose) or found is RejectReason.TURNING


@pytest.mark.parametrize("is_from_nose", [True, False])
@pytest.mark.parametrize("flags", [32 | 12, 64 | 16 | 12])
def test_a_camera_that_tilts_along_tells_the_frame_of_its_yaw(flags: int, is_from_nose: bool) -> None:
    rig = flown(1.0, flags, heading=1.6, is_from_nose=is_from_nose)
    is_wrong = is_from_nose is bool(flags & 64)
    assert ("gimbal" in rig.degraded()) is (rig.look() is RejectReason.GIMBAL_UNKNOWN) is is_wrong
    assert ("in the other frame than its flags say" in str(rig.autopilot.counters()["gimbal"])) is is_wrong


def test_what_a_tilt_told_of_the_frame_holds_until_the_flags_change() -> None:
    rig = flown(1.0, 64 | 16 | 12, heading=1.6, is_from_nose=True)
    for boot_ms in range(rig.boot_ms, rig.boot_ms + 5_000, 20):
        rig.boot_ms = boot_ms
        rig.hear(mavlink.MAVLink_attitude_message(boot_ms, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0))
        rig.hear(device(boot_ms, flags=64 | 16 | 12))
    assert "gimbal" in rig.degraded()
    for boot_ms in range(rig.boot_ms, rig.boot_ms + 5_000, 20):
        rig.boot_ms = boot_ms
        rig.hear(mavlink.MAVLink_attitude_message(boot_ms, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0))
        rig.hear(device(boot_ms, flags=32 | 12))
    assert "gimbal" not in rig.degraded()


def test_a_vehicle_that_lies_still_says_nothing() -> None:
    watch, still = TiltWatch(), np.eye(3)
    for step in range(100):
        watch.take(step * 1000 * MS, still, still, still)
    assert not watch.is_contradicted and not watch.is_yaw_contradicted
