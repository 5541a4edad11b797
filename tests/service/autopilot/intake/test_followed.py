"""Whose autopilot is followed where the config names none."""

import logging

import pytest

from distloc.types import CameraPose
from service.autopilot.intake.followed import MOST_SYSTEMS, Followed
from service.config.sections import MavlinkConfig
from tests.service.autopilot.test_autopilot import MS, OFFSET_NS, Vehicle

S = 1_000_000_000
STRAY = 42


def fly(vehicle: Vehicle, start_ms: int, end_ms: int, system: int = 1) -> None:
    """A second's heartbeat and the poses in it, again and again."""
    for boot_ms in range(start_ms, end_ms, 1000):
        vehicle.heartbeat(boot_ms, system)
        if system == 1:
            vehicle.gps(boot_ms)
        vehicle.fly(boot_ms, system=system)


def test_one_stray_heartbeat_does_not_lock_ours_out(caplog: pytest.LogCaptureFixture) -> None:
    vehicle = Vehicle()
    with caplog.at_level(logging.INFO):
        vehicle.heartbeat(500, STRAY)
        fly(vehicle, 1000, 8000)
    assert vehicle.autopilot.target_system == 1 and isinstance(vehicle.look(7500), CameraPose)
    assert vehicle.autopilot.epoch == 0
    told = [record.getMessage() for record in caplog.records if "following system" in record.getMessage()]
    assert len(told) == 2 and "following system 1" in told[1] and "system 42" in told[1]


def test_a_stray_that_never_gives_a_pose_is_let_go_of_for_one_that_does() -> None:
    vehicle = Vehicle()
    for boot_ms in range(0, 20_000, 1000):
        vehicle.heartbeat(boot_ms, STRAY)
        fly(vehicle, boot_ms, boot_ms + 1000)
    assert vehicle.autopilot.target_system == 1 and isinstance(vehicle.look(19_500), CameraPose)


def test_of_two_that_only_beat_each_gets_its_turn_to_be_asked() -> None:
    vehicle, asked = Vehicle(), set()
    for boot_ms in range(0, 30_000, 500):
        vehicle.heartbeat(boot_ms, STRAY)
        vehicle.heartbeat(boot_ms, 1)
        vehicle.autopilot.due(boot_ms * MS + OFFSET_NS)
        asked.add(vehicle.autopilot.target_system)
    assert asked == {1, STRAY}


def test_a_second_vehicle_with_poses_does_not_take_over_even_when_ours_falls_silent() -> None:
    vehicle = Vehicle()
    fly(vehicle, 0, 3000)
    for boot_ms in range(3000, 60_000, 1000):
        vehicle.heartbeat(boot_ms, 2)
        vehicle.fly(boot_ms, system=2)
    assert vehicle.autopilot.target_system == 1
    assert "link" in vehicle.autopilot.degraded(60_000 * MS + OFFSET_NS)


def test_what_the_stray_said_is_forgotten() -> None:
    vehicle = Vehicle()
    vehicle.heartbeat(500, STRAY)
    vehicle.ekf(500, 0)  # of system 1, not followed
    vehicle.offset_ns += 900 * S  # ours has been up for another time
    fly(vehicle, 5000, 9000)
    autopilot = vehicle.autopilot
    assert isinstance(vehicle.look(8500), CameraPose) and autopilot.epoch == 0
    assert autopilot.frame_enu is not None and autopilot.frame_enu.origin[0] == pytest.approx(40.0)


def test_a_system_that_the_config_names_is_never_let_go_of() -> None:
    vehicle = Vehicle(config=MavlinkConfig(target_system=7))
    fly(vehicle, 0, 30_000)
    assert vehicle.autopilot.target_system == 7 and not vehicle.autopilot.is_connected(30_000 * MS + OFFSET_NS)


def test_the_table_of_others_is_bounded() -> None:
    followed = Followed(0)
    for system in range(1, 200):
        followed.heartbeat(system, system)
    assert followed.system == 1 and len(followed._others) == MOST_SYSTEMS
