"""Jumps of position and heading by hand, and in a simulated autopilot's own GPS glitch."""

import math

import numpy as np
import pytest

from distloc.geometry.rotations import matrix_from_euler, matrix_from_rotation_vector
from distloc.types import FloatArray
from service.autopilot.autopilot import Autopilot
from service.autopilot.pose_jumps import HEADING_DOUBT_NS, POSITION_DOUBT_NS, JumpWatch
from service.config.sections import MavlinkConfig, MountConfig
from service.mavlink.framer import Framer
from service.recordings.tlog import read_tlog
from tests.support.places import DATA

needs_data = pytest.mark.skipif(not DATA.is_dir(), reason="no recordings beside the repository")
STEP_NS = 100_000_000
NORTH_20 = np.array([0.0, 20.0, 0.0])


def fly(watch: JumpWatch, start: int, steps: int, offset_m: float = 0.0) -> int:
    """North at 20 m/s at 10 Hz, `offset_m` to the east; the time after the last step."""
    for number in range(start, start + steps):
        position_enu_m = np.array([offset_m, 2.0 * number, 50.0])
        watch.position(number * STEP_NS, position_enu_m, NORTH_20, number * STEP_NS)
    return (start + steps - 1) * STEP_NS


def test_even_flight_does_not_jump_and_a_glitch_is_doubted_until_it_is_back() -> None:
    watch = JumpWatch()
    assert not watch.is_position_doubted(fly(watch, 0, 50))
    assert not watch.is_position_doubted(fly(watch, 50, 50, offset_m=9.0))
    assert watch.is_position_doubted(fly(watch, 100, 50, offset_m=60.0))
    assert not watch.is_position_doubted(fly(watch, 150, 2, offset_m=9.0))
    assert watch.counts == {"position": 2, "heading": 0}


def test_a_new_place_is_believed_in_the_end() -> None:
    watch = JumpWatch()
    fly(watch, 0, 10)
    jumped_ns = fly(watch, 10, 1, offset_m=60.0)
    assert watch.is_position_doubted(jumped_ns + POSITION_DOUBT_NS - 1)
    assert not watch.is_position_doubted(jumped_ns + POSITION_DOUBT_NS)


@pytest.mark.parametrize(("speed_mps", "step_s"), [(12.0, 1.0), (20.0, 1.0), (55.0, 0.2)])
def test_velocities_left_at_zero_are_no_jump_and_hide_none(speed_mps: float, step_s: float) -> None:
    watch, at_ns = JumpWatch(), 0
    for number in range(60):
        at_ns = round(number * step_s * 1e9)
        position_enu_m = np.array([60.0 if number >= 50 else 0.0, speed_mps * step_s * number, 50.0])
        watch.position(at_ns, position_enu_m, np.zeros(3), at_ns)
        assert watch.counts["position"] == (number >= 50)
    assert watch.is_position_doubted(at_ns)


@pytest.mark.parametrize(
    ("gap_steps", "offset_m", "is_doubted"),
    [(20, 60.0, True), (20, 15.0, False), (100, 300.0, True), (310, 5e3, False)],
)
def test_over_a_gap_it_may_have_flown_anywhere_in_reach(gap_steps: int, offset_m: float, is_doubted: bool) -> None:
    watch = JumpWatch()
    fly(watch, 0, 10)
    assert watch.is_position_doubted(fly(watch, 10 + gap_steps, 10, offset_m=offset_m)) is is_doubted


def turn(watch: JumpWatch, at_ns: int, heading_rad: float, rate_rps: float = 0.0) -> None:
    rates_rps = np.array([0.0, 0.0, rate_rps])
    watch.attitude(at_ns, matrix_from_euler(heading_rad, 0.0, 0.0), rates_rps, at_ns)


