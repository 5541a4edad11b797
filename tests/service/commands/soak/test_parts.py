"""The soak's parts: the slope, the verdict, the plan of faults, latencies, frames between processes, the watchdog."""

import os
import socket

import numpy as np
import pytest

from service.commands.soak.faults import KINDS
from service.commands.soak.frame_ring import SLOTS, STAMPS, FrameReader, FrameWriter, Handed, make_memory, read_handed
from service.commands.soak.judging.latency import Latencies
from service.commands.soak.judging.result import (
    Counts,
    FaultResult,
    Latency,
    Life,
    Memory,
    Verdict,
    memory_from_series,
    verdict,
)
from service.commands.soak.judging.series import COLUMNS, Series
from service.commands.soak.judging.targets import TargetCount
from service.commands.soak.judging.trend import theil_sen
from service.commands.soak.scene import ORBIT
from service.commands.soak.schedule import Pace, planned_faults
from service.commands.soak.supervisor import WATCHDOG_S, Notified
from service.flight.systemd_notify import notify
from service.publish.wire import utc_text
from service.simulator.chatter import MESSAGES_HZ, attitude_hz, chatter, chatter_hz, position_hz
from service.simulator.operator import Heard
from service.simulator.simulated_autopilot import UTC_START_S

HOUR_S = 3600.0


def memory_mb(t_s: np.ndarray, slope_mb_h: float, rng: np.random.Generator) -> np.ndarray:
    """Fills in the first minutes, jitters, has spikes."""
    filled = 180.0 - 20.0 * np.exp(-t_s / 60.0)
    spikes = np.where(rng.random(t_s.size) < 0.02, 8.0, 0.0)
    return filled + slope_mb_h * t_s / HOUR_S + rng.normal(0.0, 0.3, t_s.size) + spikes


def of_series(t_s: np.ndarray, memory_mb: np.ndarray) -> Memory:
    return memory_from_series(t_s, memory_mb, np.maximum.accumulate(memory_mb))


def judged(
    duration_s: float = HOUR_S,
    *,
    memory: Memory | None = None,
    latency: float | None = 200.0,
    life: Life | None = None,
    targets: int = 2,
    inside: int = 2,
    false: int = 0,
    localised: int = 10,
    recovered_s: float | None = 1.0,
    is_spoilt: bool = True,
) -> Verdict:
    fault = FaultResult(kind="k", start_s=30.0, end_s=35.0, recovered_s=recovered_s, degraded=[])
    counted = {
        "targets": targets,
        "targets_inside": inside,
        "targets_false": false,
        "frames_localised": localised,
    }
    counts = Counts(**dict.fromkeys(Counts.__struct_fields__, 10) | counted)
    well = Memory(start_mb=150.0, at_5_min_mb=150.0, end_mb=150.0, peak_mb=150.0, slope_mb_h=0.0, slope_from_s=300.0)
    return verdict(
        memory or well,
        Latency(p50_ms=latency, p95_ms=latency, max_ms=latency),
        life or Life(ready_s=1.0, crashes=0, watchdog_misses=0),
        counts,
        [fault] if is_spoilt else [],
        duration_s,
    )


def broken(one: Verdict) -> list[str]:
    assert one.passed == all(limit.is_met for limit in one.limits)
    return [limit.name for limit in one.limits if not limit.is_met]


def test_slope_of_a_line_and_of_nothing() -> None:
    x = np.arange(10.0)
    assert theil_sen(x, 3.0 - 0.5 * x) == pytest.approx(-0.5)
    assert theil_sen(x[:1], x[:1]) == theil_sen(np.empty(0), np.empty(0)) == 0.0
    y = 2.0 * x
    y[[2, 7]] = 1e6, np.nan  # one point in ten is wild, one is missing
    assert theil_sen(x, y) == pytest.approx(2.0)


