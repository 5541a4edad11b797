"""Which frames were heard before by another path."""

import pytest

from service.common.messages import MavFrame
from service.mavlink.copies import MOST_SENDERS, Copies, Verdict

S = 1_000_000_000
HEARTBEAT, ATTITUDE = 0, 30


def frame(number: int, message_id: int, system: int = 1) -> MavFrame:
    """The `number`th of a sender; a heartbeat's bytes tell no more than its sequence number."""
    told = number.to_bytes(4, "big") if message_id == ATTITUDE else b""
    return MavFrame(bytes([number % 256, message_id, system]) + told, 2, system, 1, number % 256, message_id)


def stream(count: int) -> list[MavFrame]:
    """Every 128th a heartbeat: each second one is like that before the last."""
    return [frame(number, HEARTBEAT if number % 128 == 0 else ATTITUDE) for number in range(count)]


def is_copy(copies: Copies, one: MavFrame, now_ns: int) -> bool:
    return copies.judge(one, now_ns) is Verdict.COPY


def test_heartbeats_that_are_alike_by_chance_are_no_copies() -> None:
    copies = Copies()
    assert not any(is_copy(copies, one, number * S // 100) for number, one in enumerate(stream(2000)))


@pytest.mark.parametrize("lag", [1, 30, 200, 250, 800])
def test_what_a_second_path_brings_is_a_copy(lag: int) -> None:
    copies, sent, verdicts = Copies(), stream(2000), []
    for number, one in enumerate(sent):
        assert not is_copy(copies, one, number * S // 100)
        if number >= lag:
            verdicts.append(is_copy(copies, sent[number - lag], number * S // 100))
    assert verdicts.count(False) <= 1  # the first heartbeat's may come before any sure copy


def test_a_batch_of_copies_and_the_only_path_for_a_while() -> None:
    copies, sent = Copies(), stream(900)
    assert not any(is_copy(copies, one, 0) for one in sent[1:500])
    assert all(is_copy(copies, one, S) for one in sent[1:500])
    assert not any(is_copy(copies, one, 2 * S) for one in sent[500:])


def test_the_window_and_the_table_are_bounded_and_age() -> None:
    copies = Copies(window=100)
    for number in range(1000):
        is_copy(copies, frame(number, ATTITUDE), 0)
    (heard,) = copies._senders.values()
    assert len(heard.newer) + len(heard.older) <= 200
    assert is_copy(copies, frame(950, ATTITUDE), 15 * S)
    is_copy(copies, frame(1001, ATTITUDE), 17 * S)
    assert not is_copy(copies, frame(951, ATTITUDE), 34 * S)
    for system in range(2, 100):
        is_copy(copies, frame(0, HEARTBEAT, system), 34 * S)
    assert len(copies._senders) == MOST_SENDERS
