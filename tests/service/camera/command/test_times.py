"""The times that a command writes become stamps on our clock, or are refused."""

import time

import numpy as np
import pytest

from service.camera.command.pictures import FormatError, PictureError
from service.camera.command.times import FrameClock, TimeLines

MS = 1_000_000


def all_of(*parts: bytes) -> list[int]:
    lines = TimeLines()
    for part in parts:
        lines.feed(part)
    return list(iter(lines.next_ns, None))


def test_lines_are_milliseconds_to_the_nanosecond() -> None:
    assert all_of(b"# timestamp format v2\n0\n33.3", b"33333\n\n 66.6 \n-1.5\n1764338400123.456789\n5") == [
        *(0, 33_333_333, 66_600_000, -1_500_000, 1_764_338_400_123_456_789)
    ]


@pytest.mark.parametrize(
    "line", [b"now\n", b"1e3\n", b"nan\n", b"1.2.3\n", b"1,5\n", b"9" * 100 + b"\n", b"\xff" * 200]
)
def test_what_is_no_time_is_said(line: bytes) -> None:
    with pytest.raises(FormatError, match="as a frame's time: it must be milliseconds, a line a frame"):
        all_of(line)


def test_times_without_frames_are_bounded() -> None:
    lines = TimeLines()
    with pytest.raises(FormatError, match="times for over 256 frames that do not come"):
        for number in range(1000):
            lines.feed(b"%d\n" % number)


@pytest.mark.parametrize("clock", ["monotonic", "boottime", "unix"])
def test_our_own_clocks(clock: str) -> None:
    kind = {"monotonic": time.CLOCK_MONOTONIC, "boottime": time.CLOCK_BOOTTIME, "unix": time.CLOCK_REALTIME}[clock]
    before_ns = time.monotonic_ns()
    time_ns = time.clock_gettime_ns(kind)
    arrival_ns = time.monotonic_ns() + 1000 * MS
    stamp_ns = FrameClock(clock).stamp_ns(time_ns, arrival_ns)
    assert before_ns - MS <= stamp_ns <= arrival_ns - 999 * MS


def test_what_cannot_be_its_time_is_refused() -> None:
    clock = FrameClock("monotonic")
    with pytest.raises(PictureError, match=r'0\.01 s after its arrival by camera\.source\.times = "monotonic"'):
        clock.stamp_ns(1010 * MS, 1000 * MS)
    with pytest.raises(PictureError, match="50 s before its arrival"):
        clock.stamp_ns(0, 50_000 * MS)
    assert clock.stamp_ns(900 * MS, 1000 * MS) == 900 * MS
    with pytest.raises(PictureError, match="not later than that of the frame before"):
        clock.stamp_ns(900 * MS, 1100 * MS)


def test_a_zero_of_its_own_is_found_by_the_frames_that_come_soonest() -> None:
    """Queues delay arrivals by an exponential time; only the constant part of the way stays in the stamps."""
    rng = np.random.default_rng(1)
    clock, errors = FrameClock("relative"), []
    for number in range(3000):
        taken_ns = number * 100 * MS
        drifted_ns = taken_ns + taken_ns * 20 // 1_000_000  # 20 ppm
        arrival_ns = 7_000_000 * MS + taken_ns + 30 * MS + round(rng.exponential(10.0) * MS)
        errors.append(clock.stamp_ns(drifted_ns, arrival_ns) - 7_000_000 * MS - taken_ns - 30 * MS)
    settled_ms = np.array(errors[50:]) / MS
    assert settled_ms.min() > -1.5 and settled_ms.max() < 1.5


def test_a_zero_that_jumps_is_found_anew() -> None:
    clock = FrameClock("relative")
    assert clock.stamp_ns(5000 * MS, 100_000 * MS) == 100_000 * MS
    assert clock.stamp_ns(5100 * MS, 100_130 * MS) == 100_100 * MS
    assert clock.stamp_ns(10 * MS, 100_250 * MS) == 100_250 * MS  # a pipeline that began anew
    assert clock.stamp_ns(110 * MS, 100_380 * MS) == 100_350 * MS
