"""The autopilot's follower on made-up streams and on real recordings."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from distloc.types import CameraPose, RejectReason
from service.autopilot.autopilot import Autopilot
from service.autopilot.boot_clock import BootClock
from service.autopilot.poses import PoseHistory
from service.common.messages import MavFrame
from service.config.sections import MavlinkConfig, MountConfig
from service.mavlink.framer import Framer, decode
from service.recordings.tlog import read_tlog
from tests.support.places import DATA

needs_data = pytest.mark.skipif(not DATA.is_dir(), reason="no recordings beside the repository")
MS = 1_000_000
OFFSET_NS = 7_000_000_000_000


class Vehicle:
    """Feeds an Autopilot with messages of a system at a time since boot."""

    def __init__(self, **options: Any) -> None:
        self.mount = options.pop("mount", MountConfig())
        self.autopilot = Autopilot(options.pop("config", MavlinkConfig()), self.mount, **options)
        self.offset_ns = OFFSET_NS

    def send(self, message: Any, boot_ms: int, system: int = 1, component: int = 1) -> None:
        (frame,) = Framer().feed(bytes(message.pack(mavlink.MAVLink(None, system, component))))
        self.autopilot.receive(frame, boot_ms * MS + self.offset_ns)

    def heartbeat(self, boot_ms: int, system: int = 1, autopilot: int = 3) -> None:
        self.send(mavlink.MAVLink_heartbeat_message(2, autopilot, 0, 0, 4, 3), boot_ms, system)

    def gps(self, boot_ms: int, fix: int = 3) -> None:
        self.send(mavlink.MAVLink_gps_raw_int_message(0, fix, 0, 0, 100_000, 0, 0, 0, 0, 9, 147_000), boot_ms)

    def ekf(self, boot_ms: int, flags: int) -> None:
        self.send(mavlink.MAVLink_ekf_status_report_message(flags, 0, 0, 0, 0, 0), boot_ms)

    def estimator(self, boot_ms: int, flags: int) -> None:
        self.send(mavlink.MAVLink_estimator_status_message(0, flags, 0, 0, 0, 0, 0, 0, 0, 0), boot_ms)

    def pose(self, boot_ms: int, lat: float = 40.0, lon: float = 3.0, yaw: float = 0.0, system: int = 1) -> None:
        wrapped_ms = boot_ms % 2**32
        self.send(mavlink.MAVLink_attitude_message(wrapped_ms, 0, 0, yaw, 0, 0, 0), boot_ms, system)
        place = (round(lat * 1e7), round(lon * 1e7), 100_000, 50_000)
        message = mavlink.MAVLink_global_position_int_message(wrapped_ms, *place, 0, 0, 0, 0)
        self.send(message, boot_ms, system)

    def fly(self, start_ms: int, count: int = 20, **options: Any) -> None:
        for boot_ms in range(start_ms, start_ms + 50 * count, 50):
            self.pose(boot_ms, **options)

    def look(self, boot_ms: int, later_ms: int = 1000) -> CameraPose | RejectReason | None:
        at_ns = boot_ms * MS + self.offset_ns
        return self.autopilot.camera_pose(at_ns, at_ns + later_ms * MS)


def started(**options: Any) -> Vehicle:
    vehicle = Vehicle(**options)
    vehicle.heartbeat(1000)
    vehicle.gps(1000)
    return vehicle


def test_level_camera_looks_north_from_its_lever_arm() -> None:
    vehicle = started(mount=MountConfig(forward_m=2.0, down_m=0.5))
    vehicle.fly(1000)
    pose = vehicle.look(1500)
    assert isinstance(pose, CameraPose)
    np.testing.assert_allclose(pose.R_cam_from_enu @ [0, 1, 0], [0, 0, 1], atol=1e-9)
    np.testing.assert_allclose(pose.position_enu_m, [0, 2, -0.5], atol=1e-3)
    assert vehicle.autopilot.place.geoid_undulation_m == pytest.approx(47.0)


@pytest.mark.parametrize(
    ("fix", "flags", "lat", "lon", "reason"),
    [
        (1, None, 40.0, 3.0, RejectReason.NO_FIX),
        (3, 167, 40.0, 3.0, RejectReason.EKF_UNHEALTHY),
        (3, 831 | 1024, 40.0, 3.0, RejectReason.EKF_UNHEALTHY),
        (3, 831, 0.0, 0.0, RejectReason.POSITION_INVALID),
        (3, None, 0.0001, 0.0, RejectReason.POSITION_INVALID),
        (3, 831, 95.0, 3.0, RejectReason.POSITION_INVALID),
    ],
)
def test_no_pose_without_a_good_position(fix: int, flags: int | None, lat: float, lon: float, reason: str) -> None:
    vehicle = Vehicle()
    vehicle.heartbeat(1000)
    vehicle.gps(1000, fix)
    if flags is not None:
        vehicle.ekf(1000, flags)
    vehicle.fly(1000, lat=lat, lon=lon)
    assert vehicle.look(1500) is reason and vehicle.autopilot.frame_enu is None
    assert vehicle.autopilot.rejects == {reason: 20}


@pytest.mark.parametrize(
    ("ekf", "estimator", "is_refused"),
    [
        (None, 831, False),
        (None, 831 & ~16, True),
        (None, 831 & ~1, True),
        (None, 831 | 128, True),
        (None, 831 | 1024, True),
        (None, 831 | 2048, True),
        (831, 831, False),
        (831, 831 | 128, True),
        (831 | 128, 831, True),
    ],
)
def test_px4s_word_on_its_estimate_counts_and_of_two_the_worse(
    ekf: int | None, estimator: int, is_refused: bool
) -> None:
    vehicle = started()
    vehicle.fly(1000)
    if ekf is not None:
        vehicle.ekf(2000, ekf)
    vehicle.estimator(2000, estimator)
    vehicle.fly(2000, count=60)
    assert vehicle.autopilot.rejects[RejectReason.EKF_UNHEALTHY] == 60 * is_refused
    assert (vehicle.look(4900) is RejectReason.EKF_UNHEALTHY) == is_refused
    assert ("ekf" in vehicle.autopilot.degraded(5000 * MS + OFFSET_NS)) == is_refused
    vehicle.fly(15_000)  # a word older than 10 s says nothing of the position: the fix counts
    assert vehicle.autopilot.rejects[RejectReason.EKF_UNHEALTHY] == 60 * is_refused


def test_non_finite_attitude_and_foreign_poses_are_counted() -> None:
    vehicle = started()
    vehicle.fly(1000, yaw=float("nan"))
    assert vehicle.autopilot.rejects[RejectReason.ATTITUDE_INVALID] == 20
    vehicle.fly(1000, system=2)
    assert vehicle.autopilot.ignored["foreign"] == 40


def test_a_ground_station_is_no_autopilot_and_the_config_picks_a_system() -> None:
    vehicle = Vehicle(config=MavlinkConfig(target_system=7))
    vehicle.heartbeat(1000, system=1)
    vehicle.heartbeat(1000, system=7, autopilot=8)
    assert not vehicle.autopilot.is_connected(1000 * MS + OFFSET_NS)
    vehicle.heartbeat(1000, system=7)
    assert vehicle.autopilot.is_connected(3999 * MS + OFFSET_NS)
    assert "link" in vehicle.autopilot.degraded(4001 * MS + OFFSET_NS)


def test_pose_across_the_wrap_of_time_boot_ms() -> None:
    vehicle = started()
    wrap_ms = 2**32
    vehicle.fly(wrap_ms - 500)
    assert isinstance(vehicle.look(wrap_ms - 10), CameraPose) and isinstance(vehicle.look(wrap_ms + 220), CameraPose)
    assert vehicle.autopilot.epoch == 0


def test_boot_clock_takes_the_wraps_from_timesync() -> None:
    clock = BootClock()
    assert clock.update(5000, 0) == 5000 * MS
    assert clock.align((2**32 + 5010) * MS) and not clock.align((2**32 + 5020) * MS)
    assert clock.update(5100, 100 * MS) == (2**32 + 5100) * MS and not clock.take_reboot()


def test_reboot_is_confirmed_and_a_slow_second_link_is_none() -> None:
    vehicle = started()
    vehicle.fly(100_000)
    for step in range(30):  # every newer sample is followed by one 2 s old
        vehicle.pose(101_000 + 50 * step)
        vehicle.pose(99_000 + 50 * step)
    assert vehicle.autopilot.epoch == 0
    vehicle.offset_ns += 120_000 * MS
    vehicle.fly(2_000)
    vehicle.gps(3_000)
    vehicle.fly(3_000)
    assert vehicle.autopilot.epoch == 1 and isinstance(vehicle.look(3_500), CameraPose)


@pytest.mark.parametrize("ahead_ms", [2_000, 59_000, 61_000, 600_000])
def test_one_attitude_from_the_future_changes_nothing(ahead_ms: int) -> None:
    vehicle = started()
    vehicle.fly(100_000)
    before = vehicle.autopilot.poses.attitude_count
    vehicle.send(mavlink.MAVLink_attitude_message(101_000 + ahead_ms, 0, 0, 1.0, 0, 0, 0), 101_000)
    assert vehicle.autopilot.poses.attitude_count == before
    vehicle.fly(101_000)
    assert vehicle.autopilot.epoch == 0 and isinstance(vehicle.look(101_500), CameraPose)


def test_boot_clock_follows_a_step_ahead_that_later_times_bear_out() -> None:
    clock = BootClock()
    assert clock.update(5000, 0) == 5000 * MS
    assert [clock.update(25_000 + 20 * k, 20 * k * MS) for k in range(3)] == [None, None, 25_040 * MS]
    assert clock.update(25_060, 60 * MS) == 25_060 * MS and not clock.take_reboot()


def sent(autopilot: Autopilot, now_ns: int) -> list[MavFrame]:
    return [frame for data in autopilot.due(now_ns) for frame in Framer().feed(data)]


def test_requests_timesync_and_rates_and_answers() -> None:
    vehicle = Vehicle()
    assert vehicle.autopilot.due(0) == []
    vehicle.heartbeat(1000)
    vehicle.send(mavlink.MAVLink_timesync_message(0, 1234), 1000)
    asked, sync = [], 0
    for boot_ms in range(1000, 4000, 10):
        for frame in sent(vehicle.autopilot, boot_ms * MS + OFFSET_NS):
            assert (frame.version, frame.system, frame.component) == (2, 1, 191)
            message = decode(frame)
            if message.get_type() == "COMMAND_LONG":
                asked.append((message.param1, message.param2))
                result = 2 if asked[-1] == (30, 20_000) else 0  # a plane refuses 50 Hz
                vehicle.send(mavlink.MAVLink_command_ack_message(511, result), boot_ms)
            elif message.tc1 == 0:
                sync += 1
            else:
                assert message.ts1 == 1234
        if boot_ms % 500 == 0:
            vehicle.heartbeat(boot_ms)
    assert sync == 30
    assert asked[:3] == [(30, 20_000), (30, 40_000), (33, 50_000)]
    assert {number for number, _ in asked} == {30, 33, 24, 193, 2, 242, 230}


def test_gimbal_yaw_in_either_frame() -> None:
    for flags, yaw_body, east in ((64, 0.7, 0.0), (32, np.pi / 2, 1.0)):
        vehicle = started(mount=MountConfig(gimbal=True))
        for boot_ms in range(1000, 2000, 50):
            vehicle.pose(boot_ms, yaw=yaw_body)
            args = (0, 0, boot_ms, flags, [1.0, 0, 0, 0], 0, 0, 0, 0)
            vehicle.send(mavlink.MAVLink_gimbal_device_attitude_status_message(*args), boot_ms)
        pose = vehicle.look(1500)
        assert isinstance(pose, CameraPose)
        np.testing.assert_allclose(pose.R_cam_from_enu.T @ [0, 0, 1], [east, 1 - east, 0], atol=1e-6)


@pytest.mark.parametrize(("flags", "turned_deg"), [(64, 0.0), (32, 12.0)])
def test_a_vehicles_heading_that_jumps_turns_only_a_camera_that_goes_by_it(flags: int, turned_deg: float) -> None:
    vehicle = started(mount=MountConfig(gimbal=True))
    for boot_ms in range(1000, 3000, 50):
        args = (0, 0, boot_ms, flags, [1.0, 0, 0, 0], 0, 0, 0, 0)
        vehicle.send(mavlink.MAVLink_gimbal_device_attitude_status_message(*args), boot_ms)
        vehicle.pose(boot_ms, yaw=np.radians(12.0) if boot_ms >= 2000 else 0.0)
    before, after = vehicle.look(1700), vehicle.look(2300)
    assert isinstance(before, CameraPose) and isinstance(after, CameraPose)
    cosine = (np.trace(before.R_cam_from_enu.T @ after.R_cam_from_enu) - 1.0) / 2.0
    assert np.degrees(np.arccos(min(cosine, 1.0))) == pytest.approx(turned_deg, abs=0.01)
    told_rad = vehicle.autopilot.heading_turned_rad(2300 * MS + OFFSET_NS)
    assert np.degrees(told_rad) == pytest.approx(turned_deg, abs=0.01)
    assert vehicle.autopilot.counters()["jumps"] == {"position": 0, "heading": 1}
    assert "heading" in vehicle.autopilot.degraded(3000 * MS + OFFSET_NS)


@pytest.mark.parametrize("false_lat", [39.99, 41.0, -10.0])
def test_one_false_first_position_makes_no_origin(false_lat: float) -> None:
    vehicle = started()
    vehicle.pose(950, lat=false_lat)
    assert vehicle.autopilot.frame_enu is None
    vehicle.fly(1000)
    frame_enu, pose = vehicle.autopilot.frame_enu, vehicle.look(1500)
    assert frame_enu is not None and isinstance(pose, CameraPose)
    assert frame_enu.origin == pytest.approx((40.0, 3.0, 100.0))
    assert vehicle.autopilot.counters()["jumps"] == {"position": 0, "heading": 0}


def test_a_position_that_jumped_while_the_estimate_was_flagged_is_doubted() -> None:
    vehicle = started()
    vehicle.ekf(1000, 831)
    vehicle.fly(1000, count=40)
    vehicle.ekf(3000, 831 & ~16)
    vehicle.fly(3000, count=100, lat=40.0 + 60.0 / 111_195.0)
    vehicle.ekf(8000, 831)
    vehicle.fly(8000, count=40, lat=40.0 + 60.0 / 111_195.0)
    assert vehicle.autopilot.counters()["jumps"] == {"position": 1, "heading": 0}
    assert vehicle.look(9000) is RejectReason.POSITION_JUMPED


def test_a_turn_whose_rates_are_unknown_is_no_jump() -> None:
    vehicle = started()
    for boot_ms in range(1000, 6000, 100):  # 60 deg/s
        yaw_rad = np.remainder(np.radians(0.06 * boot_ms), 2 * np.pi)
        unknown = (float("nan"),) * 3
        vehicle.send(mavlink.MAVLink_attitude_message(boot_ms, 0, 0, yaw_rad, *unknown), boot_ms)
    assert vehicle.autopilot.counters()["jumps"] == {"position": 0, "heading": 0}
    assert vehicle.autopilot.heading_turned_rad(6000 * MS + OFFSET_NS) == 0.0


def replay(path: Path, autopilot: Autopilot) -> tuple[int, dict[int, int]]:
    """Poses asked for once a second, 0.5 s late: the last time and the count of poses by epoch."""
    framer, now_ns, next_ns = Framer(), 0, 0
    counts: dict[int, int] = {}
    for stamp_us, raw in read_tlog(path):
        now_ns = stamp_us * 1000
        for frame in framer.feed(raw):
            autopilot.receive(frame, now_ns)
        if now_ns >= next_ns:
            next_ns = now_ns + 10**9
            found = autopilot.camera_pose(now_ns - 500 * MS, now_ns)
            counts[autopilot.epoch] = counts.get(autopilot.epoch, 0) + isinstance(found, CameraPose)
    return now_ns, counts


@needs_data
def test_reboot_of_the_real_recording() -> None:
    autopilot = Autopilot(MavlinkConfig(), MountConfig(), replay=True)
    now_ns, counts = replay(DATA / "sitl" / "copter_link_reboot" / "telemetry.tlog", autopilot)
    assert autopilot.epoch == 1 and set(counts) == {0, 1}
    assert counts[0] > 100 and counts[1] > 20
    assert autopilot.timesync.source == "timesync" and autopilot.utc_s(now_ns)[1] == "gps"


@needs_data
@pytest.mark.parametrize(("name", "reboots"), [("codelever_1.tlog", 0), ("dronekit_flight_replay.tlog", 1)])
def test_old_flights_pass_the_gate(name: str, reboots: int) -> None:
    """In the second log time_boot_ms truly goes from 279402 to 18925; its EKF is fit for 427 s only."""
    poses = PoseHistory(attitude_gap_ns=2_000 * MS, position_gap_ns=3_000 * MS)
    autopilot = Autopilot(MavlinkConfig(), MountConfig(), replay=True, poses=poses)
    _, counts = replay(DATA / "telemetry" / name, autopilot)
    assert autopilot.epoch == reboots and sum(counts.values()) > 100 and autopilot.timesync.source == "envelope"


@pytest.mark.parametrize("angle", [float("inf"), float("nan")])
def test_non_finite_angles_are_refused_before_anything_is_computed_of_them(angle: float) -> None:
    vehicle = started(mount=MountConfig(gimbal=True))
    vehicle.fly(1000, yaw=angle)
    vehicle.send(mavlink.MAVLink_mount_orientation_message(2000, angle, 0.0, 0.0), 2000)
    assert vehicle.autopilot.rejects[RejectReason.ATTITUDE_INVALID] == 21