@pytest.mark.parametrize("seed", range(3))
def test_a_leak_is_found_and_a_flat_noise_is_none(seed: int) -> None:
    rng, t_s = np.random.default_rng(seed), np.arange(HOUR_S)
    leaks = of_series(t_s, memory_mb(t_s, 2.0, rng))
    assert 1.8 < leaks.slope_mb_h < 2.2
    assert broken(judged(memory=leaks)) == ["memory slope, MB/h"]
    flat = of_series(t_s, memory_mb(t_s, 0.0, rng))
    assert -0.2 < flat.slope_mb_h < 0.2
    assert broken(judged(memory=flat)) == []
    half = t_s[: 30 * 60]
    assert broken(judged(30 * 60.0, memory=of_series(half, memory_mb(half, 2.0, rng)))) != []


def test_the_beginning_is_left_out_of_the_slope() -> None:
    t_s = np.arange(60.0)
    grown = np.where(t_s < 10.0, 100.0 + t_s, 110.0)
    found = of_series(t_s, grown)
    assert found.slope_mb_h == 0.0 and found.slope_from_s == pytest.approx(9.8, abs=0.1)
    assert (found.start_mb, found.at_5_min_mb, found.end_mb, found.peak_mb) == (100.0, None, 110.0, 110.0)


def test_a_short_flight_is_judged_by_what_it_can_tell() -> None:
    limits = {minutes: judged(minutes * 60.0, memory=None).limits[0].limit for minutes in (6, 30, 90)}
    assert limits[6] == pytest.approx(0.4 * 60.0) and limits[30] == limits[90] == 1.0


@pytest.mark.parametrize(
    ("spoilt", "names"),
    [
        ({"latency": 1001.0}, ["latest report, ms"]),
        ({"latency": None}, ["latest report, ms"]),
        ({"life": Life(ready_s=1.0, crashes=1, watchdog_misses=0)}, ["crashes"]),
        ({"life": Life(ready_s=1.0, crashes=0, watchdog_misses=1)}, ["watchdog misses"]),
        ({"recovered_s": None}, ["faults not recovered from", "slowest recovery, s"]),
        ({"recovered_s": None, "is_spoilt": False}, []),
        ({"recovered_s": 10.1}, ["slowest recovery, s"]),
        ({"targets": 0, "inside": 0}, ["targets, at least"]),
        ({"targets": 10, "inside": 8}, []),
        ({"targets": 10, "inside": 7}, ["targets inside their ellipse, at least"]),
        ({"false": 1}, ["false targets"]),
        ({"localised": 6}, ["frames localised, at least"]),
    ],
)
def test_each_limit_is_judged_by_itself(spoilt: dict[str, object], names: list[str]) -> None:
    assert broken(judged(**spoilt)) == names  # type: ignore[arg-type]


def test_too_much_memory_at_any_time_fails() -> None:
    t_s = np.arange(HOUR_S)
    once = np.where(t_s == 40.0, 200.5, 150.0)
    assert broken(judged(memory=of_series(t_s, once))) == ["memory, MB"]
    unseen = memory_from_series(t_s, np.full(t_s.size, 150.0), np.where(t_s > 40.0, 200.5, 150.0))
    assert broken(judged(memory=unseen)) == ["memory, MB"]  # between two looks


@pytest.mark.parametrize("seed", range(20))
def test_faults_come_apart_and_often_and_of_every_kind(seed: int) -> None:
    pace = Pace()
    planned = planned_faults(30 * 60.0, KINDS, pace, np.random.default_rng(seed))
    assert planned == planned_faults(30 * 60.0, KINDS, pace, np.random.default_rng(seed))
    assert {fault.kind for fault in planned} == set(KINDS)
    starts_s = [fault.start_s for fault in planned]
    assert starts_s[0] >= pace.warm_s and max(np.diff([0.0, *starts_s, 30 * 60.0])) < 60.0
    for fault, after_s in zip(planned, [*starts_s[1:], 30 * 60.0], strict=True):
        assert 4.0 <= fault.end_s - fault.start_s <= 8.0
        assert after_s - fault.end_s >= pace.rest_s - 0.02
    faulty_s = sum(fault.end_s - fault.start_s for fault in planned)
    assert 0.08 < faulty_s / (30 * 60.0) < 0.25


