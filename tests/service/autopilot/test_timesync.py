"""The clock offset under jitter, foreign replies, jumps and silence."""

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from service.autopilot.autopilot import Autopilot
from service.autopilot.timesync import OUTSTANDING, Timesync
from service.config.sections import MavlinkConfig, MountConfig
from service.mavlink.framer import Framer, decode

MS = 1_000_000
OFFSET_NS = 5_000_000_000_000


def exchange(sync: Timesync, now_ns: int, up_ns: int, down_ns: int, offset_ns: int = OFFSET_NS) -> bool:
    ts1 = sync.request(now_ns)
    return sync.reply(ts1, now_ns + up_ns - offset_ns, now_ns + up_ns + down_ns)


def test_jitter_of_5_to_30_ms_leaves_under_2_ms_rms() -> None:
    errors_ms = []
    for seed in range(100):
        rng = np.random.default_rng(seed)
        sync = Timesync()
        for step in range(150):
            up_ns, down_ns = (int(value) for value in rng.uniform(5, 30, 2) * MS)
            assert exchange(sync, OFFSET_NS + 10**10 + step * 100 * MS, up_ns, down_ns)
        offset_ns = sync.offset_ns()
        assert offset_ns is not None
        errors_ms.append((offset_ns - OFFSET_NS) / MS)
    rms_ms = float(np.sqrt(np.mean(np.square(errors_ms))))
    assert 0.1 < rms_ms < 2.0
    assert abs(np.mean(errors_ms)) < 0.5


def test_one_exchange_is_the_midpoint_of_the_send_time_given_not_of_ts1() -> None:
    sync = Timesync()
    sync.request_sent(77, OFFSET_NS + 1000)
    assert sync.reply(77, 1500, OFFSET_NS + 2000)
    assert sync.offset_ns() == OFFSET_NS and sync.rtt_ns == 1000 and sync.source == "timesync"


def test_refused_replies() -> None:
    sync = Timesync()
    ts1 = sync.request(1000)
    assert not sync.reply(ts1 + 1, 5, 2000)
    assert not sync.reply(ts1, 0, 2000)
    assert not sync.reply(ts1, 5, 500)
    assert sync.offset_ns() is None and sync.source == "none" and sync.degraded
    assert not sync.reply(ts1, 5, 2000)


def test_outstanding_requests_are_bounded_and_distinct() -> None:
    sync = Timesync()
    sent = [sync.request(1000) for _ in range(10 * OUTSTANDING)]
    assert len(set(sent)) == len(sent) and len(sync._sent_ns) == OUTSTANDING
    assert not sync.reply(sent[0], 5, 2000) and sync.reply(sent[-1], 5, 2000)


def test_a_jump_needs_three_samples_and_a_slow_reply_is_none() -> None:
    sync = Timesync()
    now_ns = OFFSET_NS + 10**10
    exchange(sync, now_ns, 5 * MS, 5 * MS)
    for step in range(1, 6):
        exchange(sync, now_ns + step * 100 * MS, 5 * MS, 2_800 * MS)
    assert not sync.take_jump() and sync.offset_ns() == OFFSET_NS
    for step in range(10, 12):
        exchange(sync, now_ns + step * 100 * MS, 5 * MS, 5 * MS, OFFSET_NS + 10**9)
    assert not sync.take_jump()
    exchange(sync, now_ns + 1200 * MS, 5 * MS, 5 * MS, OFFSET_NS + 10**9)
    assert sync.take_jump() and not sync.take_jump()
    assert sync.offset_ns() == OFFSET_NS + 10**9


def test_silence_keeps_the_offset_and_degrades_after_30_s() -> None:
    sync = Timesync()
    now_ns = OFFSET_NS + 10**10
    exchange(sync, now_ns, 5 * MS, 5 * MS)
    sync.request(now_ns + 29 * 10**9)
    assert not sync.degraded
    sync.request(now_ns + 31 * 10**9)
    assert sync.degraded and sync.offset_ns() == OFFSET_NS


def test_envelope_without_replies_forgets_old_minima() -> None:
    sync = Timesync()
    for step in range(400):
        delay_ns = (3 if step == 0 else 10 + step % 7) * MS
        boot_ns = 10**9 + step * 50 * MS
        sync.observe_boot(boot_ns, boot_ns + OFFSET_NS + delay_ns)
        if step == 20:
            assert sync.offset_ns() == OFFSET_NS + 3 * MS
    assert sync.source == "envelope" and sync.degraded and sync.offset_ns() == OFFSET_NS + 10 * MS
    sync.reset()
    assert sync.source == "none"


@pytest.mark.parametrize("drift_ppm", [0.0, 50.0])
def test_a_reply_a_second_leaves_the_clock_as_good(drift_ppm: float) -> None:
    errors_ms = []
    for seed in range(40):
        rng = np.random.default_rng(seed)
        sync, now_ns, offset_ns = Timesync(), OFFSET_NS + 10**10, OFFSET_NS
        for step in range(90):
            now_ns += (100 if step < 10 else 1000) * MS
            offset_ns = OFFSET_NS + round((now_ns - OFFSET_NS) * drift_ppm * 1e-6)
            up_ns, down_ns = (int(value) for value in rng.uniform(5, 30, 2) * MS)
            assert exchange(sync, now_ns, up_ns, down_ns, offset_ns)
        errors_ms.append(((sync.offset_ns() or 0) - offset_ns) / MS)
    assert float(np.sqrt(np.mean(np.square(errors_ms)))) < 2.5


def requests_in(autopilot: Autopilot, now_ns: int, is_answered: bool) -> int:
    """TIMESYNC requests that go out in the ten seconds from then on."""
    count = 0
    for at_ns in range(now_ns, now_ns + 10 * 10**9, 25 * MS):
        for data in autopilot.due(at_ns):
            for frame in Framer().feed(data):
                message = decode(frame)
                if message.get_type() == "TIMESYNC" and message.tc1 == 0:
                    count += 1
                    if is_answered:
                        autopilot.timesync.reply(message.ts1, at_ns + 5 * MS - OFFSET_NS, at_ns + 10 * MS)
    return count


def test_requests_slow_down_once_locked_and_where_nobody_replies_and_are_fast_in_doubt() -> None:
    autopilot = Autopilot(MavlinkConfig(), MountConfig())
    heartbeat = mavlink.MAVLink_heartbeat_message(2, 3, 0, 0, 4, 3).pack(mavlink.MAVLink(None, 1, 1))
    (frame,) = Framer().feed(bytes(heartbeat))
    start_ns = OFFSET_NS + 10**12
    autopilot.receive(frame, start_ns)
    counts = [requests_in(autopilot, start_ns + k * 10**10, k in (0, 1, 6, 7)) for k in range(8)]
    assert 15 <= counts[0] <= 25 and counts[1] <= 11
    assert counts[2] > 60  # no reply for 3 s
    assert counts[4] + counts[5] <= 150 and counts[7] <= 11
