"""What the pilot hears of where to fly next: after a minute of doubt, or asked, and never more than fits."""

import math
from dataclasses import replace
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from distloc.advice.advise import Advice
from distloc.types import TargetState
from service.common.messages import LocatedTarget
from service.publish.mavlink import MavlinkPublisher
from service.publish.parts import advice_report
from service.publish.pilot.advice_teller import AdviceTeller, advice_text
from tests.service.publish.test_mavlink import command, decoded, publisher
from tests.support.wire_samples import located

S = 1_000_000_000
LEG = Advice(3, "leg", False, math.radians(40.0), 400.0, 40.0, 80.0, 80.0)
USER_1 = 31010  # MAV_CMD_USER_1


def unsure(
    target_id: int = 3, advice: Advice | None = LEG, state: TargetState = TargetState.TENTATIVE
) -> LocatedTarget:
    return replace(located(target_id, state), advice=None if advice is None else replace(advice, target=target_id))


@pytest.mark.parametrize(
    ("advice", "text"),
    [
        (LEG, b"Fire 3: fly 040 400m for +-80m"),
        (replace(LEG, heading_rad=math.radians(359.7)), b"Fire 3: fly 000 400m for +-80m"),
        (replace(LEG, half_length_m=None), b"Fire 3: fly 040 400m"),
        (replace(LEG, kind="arc", turns_right=True), b"Fire 3: arc 040 right 400m for +-80m"),
        (replace(LEG, kind="arc"), b"Fire 3: arc 040 left 400m for +-80m"),
        (replace(LEG, target=2**31, length_m=1e9, half_length_m=1e12), b"Fire 2147483648: fly 040 99999m for +-99999m"),
    ],
)
def test_the_text_fits(advice: Advice, text: bytes) -> None:
    assert advice_text(advice) == text and len(text) <= 50


def test_it_is_told_after_a_minute_of_doubt_and_again_a_minute_later() -> None:
    pilot = AdviceTeller()
    told = [at_s for at_s in range(0, 200, 2) if pilot.due([unsure()], at_s * S)]
    assert told == [60, 120, 180]
    assert pilot.due([unsure(state=TargetState.CONFIRMED)], 260 * S) == []
    assert pilot.due([unsure()], 262 * S) == []  # the minute begins anew


def test_fires_take_turns_and_old_advice_is_not_told() -> None:
    pilot = AdviceTeller()
    both = [unsure(1), unsure(2)]
    texts = [text for at_s in range(0, 190, 2) for text in pilot.due(both, at_s * S)]
    assert [text.split(b":")[0] for text in texts] == [b"Fire 1", b"Fire 2", b"Fire 1"]
    assert pilot.due([], 250 * S) == [] and pilot.asked(1, 250 * S) == []  # what was said last is 60 s old
    assert pilot.due([unsure(1, None)], 300 * S) == []


def test_memory_is_bounded() -> None:
    pilot = AdviceTeller()
    for target_id in range(1, 1000):
        pilot.due([unsure(target_id)], target_id)
    assert len(pilot._advice) <= 64 and len(pilot._unsure_since_ns) <= 64


def asked(pilot: MavlinkPublisher, target: float) -> list[Any]:
    return decoded(pilot.handle(command(USER_1, 191, target), 10 * S))


def test_a_pilot_who_asks_gets_an_answer() -> None:
    pilot = publisher()
    (ack,) = asked(pilot, 0.0)
    assert (ack.command, ack.result) == (USER_1, mavlink.MAV_RESULT_TEMPORARILY_REJECTED)
    pilot.update([unsure(3), unsure(4)], 9 * S)
    ack, first, second = asked(pilot, 0.0)
    assert ack.result == mavlink.MAV_RESULT_ACCEPTED
    assert (first.text, second.text) == ("Fire 4: fly 040 400m for +-80m", "Fire 3: fly 040 400m for +-80m")
    ack, text = asked(pilot, 3.0)
    assert text.get_type() == "STATUSTEXT" and text.text.startswith("Fire 3:")
    for nonsense in (99.0, float("nan"), float("inf"), -7.0, 1e30):
        assert asked(pilot, nonsense)[0].get_type() == "COMMAND_ACK"
    (refused,) = decoded(pilot.handle(command(USER_1, 191, 3.0, sender=9), 10 * S))
    assert refused.result == mavlink.MAV_RESULT_DENIED


def test_the_report_has_it() -> None:
    report = advice_report(unsure())
    assert report is not None
    assert (report.kind, report.heading_deg, report.length_m, report.seconds, report.half_length_m) == (
        "leg",
        40.0,
        400.0,
        40.0,
        80.0,
    )
    assert advice_report(unsure(advice=None)) is None
