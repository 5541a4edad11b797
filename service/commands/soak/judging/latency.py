"""How late reports come: from the moment at which a frame was handed over until its report is heard over zenoh."""

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from distloc.types import FloatArray
from service.commands.soak.frame_ring import Handed
from service.publish.wire import utc_s
from service.simulator.operator import Heard
from service.simulator.simulated_autopilot import UTC_START_S

_STEP_MS, _STEPS = 1, 20_000  # of the histogram over the whole flight; what is beyond counts as the last
_MOST_A_BIN = 8192
_CLOCK_NS = 10_000_000  # how well the autopilot's clock is known
_PICKED_UP_NS = 200_000_000  # a frame's time is when the service picks it up: on a busy machine it lies for a while


@dataclass(frozen=True, slots=True)
class Spread:
    """Milliseconds; not a number where nothing was heard."""

    p50_ms: float
    p95_ms: float
    max_ms: float


class Latencies:
    """Takes reports on any thread. Its size is fixed.

    A report tells its frame's time as UTC. That leads to the frame, and the frame to the stamp of when it was handed
    over, which is exact.
    """

    def __init__(self, handed: Callable[[], Handed], start_ns: int) -> None:
        self.reports = 0
        self.unmatched = 0  # that tell a time at which there was no frame: then that time counts
        self.max_ms = 0.0
        self._handed, self._start_ns = handed, start_ns
        self._host_utc_ns = time.time_ns() - time.monotonic_ns()
        self._histogram = np.zeros(_STEPS, np.int64)
        self._bin = np.zeros(_MOST_A_BIN)
        self._in_bin = 0
        self._lock = threading.Lock()

    def take(self, heard: Heard) -> None:
        """A report's properties, and when they came."""
        if heard.what["time_utc"] is None:
            return
        utc_ns = round(utc_s(heard.what["time_utc"]) * 1e3) * 1_000_000
        if heard.what["time_source"] == "gps":
            told_ns = utc_ns - round(UTC_START_S * 1e9) + self._start_ns
        else:
            told_ns = utc_ns - self._host_utc_ns
        stamps_ns = self._handed().stamps_ns
        before_ns = stamps_ns[stamps_ns <= told_ns + _CLOCK_NS]
        is_known = before_ns.size > 0 and told_ns - int(before_ns[-1]) < _PICKED_UP_NS
        stamp_ns = int(before_ns[-1]) if is_known else told_ns
        self.add(heard.at_s * 1e3 - stamp_ns * 1e-6, is_known)

    def add(self, latency_ms: float, is_known: bool = True) -> None:
        """One report's."""
        with self._lock:
            self.reports += 1
            self.unmatched += not is_known
            self.max_ms = max(self.max_ms, latency_ms)
            self._histogram[int(np.clip(latency_ms / _STEP_MS, 0, _STEPS - 1))] += 1
            self._bin[self._in_bin % _MOST_A_BIN] = latency_ms
            self._in_bin += 1

    def take_bin(self) -> Spread:
        """Of the reports since the last call."""
        with self._lock:
            values = self._bin[: min(self._in_bin, _MOST_A_BIN)].copy()
            self._in_bin = 0
        return _spread(values)

    def overall(self) -> Spread:
        """Of all reports, to a millisecond."""
        with self._lock:
            shares = np.cumsum(self._histogram)
        if not shares[-1]:
            return _spread(np.empty(0))
        p50, p95 = (float((np.searchsorted(shares, share * shares[-1]) + 0.5) * _STEP_MS) for share in (0.5, 0.95))
        return Spread(p50, p95, self.max_ms)


def _spread(values: FloatArray) -> Spread:
    if not values.size:
        return Spread(np.nan, np.nan, np.nan)
    return Spread(float(np.median(values)), float(np.percentile(values, 95)), float(values.max()))
