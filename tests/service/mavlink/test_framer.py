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
    count = int(os.environ.get("DISTLOC_FRAMER_MESSAGES", "200000"))
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
