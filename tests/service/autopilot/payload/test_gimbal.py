"""Which gimbal is followed, in which frame and by which clock; and that it is named where that is not known."""

import math
from typing import Any

import pytest

from distloc.types import RejectReason
from tests.service.autopilot.payload.rig import (
    START_MS,
    Message,
    Rig,
    device,
    mount_orientation,
    mount_status,
)

NAN, INF = math.nan, math.inf
UNKNOWN = RejectReason.GIMBAL_UNKNOWN
RETRACT, NEUTRAL, ROLL_LOCK, PITCH_LOCK, LOCK, VEHICLE, EARTH = 1, 2, 4, 8, 16, 32, 64
HEADING_DEG, YAW_DEG = 70.0, 25.0
FROM_NORTH, FROM_NOSE = YAW_DEG, HEADING_DEG + YAW_DEG
LOCKS = ROLL_LOCK | PITCH_LOCK


def flown(message: Message, *, component: int = 1, interval_ms: int = 40, **options: Any) -> Rig:
    rig = Rig(**options)
    rig.fly(3.0, lambda boot_ms: HEADING_DEG, [(component, interval_ms, message)])
    return rig


@pytest.mark.parametrize(
    ("flags", "delta_yaw_deg", "expected"),
    [
        (VEHICLE, NAN, FROM_NOSE),
        (VEHICLE | LOCKS, 0.0, FROM_NOSE),
        (VEHICLE | LOCK, NAN, FROM_NOSE),
        (VEHICLE | LOCK, 130.0, FROM_NOSE),
        (VEHICLE | NEUTRAL, NAN, FROM_NOSE),
        (EARTH, NAN, FROM_NORTH),
        (EARTH | LOCK | LOCKS, 0.0, FROM_NORTH),
        (EARTH | NEUTRAL, NAN, FROM_NORTH),
        (EARTH | LOCK, HEADING_DEG, FROM_NORTH),
        (EARTH | LOCK, HEADING_DEG + 40.0, FROM_NORTH - 40.0),  # its zero lies 40 degrees west of north
        (EARTH, HEADING_DEG - 360.0, FROM_NORTH),
        (LOCK, HEADING_DEG + 40.0, FROM_NORTH - 40.0),
        (0, NAN, FROM_NOSE),
        (LOCKS, 0.0, FROM_NOSE),
        (LOCK | LOCKS, NAN, FROM_NORTH),  # older senders
        (NEUTRAL, NAN, FROM_NOSE),
        (NEUTRAL | LOCK, NAN, UNKNOWN),
        (EARTH | VEHICLE, NAN, UNKNOWN),
        (EARTH | VEHICLE | LOCK, HEADING_DEG, UNKNOWN),
        (RETRACT, NAN, UNKNOWN),
        (RETRACT | VEHICLE, NAN, UNKNOWN),
        (EARTH | LOCK, INF, UNKNOWN),
        (EARTH | LOCK, 7000.0, UNKNOWN),
    ],
)
def test_the_frame_of_the_yaw(flags: int, delta_yaw_deg: float, expected: float | RejectReason) -> None:
    rig = flown(lambda boot_ms: device(boot_ms, YAW_DEG, flags, delta_yaw_deg=delta_yaw_deg))
    found = rig.azimuth_deg()
    if isinstance(expected, RejectReason):
        assert found is expected and "gimbal" in rig.degraded()
    else:
        assert found == pytest.approx(expected % 360.0, abs=1e-3) and "gimbal" not in rig.degraded()


def test_a_zero_that_was_given_and_is_not_any_more_is_not_taken_for_north() -> None:
    rig = flown(lambda boot_ms: device(boot_ms, YAW_DEG, EARTH, delta_yaw_deg=HEADING_DEG + 40.0))
    rig.fly(3.0, lambda boot_ms: HEADING_DEG, [(1, 40, lambda boot_ms: device(boot_ms, YAW_DEG, EARTH))])
    assert rig.azimuth_deg() is UNKNOWN and "gimbal" in rig.degraded()


@pytest.mark.parametrize(
    "broken",
    [
        {"q": [NAN] * 4},
        {"q": [0.0] * 4},
        {"q": [INF, 0.0, 0.0, 0.0]},
        {"failures": 8},
        {"failures": 32},
        {"failures": 128},
        {"failures": 256},
    ],
)
def test_what_tells_no_attitude_is_named_and_comes_back(broken: dict[str, Any]) -> None:
    rig = flown(device)
    assert "gimbal" not in rig.degraded()
    rig.fly(2.9, gimbals=[(1, 40, lambda boot_ms: device(boot_ms, **broken))])
    assert rig.azimuth_deg() is UNKNOWN and "gimbal" in rig.degraded()
    rig.fly(1.0, gimbals=[(1, 40, device)])
    assert rig.azimuth_deg() == pytest.approx(0.0) and "gimbal" not in rig.degraded()


