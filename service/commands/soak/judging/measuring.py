"""Takes a soak's figures once a second and puts them into the series."""

import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from service.commands.soak.frame_ring import read_handed
from service.commands.soak.judging.latency import Latencies, Spread
from service.commands.soak.judging.meter import ProcessSample, sample
from service.commands.soak.judging.series import Series
from service.simulator.craft import CraftOnAir
from service.simulator.operator import Operator

_BIN_ROWS = 10  # seconds
_TOLD_OF_S = 60.0
_RATES = ("frames", "localised", "reports", "messages")


@dataclass(frozen=True, slots=True)
class Now:
    """How it goes: `latency` is of the last ten seconds."""

    t_s: float
    memory_mb: float
    latency: Spread
    fault: str


class Measuring:
    """Asks the kernel, the camera's memory, the autopilot and the last status; `row` is called once a second."""

    def __init__(
        self, series: Series, pid: int, memory: int, latencies: Latencies, air: CraftOnAir, operator: Operator
    ) -> None:
        self._series, self._pid, self._latencies, self._air, self._operator = series, pid, latencies, air, operator
        self._memory = memory
        self._rows = 0
        self._latency = Spread(math.nan, math.nan, math.nan)
        self._first = self._counts()
        self._last: tuple[float, ProcessSample, dict[str, int]] | None = None

    @property
    def flown(self) -> dict[str, int]:
        """Counts since the start, by name."""
        return {name: count - self._first[name] for name, count in self._counts().items()}

    def row(self, t_s: float, fault: str, tell: Callable[[Now], None]) -> bool:
        """Add the row of this second; False where the process is gone."""
        now, counts = sample(self._pid), self._counts()
        if now is None:
            return False
        last, self._last = self._last, (t_s, now, counts)
        if last is None:
            return True
        gap_s = t_s - last[0]
        rates = {f"{name}_hz": (counts[name] - last[2][name]) / gap_s for name in _RATES}
        self._rows += 1
        values: dict[str, float] = {}
        if self._rows % _BIN_ROWS == 0:
            self._latency = self._latencies.take_bin()
            values = {f"latency_{name}": getattr(self._latency, name) for name in ("p50_ms", "p95_ms", "max_ms")}
        cpu_share = (now.cpu_s - last[1].cpu_s) / gap_s
        self._series.add(
            t_s=t_s,
            memory_mb=now.memory_mb,
            peak_mb=now.peak_mb,
            cpu_share=cpu_share,
            threads=now.threads,
            targets=self._targets(),
            **rates,
            **values,
        )
        tell(Now(t_s, now.memory_mb, self._latency, fault))
        return True

    def _targets(self) -> int:
        since_s = time.monotonic() - _TOLD_OF_S
        reports = list(self._operator.reports.values())
        return sum(report.at_s > since_s and report.what["state"] != "dismissed" for report in reports)

    def _counts(self) -> dict[str, int]:
        """`used` and `localised` are as the last status has them."""
        status = self._operator.status
        counters: dict[str, Any] = {} if status is None else status.what["counters"]
        handed = read_handed(self._memory)
        return {
            "frames": handed.frames,
            "late": handed.late,
            "localised": counters.get("frames", {}).get("localised", 0),
            "reports": self._latencies.reports,
            "messages": self._air.sent,
            "used": sum(counters.get("autopilot", {}).get("messages", {}).values()),
        }
