"""Memory and CPU time of another process, from /proc; the soak asks once a second."""

import os
from dataclasses import dataclass
from pathlib import Path

_TICK_S = 1.0 / os.sysconf("SC_CLK_TCK")


@dataclass(frozen=True, slots=True)
class ProcessSample:
    """What a process has resident (megabytes of 1e6 bytes, shared libraries included) and has used, all threads."""

    memory_mb: float
    peak_mb: float  # the most that it ever had, between the samples too
    cpu_s: float
    threads: int


def sample(pid: int) -> ProcessSample | None:
    """The process now; None where it is gone."""
    folder = Path("/proc") / str(pid)
    try:
        rollup = (folder / "smaps_rollup").read_text()
        status = (folder / "status").read_text()
        fields = (folder / "stat").read_text().rpartition(")")[2].split()
    except OSError:
        return None
    memory_mb, peak_mb = _megabytes(rollup, "Rss:"), _megabytes(status, "VmHWM:")
    return ProcessSample(memory_mb, peak_mb, (int(fields[11]) + int(fields[12])) * _TICK_S, int(fields[17]))


def _megabytes(text: str, name: str) -> float:
    return next((int(line.split()[1]) * 1024e-6 for line in text.splitlines() if line.startswith(name)), 0.0)
