"""What a soak found, as soak.json holds it, and the verdict. Free of I/O."""

import math
from typing import Literal

import msgspec
import numpy as np

from distloc.types import FloatArray
from service.commands.soak.judging.targets import TargetFound
from service.commands.soak.judging.trend import theil_sen

MOST_MEMORY_MB = 200.0
MOST_SLOPE_MB_H = 1.0
MOST_LATENCY_MS = 1000.0
MOST_RECOVERY_S = 10.0  # docs/faults.md
LEAST_INSIDE = 0.8  # of the ellipses; of twenty that hold the truth in 95 % of all cases less do once in 400 flights
MOST_SPOILT = 0.3  # of the frames: a fault lasts 8 of 40 s at the most, and then comes its recovery
SETTLED_S = 300.0  # memory is still filled for the first time before, or for the first sixth of a short flight
_FRAME_ROWS = 10  # a frame's tensors are held while it is worked on, 20 MB: how often that is seen is no growth
# What allocators and caches move without a leak. Over 25 minutes it is 1 MB/h; a shorter flight cannot tell as little.
RESOLUTION_MB = 0.4


class FaultResult(msgspec.Struct, frozen=True, kw_only=True):
    """Seconds from the start; `recovered_s` from its end until all was well, null if that was not seen."""

    kind: str
    start_s: float
    end_s: float
    recovered_s: float | None
    degraded: list[str]


class Memory(msgspec.Struct, frozen=True, kw_only=True):
    """The service's resident memory in megabytes (1e6 bytes); `at_5_min` is null for a shorter flight."""

    start_mb: float
    at_5_min_mb: float | None
    end_mb: float
    peak_mb: float
    slope_mb_h: float
    slope_from_s: float


class Cpu(msgspec.Struct, frozen=True, kw_only=True):
    """Share of one core, all threads: 1.5 is one and a half cores. p95 of seconds."""

    mean: float
    p95: float


class Latency(msgspec.Struct, frozen=True, kw_only=True):
    """From handing over a frame to hearing its report over zenoh; null where none was heard."""

    p50_ms: float | None
    p95_ms: float | None
    max_ms: float | None


class Limit(msgspec.Struct, frozen=True, kw_only=True):
    name: str
    measured: float | None
    limit: float
    is_met: bool


class Verdict(msgspec.Struct, frozen=True, kw_only=True):
    passed: bool
    limits: list[Limit]


class Life(msgspec.Struct, frozen=True, kw_only=True):
    """How the process went: `crashes` is 1 if it ended before it was told or with an exit code that is not 0."""

    ready_s: float
    crashes: int
    watchdog_misses: int


class Counts(msgspec.Struct, frozen=True, kw_only=True):
    """`frames_late` were drawn too late to be handed over; `messages_used` are those that the
    service has a use for, as it counts them; `reports_unmatched` told of no frame's moment.
    `targets_inside` are those whose ellipse holds a fire, `targets_false` those with none near."""

    frames_wanted: int
    frames_sent: int
    frames_late: int
    frames_localised: int
    messages_sent: int
    messages_used: int
    reports: int
    reports_unmatched: int
    targets: int
    targets_inside: int
    targets_false: int


class SoakResult(msgspec.Struct, frozen=True, kw_only=True):
    """soak.json."""

    schema: Literal["distloc/soak/1"] = "distloc/soak/1"
    minutes: float
    minutes_wanted: float
    speed: float
    seed: int
    segmenter: str
    n_particles: int
    counts: Counts
    memory: Memory
    cpu: Cpu
    latency: Latency
    life: Life
    faults: list[FaultResult]
    targets: list[TargetFound]
    verdict: Verdict


def memory_from_series(t_s: FloatArray, memory_mb: FloatArray, peak_mb: FloatArray) -> Memory:
    """From a second's rows (N,), N > 0; `peak_mb` is the most that the process has ever had until then."""
    from_s = min(SETTLED_S, float(t_s[-1]) / 6.0)
    settled = np.flatnonzero(t_s >= from_s)
    starts = np.arange(0, settled.size, _FRAME_ROWS)
    lowest_mb = np.minimum.reduceat(memory_mb[settled], starts) if starts.size else np.empty(0)
    later = np.flatnonzero(t_s >= SETTLED_S)
    return Memory(
        start_mb=round(float(memory_mb[0]), 1),
        at_5_min_mb=round(float(memory_mb[later[0]]), 1) if later.size else None,
        end_mb=round(float(memory_mb[-1]), 1),
        peak_mb=round(float(peak_mb.max()), 1),
        slope_mb_h=round(theil_sen(t_s[settled[starts]] / 3600.0, lowest_mb), 3),
        slope_from_s=round(from_s, 1),
    )


def verdict(
    memory: Memory,
    latency: Latency,
    life: Life,
    counts: Counts,
    faults: list[FaultResult],
    flown_s: float,
) -> Verdict:
    """Every limit with its figure. The slope's is MOST_SLOPE_MB_H, or more where the flight is too short to tell."""
    settled_h = max(flown_s - memory.slope_from_s, 1.0) / 3600.0
    slowest_s = [fault.recovered_s for fault in faults]
    never = sum(1 for recovered_s in slowest_s if recovered_s is None)
    worst_s = max((recovered_s for recovered_s in slowest_s if recovered_s is not None), default=None)
    unspoilt = counts.frames_sent * (1.0 - MOST_SPOILT)
    limits = [
        _at_most("memory slope, MB/h", memory.slope_mb_h, round(max(MOST_SLOPE_MB_H, RESOLUTION_MB / settled_h), 2)),
        _at_most("memory, MB", memory.peak_mb, MOST_MEMORY_MB),
        _at_most("latest report, ms", latency.max_ms, MOST_LATENCY_MS),
        _at_most("crashes", life.crashes, 0),
        _at_most("watchdog misses", life.watchdog_misses, 0),
        _at_least("targets", counts.targets, 1),
        _at_least("targets inside their ellipse", counts.targets_inside, math.floor(LEAST_INSIDE * counts.targets)),
        _at_most("false targets", counts.targets_false, 0),
        _at_least("frames localised", counts.frames_localised, round(unspoilt)),
    ]
    if faults:
        limits.append(_at_most("faults not recovered from", never, 0))
        limits.append(_at_most("slowest recovery, s", worst_s, MOST_RECOVERY_S))
    return Verdict(passed=all(limit.is_met for limit in limits), limits=limits)


def _at_most(name: str, measured: float | None, limit: float) -> Limit:
    """What was not measured is not met."""
    return Limit(name=name, measured=measured, limit=limit, is_met=measured is not None and measured <= limit)


def _at_least(name: str, measured: int, limit: int) -> Limit:
    return Limit(name=f"{name}, at least", measured=measured, limit=limit, is_met=measured >= limit)