def test_seeds_differ_and_a_pace_that_cannot_be_is_refused() -> None:
    plans = [planned_faults(600.0, KINDS, Pace(), np.random.default_rng(seed)) for seed in (1, 2)]
    assert plans[0] != plans[1]
    assert planned_faults(10.0, KINDS, Pace(), np.random.default_rng(1)) == []
    assert planned_faults(600.0, (), Pace(), np.random.default_rng(1)) == []
    with pytest.raises(ValueError, match=r"every_s is 20\.0"):
        Pace(every_s=20.0)


@pytest.mark.parametrize("speed", [0.5, 1.0, 4.0, 10.0])
def test_the_messages_add_up(speed: float) -> None:
    rates_hz = chatter_hz(speed)
    asked_hz = attitude_hz(speed) + position_hz(speed)
    assert min(rates_hz.values()) > 0.0
    assert sum(rates_hz.values()) + asked_hz == pytest.approx(MESSAGES_HZ * speed, abs=17.0)
    for number in rates_hz:
        assert chatter(number, 90_000_000_000).get_msgId() == number


def heard(latency_ms: float, stamp_ns: int, start_ns: int) -> Heard:
    text = utc_text(UTC_START_S + (stamp_ns - start_ns) * 1e-9 + 0.004)  # the service knows the clock to some ms
    return Heard(stamp_ns * 1e-9 + latency_ms * 1e-3, {"time_utc": text, "time_source": "gps"})


def test_latency_is_from_the_frame_that_a_report_tells_of() -> None:
    start_ns = 5_000_000_000_123
    stamps_ns = start_ns + np.arange(1, 101) * 100_000_000
    latencies = Latencies(lambda: Handed(100, 0, stamps_ns), start_ns)
    assert np.isnan(latencies.overall().p50_ms)
    for number, stamp_ns in enumerate(stamps_ns):
        latencies.take(heard(50.0 + number, int(stamp_ns), start_ns))
    found = latencies.take_bin()
    assert (found.p50_ms, found.max_ms) == (pytest.approx(99.5), pytest.approx(149.0))
    assert latencies.overall().p50_ms == pytest.approx(99.5, abs=1.0)
    assert latencies.overall().p95_ms == pytest.approx(found.p95_ms, abs=1.0)
    assert (latencies.reports, latencies.unmatched) == (100, 0)
    latencies.take(heard(80.0, int(stamps_ns[-1]) + 50_000_000, start_ns))  # picked up late
    assert latencies.unmatched == 0 and latencies.take_bin().max_ms == pytest.approx(130.0, abs=1.0)
    latencies.take(heard(80.0, int(stamps_ns[-1]) + 500_000_000, start_ns))  # no frame was then
    assert latencies.unmatched == 1 and latencies.take_bin().max_ms == pytest.approx(76.0, abs=1.0)
    assert np.isnan(latencies.take_bin().p50_ms)


