"""Frames a second: what comes, what is segmented, and what is said where the segmenter takes fewer."""

from service.flight.frame_rates import FrameRates, Rate

NS = 1_000_000_000


def test_a_rate_is_of_late_and_bounded() -> None:
    rate = Rate()
    assert rate.hz(0) == 0.0
    for number in range(1000):
        rate.note(number * NS // 5)
    assert abs(rate.hz(200 * NS) - 5.0) < 1e-9 and len(rate._at_ns) == 64
    assert rate.hz(300 * NS) == 0.0
    rate.note(0)  # a clock that went back
    assert rate.hz(0) == 0.0


def flown(rates: FrameRates, start_s: int, seconds: int, camera_hz: int, each: int) -> list[str]:
    """What is said while each so-manieth of the camera's frames is segmented."""
    said = []
    for number in range(seconds * camera_hz):
        now_ns = start_s * NS + number * NS // camera_hz
        rates.came(now_ns)
        if number % each == 0:
            rates.done(now_ns)
        if number % camera_hz == 0 and (news := rates.news(now_ns)):
            said.append(news)
    return said


def test_a_slow_segmenter_is_told_once_and_so_is_its_end() -> None:
    rates = FrameRates()
    assert flown(rates, 0, 60, 5, 1) == []
    (line,) = flown(rates, 60, 120, 5, 5)
    assert line.startswith("the segmenter takes 1.0 of the camera's 5.0 frames a second")
    assert rates.per_second(180 * NS - NS // 5) == {"camera": 5.0, "segmented": 1.0}
    (line,) = flown(rates, 180, 60, 5, 1)
    assert line == "the segmenter takes all of the camera's 5.0 frames a second again"


def test_a_short_pause_and_no_camera_are_not_told() -> None:
    rates = FrameRates()
    flown(rates, 0, 30, 5, 1)
    assert flown(rates, 30, 20, 5, 4) == [] and flown(rates, 50, 60, 5, 1) == []
    assert rates.news(200 * NS) is None and rates.news(400 * NS) is None
