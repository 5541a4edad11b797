"""The framer against junk, cuts and memory growth; its decoder."""

import os
import random
import tracemalloc

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from service.mavlink.framer import LONGEST_FRAME, Decoder, Framer, decode


def packed(index: int, mav: mavlink.MAVLink, v1: bool = False) -> bytes:
    mav.seq = index % 256
    return bytes(mavlink.MAVLink_attitude_message(index + 1, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6).pack(mav, force_mavlink1=v1))


@pytest.mark.parametrize("junk_bytes", [1, 10, 100, 300])
def test_frames_survive_junk(junk_bytes: int) -> None:
    rng = random.Random(junk_bytes)
    mav = mavlink.MAVLink(None, 1, 1)
    stream = b"".join(rng.randbytes(junk_bytes) + packed(i, mav, i % 2 == 0) for i in range(2000))
    framer = Framer()
    times = [decode(f).time_boot_ms for f in framer.feed(stream) if f.message_id == 30]
    assert len(times) >= 1980
    assert times == sorted(set(times)) and set(times) <= set(range(1, 2001))
    assert framer.bad_bytes >= 0.9 * 2000 * junk_bytes


def test_byte_by_byte_is_the_same_as_at_once() -> None:
    mav = mavlink.MAVLink(None, 3, 1)
    stream = b"".join(packed(i, mav, i % 3 == 0) + b"\xfd\xfe\x00" for i in range(50))
    at_once, single = Framer(), Framer()
    frames = [f for i in range(len(stream)) for f in single.feed(stream[i : i + 1])]
    assert frames == at_once.feed(stream) and len(frames) >= 48
    assert {(f.system, f.component, f.version) for f in frames} == {(3, 1, 1), (3, 1, 2)}


def test_signed_frame_and_wrong_crc() -> None:
    mav = mavlink.MAVLink(None, 1, 1)
    mav.signing.secret_key, mav.signing.sign_outgoing, mav.signing.timestamp = b"k" * 32, True, 1
    signed = packed(5, mav)
    framer = Framer()
    found = framer.feed(signed + bytes(300))
    assert [f.raw for f in found] == [signed] and decode(found[0]).time_boot_ms == 6
    broken = signed[:20] + bytes([signed[20] ^ 1]) + signed[21:]
    assert framer.feed(broken + bytes(300)) == [] and framer.bad_crc >= 1


def test_wanted_ids_and_unknown_ids() -> None:
    mav = mavlink.MAVLink(None, 1, 1)
    framer = Framer(frozenset({0}))
    assert framer.feed(packed(0, mav)) == [] and framer.frames == 1
    framer.feed(bytes([0xFD, 0, 0, 0, 0, 1, 1, 0xFF, 0xFF, 0xFF, 0, 0]))
    assert framer.unknown_ids == 1


def test_memory_is_flat_over_chunks_that_never_end_on_a_frame() -> None:
    count = int(os.environ.get("DISTLOC_FRAMER_MESSAGES", "40000"))
    mav = mavlink.MAVLink(None, 1, 1)
    batch = b"".join(packed(i, mav) for i in range(100))
    shifted = batch[7:] + batch[:7]  # every chunk ends 7 bytes into a frame
    framer = Framer(frozenset({0}))
    framer.feed(batch[:7])
    framer.feed(shifted)
    tracemalloc.start()
    before, _ = tracemalloc.get_traced_memory()
    for _ in range(count // 100):
        framer.feed(shifted)
    after, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert framer.frames >= count and len(framer._rest) <= LONGEST_FRAME
    assert after - before < 10_000 and peak - before < 100_000


def test_decoder_gives_none_on_nonsense() -> None:
    mav = mavlink.MAVLink(None, 1, 1)
    (frame,) = Framer().feed(packed(0, mav))
    broken = type(frame)(frame.raw[:-3], 2, 1, 1, 0, 30)
    assert Decoder().decode(broken) is None


def unknown(sequence: int, payload: bytes = b"event", system: int = 1) -> bytes:
    """A frame of PX4's EVENT, which our dialect lacks; nobody can check its CRC."""
    return bytes([0xFD, len(payload), 0, 0, sequence, system, 1, 410 % 256, 410 // 256, 0]) + payload + b"ab"


def test_unknown_ids_are_no_junk_and_no_sign_of_life() -> None:
    mav = mavlink.MAVLink(None, 1, 1)
    stream = b"".join(unknown(2 * i % 256) + packed(2 * i + 1, mav) for i in range(300))
    framer = Framer()
    frames = framer.feed(stream)
    assert (framer.frames, framer.unknown_ids, framer.bad_bytes) == (300, 300, 0)
    assert [frame.is_known for frame in frames[:4]] == [False, True, False, True]
    assert [frame.sequence for frame in frames] == [number % 256 for number in range(600)]


@pytest.mark.parametrize("chunk_bytes", [1, 7, 64, 5000])
def test_junk_that_looks_like_an_unknown_frame_swallows_no_good_one(chunk_bytes: int) -> None:
    rng, mav = random.Random(chunk_bytes), mavlink.MAVLink(None, 1, 1)
    parts = []
    for index in range(300):
        header = unknown(0, b"")[:10]
        parts += [header[:1] + bytes([rng.randrange(256)]) + header[2:], rng.randbytes(rng.randrange(8))]
        parts.append(packed(index, mav, index % 2 == 0))
    stream = b"".join(parts) + bytes(600)
    framer = Framer()
    found = [f for at in range(0, len(stream), chunk_bytes) for f in framer.feed(stream[at : at + chunk_bytes])]
    times = [decode(frame).time_boot_ms for frame in found if frame.message_id == 30]
    assert times == list(range(1, 301)) and len(framer._rest) <= LONGEST_FRAME


@pytest.mark.parametrize("unit", ["fe", "fd", "fd3300", "fefd", "fe33fefefefd", "fd330000000101ffff00"])
def test_junk_is_passed_over_by_its_headers_and_a_frame_behind_it_is_found(unit: str) -> None:
    junk, mav = bytes.fromhex(unit) * (65_536 // len(bytes.fromhex(unit))), mavlink.MAVLink(None, 1, 1)
    framer = Framer()
    found = [f for f in framer.feed(junk + bytes(300) + packed(7, mav) + bytes(300)) if f.is_known]
    assert [decode(frame).time_boot_ms for frame in found] == [8]