def tumble(watch: JumpWatch, pitch_deg: float, jump_deg: float = 0.0, steps: int = 500) -> None:
    """From a pitch, with a body that swings about all its axes at up to 40 deg/s, at 50 Hz; a jump after half of it."""
    step_ns, parts = 20_000_000, 10
    R = matrix_from_euler(0.0, math.radians(pitch_deg), 0.0)

    def rates_rps(at_s: float) -> FloatArray:
        swing = [25 * math.sin(2.0 * at_s), 20 * math.sin(3.7 * at_s + 1.0), 25 * math.sin(1.3 * at_s + 2.0)]
        return np.radians(swing)

    for number in range(steps):
        at_s = number * step_ns * 1e-9
        jumped = matrix_from_euler(math.radians(jump_deg) if number >= steps // 2 else 0.0, 0.0, 0.0)
        watch.attitude(number * step_ns, jumped @ R, rates_rps(at_s), number * step_ns)
        for part in range(parts):
            mid_s = at_s + (part + 0.5) / parts * step_ns * 1e-9
            R = R @ matrix_from_rotation_vector(rates_rps(mid_s) * step_ns * 1e-9 / parts)


def test_a_turn_that_the_rates_tell_of_is_no_jump() -> None:
    watch = JumpWatch()
    for number in range(100):
        turn(watch, number * STEP_NS, 0.2 * number, 2.0)
    assert watch.counts["heading"] == 0


@pytest.mark.parametrize("pitch_deg", [0.0, 60.0, 88.0])
@pytest.mark.parametrize("jump_deg", [0.0, 12.0, -12.0])
def test_a_body_that_hovers_on_its_tail_jumps_only_when_it_does(pitch_deg: float, jump_deg: float) -> None:
    watch = JumpWatch()
    tumble(watch, pitch_deg, jump_deg)
    assert watch.counts["heading"] == (jump_deg != 0.0)
    assert math.degrees(watch.turned_rad(10**12)) == pytest.approx(jump_deg, abs=1.0)


def test_a_loop_over_the_top_is_no_jump() -> None:
    watch, rate_rps = JumpWatch(), math.radians(200.0)
    for number in range(91):
        R = matrix_from_euler(0.0, 0.0, 0.0) @ matrix_from_rotation_vector(np.array([0.0, rate_rps * 0.02 * number, 0]))
        watch.attitude(number * 20_000_000, R, np.array([0.0, rate_rps, 0.0]), number * 20_000_000)
    assert watch.counts["heading"] == 0


def test_without_rates_and_over_a_gap_nothing_is_said_of_the_heading() -> None:
    watch = JumpWatch()
    for number in range(50):
        turn(watch, number * STEP_NS, math.radians(6.0) * number, math.nan)
    turn(watch, 50 * STEP_NS, 0.0)  # the first with rates again
    assert watch.counts["heading"] == 0
    turn(watch, 50 * STEP_NS + 140_000_000, 0.5)
    assert watch.counts["heading"] == 0
    turn(watch, 51 * STEP_NS + 140_000_000, 1.0)
    assert watch.counts["heading"] == 1


def test_heading_that_jumps_across_south_and_back() -> None:
    watch = JumpWatch()
    before_ns, jumped_ns, back_ns = STEP_NS, 2 * STEP_NS, 3 * STEP_NS
    turn(watch, before_ns, 3.1)
    turn(watch, jumped_ns, -3.0)
    by_rad = 2 * math.pi - 6.1
    assert watch.heading_rad(jumped_ns) == pytest.approx(by_rad)
    assert watch.heading_rad(jumped_ns + HEADING_DOUBT_NS) == 0.0
    assert [watch.turned_rad(at) for at in (before_ns, jumped_ns - 1)] == [0.0, 0.0]
    assert watch.turned_rad(jumped_ns) == pytest.approx(by_rad)
    turn(watch, back_ns, 3.1)
    assert watch.heading_rad(back_ns) == 0.0 and watch.turned_rad(back_ns) == pytest.approx(0.0, abs=1e-12)
    assert watch.turned_rad(jumped_ns) == pytest.approx(by_rad)
    watch.clear()
    assert watch.counts["heading"] == 2 and watch.turned_rad(0) == pytest.approx(0.0, abs=1e-12)


def test_a_heading_that_jumps_all_the_way_round_is_where_it_was() -> None:
    watch = JumpWatch()
    for number in range(37):
        turn(watch, number * STEP_NS, math.radians(10.0) * number)
    assert watch.counts["heading"] == 36
    assert watch.turned_rad(36 * STEP_NS) == pytest.approx(0.0, abs=1e-9)
    assert watch.heading_rad(36 * STEP_NS) == 0.0


@needs_data
@pytest.mark.parametrize(
    ("recording", "jumps"),
    [("copter_faults", {"position": 2, "heading": 0}), ("copter_nominal", {"position": 0, "heading": 0})],
)
def test_an_autopilots_own_recording(recording: str, jumps: dict[str, int]) -> None:
    autopilot, framer = Autopilot(MavlinkConfig(), MountConfig(), replay=True), Framer()
    for stamp_us, raw in read_tlog(DATA / "sitl" / recording / "telemetry.tlog"):
        for frame in framer.feed(raw):
            autopilot.receive(frame, stamp_us * 1000)
    assert autopilot.counters()["jumps"] == jumps
