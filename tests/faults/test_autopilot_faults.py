"""Faults of the autopilot and its link, each put into the running service; docs/faults.md says what must come of it."""

import time
from collections.abc import Iterator

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from service.autopilot.message_ids import ATTITUDE, GLOBAL_POSITION_INT
from service.publish import wire
from service.simulator.craft import forged_frames, junk
from service.simulator.operator import Heard
from tests.faults.harness import MOST_ERROR_M, Flight


@pytest.fixture(scope="module")
def flight() -> Iterator[Flight]:
    with Flight() as made:
        yield made


def utc_s(status: Heard) -> float:
    """The UTC that a status carries."""
    return wire.utc_s(status.what["time_utc"])


def test_autopilot_silent(flight: Flight) -> None:
    with flight.fault("autopilot silent", degraded="link", reject="stale_pose") as fault:
        flight.air.is_silent = True
        fault.ends_with(lambda: setattr(flight.air, "is_silent", False))


def test_autopilot_reboots(flight: Flight) -> None:
    with flight.fault("autopilot reboots") as fault:
        flight.air.reboot()
        fault.see(lambda: flight.operator.status.what["counters"]["autopilot"]["epoch"] == 1, "the epoch rises")


def test_two_autopilots(flight: Flight) -> None:
    with flight.fault("two autopilots on one link") as fault:
        flight.air.add_other(2)
        fault.ends_with(flight.air.remove_other)
        fault.see(
            lambda: flight.operator.status.what["counters"]["autopilot"]["ignored"].get("foreign", 0) > 100,
            "the other's messages are ignored",
        )


def test_another_system_id(flight: Flight) -> None:
    with flight.fault("autopilot with another system id", degraded="link", reject="stale_pose") as fault:
        flight.air.set_system(7)
        fault.ends_with(lambda: flight.air.set_system(1))


@pytest.mark.parametrize("percent", [1, 10])
def test_some_junk(flight: Flight, percent: int) -> None:
    with flight.fault(f"junk in the place of {percent} % of the traffic") as fault:
        sent, given = flight.air.sent, flight.app.pipeline.stage.frames
        flight.air.mangle = junk(percent / 100.0)
        fault.ends_with(lambda: setattr(flight.air, "mangle", lambda frame: frame))
        fault.see(lambda: flight.air.sent > sent + 300, "junk was sent")
        fault.see(lambda: flight.app.pipeline.stage.frames > given + 5, "frames go on")


def test_only_junk(flight: Flight) -> None:
    with flight.fault("junk in the place of all traffic", degraded="link", reject="stale_pose") as fault:
        flight.air.mangle = junk(1.0)
        fault.ends_with(lambda: setattr(flight.air, "mangle", lambda frame: frame))


def test_forged_frame_from_the_far_future(flight: Flight) -> None:
    with flight.fault("forged frame, signed in the far future") as fault:
        epoch, given = flight.app.autopilot.epoch, flight.app.pipeline.stage.frames
        for frame in forged_frames(flight.air.craft.boot_ns(flight.air.t_s) // 1_000_000):
            flight.air.inject(frame)
        fault.see(lambda: flight.app.pipeline.stage.frames > given + 5, "frames go on")
        assert flight.app.autopilot.epoch == epoch


def test_wall_clock_steps(flight: Flight, monkeypatch: pytest.MonkeyPatch) -> None:
    now_ns, now_s = time.time_ns, time.time
    with flight.fault("the host's wall clock an hour on and back") as fault:
        before = flight.operator.status
        for hours in (1, -1):
            monkeypatch.setattr(time, "time_ns", lambda shift_ns=hours * 3600 * 10**9: now_ns() + shift_ns)
            monkeypatch.setattr(time, "time", lambda shift_s=hours * 3600.0: now_s() + shift_s)
            given, heard = flight.app.pipeline.stage.frames, flight.operator.status
            fault.see(lambda given=given: flight.app.pipeline.stage.frames > given + 5, "frames go on")
            fault.see(lambda heard=heard: flight.operator.status is not heard, "a status comes")
        after = flight.operator.status
        passed_s = utc_s(after) - utc_s(before)
        assert abs(passed_s - (after.at_s - before.at_s)) < 60.0
        monkeypatch.undo()


def test_time_since_boot_wraps() -> None:
    with Flight(boot_ns=(2**32 - 10_000) * 1_000_000) as flight:
        with flight.fault("time_boot_ms wraps at 2^32") as fault:
            fault.see(lambda: flight.air.craft.boot_ns(flight.air.t_s) > (2**32 + 1_000) * 1_000_000, "it wrapped")
        assert flight.app.autopilot.epoch == 0


def test_another_client_overrides_our_rates(flight: Flight) -> None:
    with flight.fault("another client overrides our rates", reject="pose_gap", degraded="rates"):
        flight.air.set_rate(ATTITUDE, 1.0)
        flight.air.set_rate(GLOBAL_POSITION_INT, 1.0)


def test_attitude_withheld(flight: Flight) -> None:
    with flight.fault("attitude withheld", degraded="pose", reject="stale_pose") as fault:
        flight.air.mangle = lambda frame: b"" if frame[7:10] == ATTITUDE.to_bytes(3, "little") else frame
        fault.ends_with(lambda: setattr(flight.air, "mangle", lambda frame: frame))


def test_camera_zooms(flight: Flight) -> None:
    def told(level: float) -> bytes:
        camera = mavlink.MAVLink(None, 1, 101)
        camera.seq = round(level)  # no two of a sender are alike
        stamp_ms = round(flight.air.t_s * 1e3)
        return bytes(mavlink.MAVLink_camera_settings_message(stamp_ms, 0, level, 0.0).pack(camera))

    with flight.fault("camera zooms in, and back", degraded="zoom", reject="zoomed") as fault:
        flight.air.inject(told(40.0))
        fault.ends_with(lambda: flight.air.inject(told(0.0)))


JUMP_ERROR_M = 100.0  # of the target after a jump: 12 degrees at 0.9 km are 190 m


@pytest.fixture
def fresh_flight() -> Iterator[Flight]:
    with Flight() as made:
        yield made


def test_gps_jumps_without_a_flag(fresh_flight: Flight) -> None:
    craft = fresh_flight.air.craft
    with fresh_flight.fault(
        "GPS jumps by 60 m, no flag, and back",
        degraded="position",
        reject="position_jumped",
        most_error_m=JUMP_ERROR_M,
    ) as fault:
        craft.jump_enu_m = (45.0, -40.0, 3.0)
        fault.ends_with(lambda: setattr(craft, "jump_enu_m", (0.0, 0.0, 0.0)))


def test_heading_jumps(fresh_flight: Flight) -> None:
    craft = fresh_flight.air.craft
    with fresh_flight.fault(
        "heading jumps by 12 degrees, no flag, and back", degraded="heading", most_error_m=JUMP_ERROR_M
    ) as fault:
        given = fresh_flight.app.pipeline.stage.frames
        craft.heading_jump_rad = 0.21
        fault.ends_with(lambda: setattr(craft, "heading_jump_rad", 0.0))
        fault.see(lambda: fresh_flight.app.pipeline.stage.frames > given + 15, "frames go on")
        # with the ellipse that the doubt has made it begins anew, and narrows while the heading is still wrong
        fault.see(lambda: fresh_flight.error_m() < MOST_ERROR_M, "the target is found again by the other heading")