def test_a_frame_goes_from_process_to_process_once() -> None:
    image = np.random.default_rng(0).integers(0, 255, (18, 32, 3), dtype=np.uint8)
    memory = make_memory(image.nbytes)
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    with ours, theirs:
        writer, reader = FrameWriter(memory, ours, image.nbytes), FrameReader(memory, theirs, image.nbytes)
        assert not reader.grab(), "nothing was handed over"
        for stamp_ns in (7, 8):
            writer.put(image + np.uint8(stamp_ns))
            assert writer.hand_over(stamp_ns)
        assert reader.grab()
        ok, got = reader.retrieve()
        assert ok and got is not None and (got == image + np.uint8(8)).all(), "the newest"
        writer.put(None)
        writer.hand_over(9)
        assert reader.grab() and reader.retrieve() == (False, None)
        writer.put(image[:5, :7])
        writer.hand_over(10)
        assert reader.grab()
        for stamp_ns in range(11, 11 + SLOTS):
            writer.put(image)
            writer.hand_over(stamp_ns)
        assert not reader.retrieve()[0], "it was written over"
        writer.drop()
        handed = read_handed(memory)
        assert (handed.frames, handed.late) == (4 + SLOTS, 1)
        assert handed.stamps_ns.tolist() == list(range(7, 11 + SLOTS))
        for stamp_ns in range(20, 20 + STAMPS):
            writer.hand_over(stamp_ns)
        assert read_handed(memory).stamps_ns.tolist() == list(range(20, 20 + STAMPS))
        theirs.close()
        assert not writer.hand_over(5000)
    os.close(memory)


def test_a_watchdog_that_is_not_fed_is_a_miss(monkeypatch: pytest.MonkeyPatch) -> None:
    now_s = 100.0
    notified = Notified(lambda: now_s)
    monkeypatch.setenv("NOTIFY_SOCKET", notified.address)
    now_s += 2 * WATCHDOG_S
    notified.listen()
    assert (notified.is_ready, notified.misses) == (False, 0), "it is not watched yet"
    assert notify("READY=1")
    notified.listen()
    for _ in range(3):
        now_s += 0.9 * WATCHDOG_S
        assert notify("WATCHDOG=1", "STATUS=ok")
        notified.listen()
    assert (notified.is_ready, notified.misses) == (True, 0)
    now_s += 1.1 * WATCHDOG_S
    assert notify("STATUS=stalled: localise")
    notified.listen()
    assert notified.misses == 1
    notified.close()


def test_targets_near_a_fire_are_true() -> None:
    count = TargetCount(ORBIT)
    fire = ORBIT.targets[0].plume.base_enu_m

    def tell(target: int, east_m: float, state: str, semi_minor_m: float = 50.0) -> None:
        lat_deg, lon_deg, alt_m = ORBIT.frame.geodetic_from_enu(fire + np.array([east_m, 0.0, 0.0]))
        ellipse = {"semi_major_m": 900.0, "semi_minor_m": semi_minor_m, "azimuth_deg": 0.0}
        report = {"target": target, "state": state, "altitude_msl_m": alt_m, "ellipse95": ellipse}
        count.take(report, (lon_deg, lat_deg))

    def told() -> list[tuple[int, bool, bool]]:
        return [(one.target, one.is_inside, one.is_false) for one in count.found]

    tell(1, 20.0, "confirmed")
    tell(2, 0.0, "tentative")
    assert told() == [(1, True, False)]
    tell(3, -80.0, "confirmed")
    tell(4, -120.0, "confirmed")
    tell(5, -120.0, "confirmed", semi_minor_m=130.0)
    assert told() == [(1, True, False), (3, False, False), (4, False, True), (5, True, False)]
    assert count.found[1].off_m == pytest.approx(80.0, abs=0.1)
    tell(3, 0.0, "confirmed")
    assert told()[-1] == (3, True, False)
    tell(6, -20_000.0, "confirmed", semi_minor_m=30_000.0)
    assert told()[-1] == (6, True, True), "an ellipse as large as that holds everything"


def test_the_series_has_a_fixed_size_and_empty_cells() -> None:
    series = Series(3)
    for second in range(5):
        series.add(t_s=second, memory_mb=150.25)
    assert series["t_s"].tolist() == [0.0, 1.0, 2.0]
    lines = series.csv().decode().splitlines()
    assert lines[0].split(",") == list(COLUMNS) and len(lines) == 4
    assert lines[1] == "0.000,150.250" + "," * (len(COLUMNS) - 2)
