"""The clock of a log: wild stamps, a clock set back and forth, gaps that are none, frames beside it."""

import random

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from service.recordings.log_clock import MOST_CANDIDATES, MOST_HELD, LogClock, even_rows

START_US = 1_700_000_000_000_000
PERIOD_US = 20_000
HOUR_US = 3_600_000_000


def frame(boot_us: int) -> bytes:
    mav = mavlink.MAVLink(None, 1, 1)
    return bytes(mavlink.MAVLink_attitude_message(boot_us // 1000, 0.1, 0.2, 0.3, 0.0, 0.0, 0.0).pack(mav))


def heartbeat() -> bytes:
    return bytes(mavlink.MAVLink_heartbeat_message(2, 3, 0, 0, 4, 3).pack(mavlink.MAVLink(None, 1, 1)))


def flown(clock: LogClock, stamps_us: list[int], boots_us: list[int] | None = None) -> list[int]:
    """The even stamps of records; without times since boot they are heartbeats."""
    even: list[int] = []
    for number, stamp_us in enumerate(stamps_us):
        raw = heartbeat() if boots_us is None else frame(boots_us[number])
        even += [one for one, _ in clock.take(stamp_us, raw)]
    return even + [one for one, _ in clock.end()]


def steady(count: int, start_us: int = START_US) -> list[int]:
    return [start_us + number * PERIOD_US for number in range(count)]


@pytest.mark.parametrize("ahead_us", [20 * HOUR_US, -20 * HOUR_US, 3_000_000, -2_600_000, -START_US])
@pytest.mark.parametrize("at", [0, 1, 3, 100, 199])
def test_one_wild_stamp_costs_one_record(ahead_us: int, at: int) -> None:
    stamps_us = steady(200)
    clock = LogClock()
    even_us = flown(clock, [*stamps_us[:at], stamps_us[at] + ahead_us, *stamps_us[at + 1 :]], steady(200, 5_000_000))
    assert even_us == stamps_us[:at] + stamps_us[at + 1 :]
    assert clock.wild == 1 and len(clock.spans) == 1


@pytest.mark.parametrize("step_us", [-600_000_000, -3_000_000, 3_000_000, 600_000_000, -START_US + 7, 20 * HOUR_US])
def test_a_clock_that_is_set_costs_nothing(step_us: int) -> None:
    stamps_us, boots_us = steady(400), steady(400, 5_000_000)
    clock = LogClock()
    even_us = flown(clock, stamps_us[:200] + [one + step_us for one in stamps_us[200:]], boots_us)
    assert even_us == stamps_us
    assert clock.wild == 0 and [span.shift_us for span in clock.spans] == [0, -step_us]


def test_a_step_is_found_to_a_few_milliseconds_though_records_are_late() -> None:
    rng = random.Random(3)
    late_us = [rng.randrange(30_000) for _ in range(400)]
    stamps_us = [one + late for one, late in zip(steady(400), late_us, strict=True)]
    even_us = flown(LogClock(), [one - HOUR_US * (n >= 200) for n, one in enumerate(stamps_us)], steady(400, 5_000_000))
    assert len(even_us) == 400
    assert max(abs(a - b) for a, b in zip(even_us, stamps_us, strict=True)) < 10_000


def test_a_gap_is_no_step_and_costs_nothing() -> None:
    for gap_us in (4_000_000, HOUR_US):
        stamps_us = [one + gap_us * (n >= 50) for n, one in enumerate(steady(100))]
        clock = LogClock()
        assert flown(clock, stamps_us, [one - START_US + 5_000_000 for one in stamps_us]) == stamps_us
        assert [span.shift_us for span in clock.spans] == [0]


def test_a_reboot_in_the_gap_is_no_step_either() -> None:
    stamps_us = [one + HOUR_US * (n >= 300) for n, one in enumerate(steady(600))]
    boots_us = [5_000_000 + (n % 300) * PERIOD_US for n in range(600)]
    assert flown(LogClock(), stamps_us, boots_us) == stamps_us


def test_without_a_time_since_boot_the_order_of_the_file_counts() -> None:
    stamps_us = steady(300)
    even_us = flown(LogClock(), stamps_us[:100] + [one - HOUR_US for one in stamps_us[100:]])
    assert len(even_us) == 300 and even_us == sorted(even_us)


def test_many_steps_and_a_clock_of_1970() -> None:
    stamps_us, boots_us = steady(1000, 62_000_000), steady(1000, 5_000_000)
    clock = LogClock()
    even_us = flown(clock, [one + (n // 100 % 3) * HOUR_US for n, one in enumerate(stamps_us)], boots_us)
    assert even_us == stamps_us and len(clock.spans) == 10


def test_memory_is_bounded_by_hostile_stamps() -> None:
    rng = random.Random(5)
    clock = LogClock()
    for number in range(5000):
        list(clock.take(rng.randrange(4 * 10**15) if number > 20 else START_US + number, heartbeat()))
        assert len(clock._candidates) <= MOST_CANDIDATES
        assert all(len(one.records) < MOST_HELD for one in clock._candidates)


def test_a_short_log_is_taken_as_it_is() -> None:
    stamps_us = [START_US + 1, START_US + 2, 7 * START_US // 8, START_US + 3]
    assert flown(LogClock(), stamps_us) == [one for one in stamps_us if one >= START_US]


@pytest.mark.parametrize("step_us", [-600_000_000, -10_000_000, 600_000_000])
def test_frames_follow_the_clock_that_stamped_them(step_us: int) -> None:
    stamps_us = steady(2000)
    clock = LogClock()
    flown(clock, [one + step_us * (n >= 1000) for n, one in enumerate(stamps_us)], steady(2000, 5_000_000))
    frames_us = [START_US + 10_001 + n * 200_000 for n in range(200)]
    rows = [(one + step_us * (one > stamps_us[999]), f"{n:03d}") for n, one in enumerate(frames_us)]
    assert even_rows(rows, clock.spans) == [(one, f"{n:03d}") for n, one in enumerate(frames_us)]


def test_frames_of_an_even_clock_may_stand_in_any_order() -> None:
    clock = LogClock()
    flown(clock, steady(20), steady(20, 5_000_000))
    assert even_rows([(START_US + 9, "b"), (START_US - HOUR_US, "a"), (START_US + 1, "c")], clock.spans) == [
        (START_US - HOUR_US, "a"),
        (START_US + 1, "c"),
        (START_US + 9, "b"),
    ]