@pytest.mark.parametrize("limit", [1, 2, 4, 512])
def test_a_gimbal_at_its_limit_is_still_believed(limit: int) -> None:
    assert flown(lambda boot_ms: device(boot_ms, failures=limit)).azimuth_deg() == pytest.approx(HEADING_DEG)


def test_a_silent_and_a_slow_gimbal_are_named_within_three_seconds() -> None:
    silent = Rig()
    silent.fly(2.9)
    assert "gimbal" in silent.degraded() and silent.look() is UNKNOWN
    assert flown(device, interval_ms=1000).degraded() >= {"gimbal"}
    without = Rig(gimbal=False)
    without.fly(3.0)
    assert "gimbal" not in without.degraded() and without.azimuth_deg() == pytest.approx(0.0)


@pytest.mark.parametrize("component", [1, 154])
def test_attitudes_without_a_time_are_timed_by_arrival_and_reboot_nothing(component: int) -> None:
    rig = flown(lambda boot_ms: device(0), component=component)
    assert rig.azimuth_deg() == pytest.approx(HEADING_DEG) and rig.autopilot.epoch == 0


@pytest.mark.parametrize("own_ms", [-99_000, 5_000_000, 2**32 - START_MS - 1000])
def test_a_gimbal_of_its_own_component_has_its_own_clock(own_ms: int) -> None:
    """It pans at 10 deg/s and stamps by a clock that started at another time and, in the last case, wraps."""
    rig = Rig()

    def panning(boot_ms: int) -> Any:
        return device((boot_ms + own_ms) % 2**32 or 1, 0.01 * (boot_ms - START_MS))

    rig.fly(4.0, gimbals=[(154, 40, panning)])
    assert rig.azimuth_deg(400) == pytest.approx(0.01 * (rig.boot_ms - 400 - START_MS), abs=0.1)
    assert rig.autopilot.epoch == 0 and "gimbal" not in rig.degraded()
    assert rig.autopilot.counters()["gimbal"] == {"followed": 154, "heard": [154], "fault": ""}


def test_a_gimbal_that_restarts_is_taken_again() -> None:
    rig = flown(lambda boot_ms: device(boot_ms + 500_000), component=154)
    rig.fly(3.0, gimbals=[(154, 40, lambda boot_ms: device(boot_ms - START_MS))])
    assert rig.azimuth_deg() == pytest.approx(0.0) and rig.autopilot.epoch == 0


def test_an_autopilot_that_relays_a_foreign_clock_is_not_taken_to_reboot() -> None:
    rig = flown(lambda boot_ms: device(boot_ms - 99_000))
    assert rig.azimuth_deg() == pytest.approx(HEADING_DEG) and rig.autopilot.epoch == 0


@pytest.mark.parametrize("component", [1, 154])
def test_older_messages_count_until_the_newer_one_is_heard(component: int) -> None:
    rig = Rig()
    rig.fly(1.0, gimbals=[(component, 100, lambda boot_ms: mount_status(-90.0))])
    assert rig.azimuth_deg() == pytest.approx(270.0)
    older = (component, 100, lambda boot_ms: mount_status(-90.0))
    rig.fly(1.0, gimbals=[older, (component, 40, lambda boot_ms: mount_orientation(boot_ms, 45.0))])
    assert rig.azimuth_deg() == pytest.approx(45.0, abs=1e-6)
    rig.fly(1.0, gimbals=[older, (component, 40, lambda boot_ms: device(boot_ms, 20.0))])
    assert rig.azimuth_deg() == pytest.approx(20.0, abs=1e-3) and "gimbal" not in rig.degraded()


def two(first: int, second: int, first_id: int = 0, second_id: int = 0) -> list[tuple[int, int, Message]]:
    return [
        (first, 40, lambda boot_ms: device(boot_ms, 10.0, device_id=first_id)),
        (second, 40, lambda boot_ms: device(boot_ms, 50.0, device_id=second_id)),
    ]


