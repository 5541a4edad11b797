"""The framer on junk full of headers: windows of a long read against one header after another, cost and memory."""

import random
import tracemalloc

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from pymavlink.generator.mavcrc import x25crc

from service.mavlink import framer as framer_module
from service.mavlink.checksums import MOST_BYTES, Checksums
from service.mavlink.framer import LONGEST_FRAME, Framer, check_frame

READ_BYTES = 1 << 18
KNOWN = sorted(mavlink.mavlink_map)
UNITS = (
    *("fe", "fd", "fefd", "fe01", "fe00", "fd3300", "fd0000", "fd0100", "fe33fefefefd", "fd09000000", "fe0901fd0000"),
    *("fd1c00000001011e0000", "fd1c0100000101fd0000", "fefefefefe83", "fefefefefefd0000", "fe00000000ff0000"),
)


def header(rng: random.Random) -> bytes:
    """Of a known or any id, its payload's length mostly fit for it."""
    number = rng.choice([rng.choice(KNOWN), rng.randrange(1 << 16)])
    longest = mavlink.mavlink_map[number].unpacker.size if number in KNOWN else 255
    length = rng.choice([0, longest, rng.randrange(longest + 1), 255])
    if number < 256 and rng.random() < 0.5:
        return bytes([0xFE, length, rng.randrange(256), 1, 1, number])
    return bytes([0xFD, length, rng.randrange(3), 0, rng.randrange(256), 1, 1]) + number.to_bytes(3, "little")


def frame(rng: random.Random) -> bytes:
    mav = mavlink.MAVLink(None, rng.randrange(1, 255), 1)
    if rng.random() < 0.3:
        mav.signing.secret_key, mav.signing.sign_outgoing, mav.signing.timestamp = b"k" * 32, True, 1
    message = rng.choice(
        [
            mavlink.MAVLink_attitude_message(rng.randrange(9999), 0.1, 0.2, 0.3, 0.4, 0.5, 0.6),
            mavlink.MAVLink_statustext_message(6, rng.choice([b"\xfe\xfd", b"\xfd\x00\x00", b"\xfe\x01"]) * 10),
            mavlink.MAVLink_ping_message(0, 0, 0, 0),
        ]
    )
    return bytes(message.pack(mav, force_mavlink1=rng.random() < 0.3))


def piece(rng: random.Random) -> bytes:
    kind, whole = rng.randrange(10), frame(rng)
    if kind < 3:
        return header(rng) * rng.choice([1, 1, 2, 30])
    if kind < 4:
        return bytes.fromhex(rng.choice(UNITS)) * rng.choice([1, 2, 100])
    if kind < 5:
        return whole[: rng.randrange(len(whole))] + rng.randbytes(rng.randrange(20))
    if kind < 6:
        at = rng.randrange(len(whole))
        return whole[:at] + bytes([whole[at] ^ 1 << rng.randrange(8)]) + whole[at + 1 :]
    return whole


def one_by_one(monkeypatch: pytest.MonkeyPatch, framer: Framer, data: bytes) -> list[object]:
    with monkeypatch.context() as patch:
        patch.setattr(framer_module, "_FEW_BYTES", 1 << 30)
        return list(framer.feed(data))


@pytest.mark.parametrize("chunk_bytes", [1_100, 1_500, 16_384, 100_000])
def test_a_window_at_once_gives_what_one_header_after_another_gives(
    chunk_bytes: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    rng = random.Random(chunk_bytes)
    stream = b"".join(piece(rng) for _ in range(1_500))
    slow, fast = Framer(), Framer()
    for at in range(0, len(stream), chunk_bytes):
        chunk = stream[at : at + chunk_bytes]
        assert fast.feed(chunk) == one_by_one(monkeypatch, slow, chunk)
        assert vars(fast) == vars(slow)
    assert min(fast.frames, fast.unknown_ids, fast.bad_crc) > 50 and fast.bad_bytes > 1_000


@pytest.mark.parametrize("wanted", [None, frozenset({30})])
def test_frames_without_junk_between_them_are_all_taken_from_a_window(wanted: frozenset[int] | None) -> None:
    rng = random.Random(3)
    frames = [frame(rng) for _ in range(3_000)]
    framer = Framer(wanted)
    found = framer.feed(b"\xfe\x01" + b"".join(frames))
    assert framer.frames == 3_000 and framer.bad_bytes == 2
    assert [one.raw for one in found] == [
        one for one in frames if wanted is None or framer_module.message_id(one) == 30
    ]


@pytest.mark.parametrize("unit", UNITS)
def test_junk_of_a_whole_read_costs_a_few_thousand_checks_one_by_one(
    unit: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    checks = 0

    def counted(buffer: bytes, at: int) -> int:
        nonlocal checks
        checks += 1
        return check_frame(buffer, at)

    monkeypatch.setattr(framer_module, "check_frame", counted)
    junk = (bytes.fromhex(unit) * READ_BYTES)[:READ_BYTES]
    framer = Framer(frozenset())
    framer.feed(junk)
    assert checks < 2_500 and len(framer._rest) <= LONGEST_FRAME


def test_memory_of_a_read_of_junk_is_that_of_one_window() -> None:
    framer, junk = Framer(frozenset()), b"\xfe\x01" * (READ_BYTES // 2)
    framer.feed(junk)
    peaks = []
    for data in (junk, 4 * junk):
        tracemalloc.start()
        framer.feed(data)
        peaks.append(tracemalloc.get_traced_memory()[1] - len(data))
        tracemalloc.stop()
    assert peaks[0] < 3_000_000 and abs(peaks[1] - peaks[0]) < 100_000


def test_checksums_of_spans_are_pymavlinks() -> None:
    rng = np.random.default_rng(5)
    data = rng.integers(0, 256, MOST_BYTES, dtype=np.uint8)
    starts = np.sort(rng.choice(MOST_BYTES - 300, 60, replace=False))
    ends = starts + rng.integers(5, 265, len(starts))
    ends[-1] = MOST_BYTES - 2
    extras = rng.integers(0, 256, len(starts), dtype=np.uint8)
    for start, end, extra in zip(starts.tolist(), ends.tolist(), extras.tolist(), strict=True):
        told = data.copy()
        told[end : end + 2] = list(x25crc(told[start:end].tobytes() + bytes([extra])).crc.to_bytes(2, "little"))
        span = np.array([start]), np.array([end]), np.array([extra], dtype=np.uint8)
        assert Checksums(told).are_right(*span).tolist() == [True]
        for bit in range(8):
            wrong = told.copy()
            wrong[rng.integers(start, end + 2)] ^= 1 << bit
            assert Checksums(wrong).are_right(*span).tolist() == [False]
        assert not Checksums(told).are_right(span[0], span[1], span[2] ^ np.uint8(1)).any()


def test_no_spans_give_no_answers() -> None:
    nothing = np.zeros(0, dtype=np.intp)
    assert not len(Checksums(np.zeros(0, np.uint8)).are_right(nothing, nothing, np.zeros(0, np.uint8)))
