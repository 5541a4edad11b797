"""Pictures of before: the one that was there at a time, bounded in bytes."""

import os

from service.ground.record.timeline import STEP_S, Timeline


def test_the_picture_of_a_time_is_the_last_one_before_it() -> None:
    line = Timeline()
    assert line.at(5.0) is None and line.begin_s is None
    for second in range(100):
        line.keep(float(second), lambda second=second: str(second).encode())  # type: ignore[misc]
    assert (line.at(35.0), line.at(30.0), line.at(-5.0), line.at(1e9)) == (b"30", b"30", b"0", b"90")


def test_it_is_bounded_and_the_beginning_stays() -> None:
    line = Timeline(100_000)
    for number in range(1000):
        line.keep(number * STEP_S, lambda number=number: str(number).encode() + os.urandom(1000))  # type: ignore[misc]
    assert line._bytes <= 100_000
    first, last = line.at(0.0), line.at(1e9)
    assert first is not None and last is not None and first[:1] == b"0" and last.startswith(b"999")


def test_a_clock_that_was_set_back_begins_it_anew() -> None:
    line = Timeline()
    line.keep(1000.0, lambda: b"old")
    line.keep(10.0, lambda: b"new")
    assert line.at(2000.0) == b"new"
