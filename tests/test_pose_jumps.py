"""Jumps of position and heading by hand, and in a simulated autopilot's own GPS glitch."""

import math
from pathlib import Path

import numpy as np
import pytest

from service.autopilot import Autopilot
from service.config import MavlinkConfig, MountConfig
from service.mavlink_framer import Framer
from service.pose_jumps import HEADING_DOUBT_NS, POSITION_DOUBT_NS, JumpWatch, euler_heading_rate_rps
from service.tlog import read_tlog

DATA = Path(__file__).resolve().parents[2] / "shared" / "data"
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


def test_nothing_is_said_over_a_gap() -> None:
    watch = JumpWatch()
    fly(watch, 0, 10)
    assert not watch.is_position_doubted(fly(watch, 30, 10, offset_m=60.0))


def test_a_turn_that_the_rates_tell_of_is_no_jump() -> None:
    watch = JumpWatch()
    for number in range(100):
        watch.heading(number * STEP_NS, math.remainder(0.2 * number, 2 * math.pi), 2.0, number * STEP_NS)
    assert watch.counts["heading"] == 0


def test_heading_that_jumps_across_south_and_back() -> None:
    watch = JumpWatch()
    before_ns, jumped_ns, back_ns = STEP_NS, 2 * STEP_NS, 3 * STEP_NS
    watch.heading(before_ns, 3.1, 0.0, before_ns)
    watch.heading(jumped_ns, -3.0, 0.0, jumped_ns)
    by_rad = 2 * math.pi - 6.1
    assert watch.heading_rad(jumped_ns) == pytest.approx(by_rad)
    assert watch.heading_rad(jumped_ns + HEADING_DOUBT_NS) == 0.0
    assert [watch.turned_rad(at) for at in (before_ns, jumped_ns - 1)] == [0.0, 0.0]
    assert watch.turned_rad(jumped_ns) == pytest.approx(by_rad)
    watch.heading(back_ns, 3.1, 0.0, back_ns)
    assert watch.heading_rad(back_ns) == 0.0 and watch.turned_rad(back_ns) == pytest.approx(0.0, abs=1e-12)
    assert watch.turned_rad(jumped_ns) == pytest.approx(by_rad)
    watch.clear()
    assert watch.counts["heading"] == 2 and watch.turned_rad(0) == pytest.approx(0.0, abs=1e-12)


def test_heading_rate_of_a_banked_turn() -> None:
    # a level turn at W about the vertical, banked by r: the body's pitch rate is W sin r, its yaw rate W cos r
    rate, roll = 0.1, math.radians(30.0)
    assert euler_heading_rate_rps(roll, 0.0, rate * math.sin(roll), rate * math.cos(roll)) == pytest.approx(rate)
    assert euler_heading_rate_rps(0.0, math.pi / 2, 1.0, 1.0) == 0.0
    assert euler_heading_rate_rps(0.0, 0.0, math.nan, 1.0) == 0.0


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
