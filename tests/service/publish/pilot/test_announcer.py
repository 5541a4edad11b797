"""What the pilot hears of a target as its estimate changes."""

from distloc.types import TargetState
from service.common.messages import LocatedTarget
from service.publish.pilot.announcer import CHANGED_NS, MAX_TARGETS, REPEATED_NS, SECOND_NS, Announcer
from tests.support.wire_samples import located

METRES_NORTH_DEG = 1.0 / 111_320.0


def told(announcer: Announcer, at_s: float, *targets: LocatedTarget) -> list[str]:
    return [text.decode() for text in announcer.due(targets, round(at_s * SECOND_NS))]


def test_an_estimate_that_becomes_better_is_told_again() -> None:
    pilot = Announcer()
    assert told(pilot, 0, located(semi_major_m=995.0)) == ["Smoke 3 47.42774N 8.60559E +-995x60m 4.1km"]
    assert told(pilot, 60, located(semi_major_m=600.0)) == []
    assert told(pilot, 61, located(semi_major_m=490.0)) == ["Smoke 3 47.42774N 8.60559E +-490x60m 4.1km"]
    assert told(pilot, 62, located(semi_major_m=120.0)) == []  # soon after the last: a pilot is not flooded
    assert told(pilot, 71, located(semi_major_m=38.0)) == ["Smoke 3 47.42774N 8.60559E +-38x60m 4.1km"]


def test_an_estimate_that_becomes_worse_is_told_again() -> None:
    pilot = Announcer()
    told(pilot, 0, located(semi_major_m=100.0))
    assert told(pilot, 20, located(semi_major_m=190.0)) == []
    assert told(pilot, 21, located(semi_major_m=210.0)) != []


def test_a_place_outside_of_what_was_said_is_told() -> None:
    """The sample's ellipse is 180 m long to the east and 60 m wide."""
    for north_m, east_m, is_outside in ((55.0, 0.0, False), (65.0, 0.0, True), (0.0, 170.0, False), (0.0, 190.0, True)):
        pilot = Announcer()
        told(pilot, 0, located())
        moved = located(
            lat_deg=47.42774 + north_m * METRES_NORTH_DEG, lon_deg=8.60559 + east_m * METRES_NORTH_DEG / 0.6765
        )
        assert (told(pilot, 11, moved) != []) is is_outside, (north_m, east_m)


def test_the_date_line_is_no_move() -> None:
    pilot = Announcer()
    told(pilot, 0, located(lat_deg=-17.0, lon_deg=179.9999))
    assert told(pilot, 30, located(lat_deg=-17.0, lon_deg=-179.9999)) == []


def test_who_comes_late_hears_it_too_and_its_end() -> None:
    pilot = Announcer()
    texts = [
        (at_s, told(pilot, at_s, located(state=TargetState.COASTING if at_s else TargetState.CONFIRMED)))
        for at_s in range(0, 300, 10)
    ]
    assert [at_s for at_s, text in texts if text] == [0, 120, 240]
    assert told(pilot, 300, located(state=TargetState.DISMISSED)) == ["Smoke 3 given up"]
    assert told(pilot, 600, located(state=TargetState.TENTATIVE)) == []


def test_many_targets_take_turns_and_what_changed_goes_first() -> None:
    pilot = Announcer()
    assert len(told(pilot, 0, *(located(number) for number in range(8)))) == 8
    late_s = REPEATED_NS / SECOND_NS
    changed = [located(number, semi_major_m=50.0 if number == 7 else 180.0) for number in range(8)]
    heard = [told(pilot, late_s + 0.5 * step, *changed) for step in range(32)]
    assert [int(text.split()[1]) for texts in heard for text in texts] == [7, 0, 1, 2, 3, 4, 5, 6]
    assert all(texts == [] for number, texts in enumerate(heard) if number % 4)


def test_what_has_no_place_is_not_told_and_memory_is_bounded() -> None:
    pilot = Announcer()
    assert told(pilot, 0, located(semi_major_m=float("inf"))) == []
    told(pilot, 0, located())
    assert told(pilot, 2 * CHANGED_NS / SECOND_NS, located(semi_major_m=float("nan"))) == []
    for number in range(1000):
        told(pilot, 100 + number, located(number))
    assert len(pilot._said) == MAX_TARGETS
