"""A yaw that contradicts its flags is found by a turn of the vehicle, and only then."""

import math

import pytest

from distloc.types import CameraPose, RejectReason
from service.commands.check.payload import payload_findings
from tests.service.autopilot.payload.rig import START_MS, Rig, device, mount_status

LOCK, VEHICLE, EARTH = 16, 32, 64
UNKNOWN = RejectReason.GIMBAL_UNKNOWN
RATE_DEG_PER_MS = 0.010


def heading_deg(boot_ms: int) -> float:
    """Straight on for a second, a turn by 60 degrees at 10 deg/s, straight on."""
    return 30.0 + min(max(boot_ms - START_MS - 1000, 0) * RATE_DEG_PER_MS, 60.0)


def turned(flags: int, share: float, *, delay_ms: int = 0, jitter_deg: float = 0.0, failures: int = 0) -> Rig:
    """`share` of the vehicle's turn is what the gimbal's yaw, as it is sent, turns by."""
    rig = Rig()

    def message(boot_ms: int) -> object:
        wobble_deg = jitter_deg * math.sin(boot_ms)
        yaw_deg = 15.0 + share * (heading_deg(boot_ms - delay_ms) - 30.0) + wobble_deg
        return device(boot_ms, yaw_deg, flags, failures=failures)

    rig.fly(8.0, heading_deg, [(1, 40, message)])
    return rig


@pytest.mark.parametrize(
    ("flags", "share", "is_contradicted"),
    [
        (VEHICLE, 0.0, False),
        (VEHICLE, -1.0, False),  # it tracks something far away
        (VEHICLE, 1.0, True),  # from north, and it follows
        (VEHICLE | LOCK, -1.0, False),
        (VEHICLE | LOCK, 0.0, True),  # from north and held
        (EARTH | LOCK, 0.0, False),
        (EARTH | LOCK, 1.0, False),  # it cannot hold
        (EARTH | LOCK, -1.0, True),  # from the nose and held
        (EARTH, 1.0, False),
        (EARTH, 0.0, True),  # from the nose, and it follows
        (EARTH, 0.5, False),
        (LOCK, 0.0, False),
        (LOCK, -1.0, True),  # ArduPilot before the frame flags
        (0, 0.0, False),
    ],
)
@pytest.mark.parametrize(("delay_ms", "jitter_deg"), [(0, 0.0), (100, 0.3)])
def test_the_turn_tells(flags: int, share: float, is_contradicted: bool, delay_ms: int, jitter_deg: float) -> None:
    rig = turned(flags, share, delay_ms=delay_ms, jitter_deg=jitter_deg)
    assert ("gimbal" in rig.degraded()) is is_contradicted
    assert (rig.look() is UNKNOWN) is is_contradicted
    (finding,) = payload_findings(rig.autopilot, rig.now_ns)
    if is_contradicted:
        assert str(finding).startswith("fail  gimbal: the yaw of gimbal 1 moves against its flags when the vehicle")
    else:
        assert finding.level == "ok" and "a turn has borne it out" in finding.said


def test_without_a_turn_nothing_is_told_and_the_doctor_says_so() -> None:
    rig = Rig()
    rig.fly(3.0, gimbals=[(1, 40, lambda boot_ms: device(boot_ms, 15.0, VEHICLE | LOCK))])
    assert isinstance(rig.look(), CameraPose) and rig.degraded() <= {"clock"}
    (finding,) = payload_findings(rig.autopilot, rig.now_ns)
    assert "yaw from the vehicle's nose: turn the vehicle by 30 degrees to try that" in str(finding)


@pytest.mark.parametrize(("rate_deg_s", "yaw_deg"), [(4.0, 0.0), (4.0, 30.0), (10.0, 90.0), (-10.0, -80.0)])
def test_a_locked_gimbal_held_on_a_place_that_the_vehicle_flies_around_is_believed(
    rate_deg_s: float, yaw_deg: float
) -> None:
    """Its yaw from the nose stands still, as that of one from north would which is held."""
    rig = Rig()
    circling = [(1, 40, lambda boot_ms: device(boot_ms, yaw_deg, VEHICLE | LOCK))]
    rig.fly(10.0, lambda boot_ms: rate_deg_s * 1e-3 * (boot_ms - START_MS), circling)
    assert "gimbal" not in rig.degraded() and isinstance(rig.look(), CameraPose)


def test_a_later_turn_that_bears_the_flags_out_gives_the_poses_back() -> None:
    rig = turned(EARTH | LOCK, -1.0)
    assert rig.look() is UNKNOWN
    start_ms = rig.boot_ms

    def back_deg(boot_ms: int) -> float:
        return 90.0 - min((boot_ms - start_ms) * RATE_DEG_PER_MS, 150.0)

    rig.fly(17.0, back_deg, [(1, 40, lambda boot_ms: device(boot_ms, -45.0, EARTH | LOCK))])
    assert isinstance(rig.look(), CameraPose) and "gimbal" not in rig.degraded()


def test_a_gimbal_at_its_yaw_limit_cannot_hold_and_contradicts_nothing() -> None:
    assert "gimbal" not in turned(VEHICLE | LOCK, 0.0, failures=4).degraded()


def test_a_heading_that_jumps_says_nothing_of_the_gimbal() -> None:
    rig = Rig()
    for step in range(6):  # by 12 degrees each, and the gyroscopes do not turn
        rig.fly(1.0, lambda boot_ms, s=step: 12.0 * s, [(1, 40, lambda boot_ms: device(boot_ms, 15.0, VEHICLE | LOCK))])  # type: ignore[misc]
    assert "gimbal" not in rig.degraded()


def test_mount_status_from_north_that_follows_is_found() -> None:
    rig = Rig()
    rig.fly(8.0, heading_deg, [(1, 100, lambda boot_ms: mount_status(heading_deg(boot_ms)))])
    assert rig.look() is UNKNOWN and "gimbal" in rig.degraded()


def test_a_gimbal_that_the_config_does_not_know_of_is_told_by_the_doctor() -> None:
    rig = Rig(gimbal=False)
    rig.fly(1.0, gimbals=[(154, 40, device)])
    (finding,) = payload_findings(rig.autopilot, rig.now_ns)
    assert str(finding).startswith("warn  gimbal: GIMBAL_DEVICE_ATTITUDE_STATUS is heard, but camera.mount.gimbal is")