@pytest.mark.parametrize(
    ("gimbals", "ids"),
    [
        (two(1, 1, 1, 2), (1, 2)),
        (two(154, 171), (154, 171)),
        (two(1, 154), (1, 154)),
        (two(154, 171, 1, 1), (154, 171)),
    ],
)
def test_two_gimbals_are_never_mixed(gimbals: list[tuple[int, int, Message]], ids: tuple[int, int]) -> None:
    rig = Rig()
    rig.fly(1.0, gimbals=gimbals)
    assert rig.look() is UNKNOWN and "gimbal" in rig.degraded()
    assert rig.autopilot.counters()["gimbal"] == {
        "followed": None,
        "heard": list(ids),
        "fault": f"gimbals {ids[0]}, {ids[1]} are heard: camera.mount.gimbal_device must be one of them",
    }
    for wanted, azimuth_deg in zip(ids, (10.0, 50.0), strict=True):
        rig = Rig(gimbal_device=wanted)
        rig.fly(3.0, gimbals=gimbals)
        assert rig.azimuth_deg() == pytest.approx(azimuth_deg, abs=1e-3) and "gimbal" not in rig.degraded()


def test_a_gimbal_that_fell_silent_is_not_replaced_by_another() -> None:
    first, second = two(154, 171)
    rig = Rig()
    rig.fly(2.0, gimbals=[first])
    rig.fly(5.0, gimbals=[second])
    assert rig.look() is UNKNOWN and "gimbal" in rig.degraded()
    named = Rig(gimbal_device=154)
    named.fly(5.0, gimbals=[second])
    assert named.look() is UNKNOWN and "gimbal" in named.degraded()
    assert "no attitude of gimbal 154 at 2 Hz or more, only of 171" in str(named.autopilot.counters()["gimbal"])


def test_one_odd_message_makes_no_second_gimbal_and_many_grow_nothing() -> None:
    rig = flown(lambda boot_ms: device(boot_ms, device_id=1))
    rig.hear(device(rig.boot_ms, 50.0, device_id=5))
    assert rig.azimuth_deg() == pytest.approx(HEADING_DEG)
    for component in range(2, 100):
        rig.hear(device(rig.boot_ms, 50.0), component)
    assert rig.azimuth_deg() == pytest.approx(HEADING_DEG)
    assert len(rig.autopilot.camera.gimbal.heard._counts) <= 9  # type: ignore[union-attr]
    rig.hear(device(rig.boot_ms, 50.0), 154, system=9)
    assert rig.autopilot.ignored["foreign"] == 1


@pytest.mark.parametrize(("flags", "component"), [(VEHICLE, 1), (VEHICLE, 154), (EARTH | LOCK, 1), (EARTH | LOCK, 154)])
def test_frames_are_refused_while_the_gimbal_turns_fast(flags: int, component: int) -> None:
    rig = Rig()
    rig.fly(1.0, gimbals=[(component, 40, lambda boot_ms: device(boot_ms, 0.0, flags))])
    start_ms = rig.boot_ms
    rig.fly(1.0, gimbals=[(component, 40, lambda boot_ms: device(boot_ms, 0.06 * (boot_ms - start_ms), flags))])
    assert rig.look() is RejectReason.TURNING
    rig.fly(1.0, gimbals=[(component, 40, lambda boot_ms: device(boot_ms, 60.0, flags))])
    assert rig.azimuth_deg() == pytest.approx(60.0, abs=1e-3)


def test_a_gimbal_heard_once_a_second_shows_no_slew_and_gives_no_pose() -> None:
    rig = Rig()
    rig.fly(2.2, gimbals=[(1, 1000, lambda boot_ms: device(boot_ms, 0.06 * (boot_ms - START_MS)))])
    rig.boot_ms += 300
    assert rig.autopilot.camera_pose(rig.now_ns - 450 * 10**6, rig.now_ns) is UNKNOWN


def test_a_held_camera_above_a_vehicle_that_turns() -> None:
    """A yaw from north goes on; one from the nose, which is added up from two messages, does not."""
    for flags, gimbal_rate, expected in ((EARTH | LOCK, 0.0, 0.0), (VEHICLE | LOCK, -0.02, RejectReason.TURNING)):
        rig = Rig()
        turned = [(1, 40, lambda boot_ms, f=flags, r=gimbal_rate: device(boot_ms, r * (boot_ms - START_MS), f))]
        rig.fly(3.0, lambda boot_ms: 0.02 * (boot_ms - START_MS), turned)
        assert rig.azimuth_deg() == expected
