"""What this machine is, by its parts, and its own limits: how fast it copies memory."""

import os
import platform
from collections.abc import Callable
from pathlib import Path

import cv2
import msgspec
import numpy as np

from service.commands.bench.fixed_work import ArrayWork
from service.commands.bench.timing import in_turns, median_ms

_BIG_BYTES = 128 << 20  # beyond any cache of a small computer


class Machine(msgspec.Struct, frozen=True):
    """Bandwidths count one read and one write of each byte, by one thread that copies float32 arrays.

    `fixed_work_ms` is the fixed NumPy work at 100,000 particles, the unit of the other parts' ratios.
    """

    cpu: str
    cores: int
    memory_gb: float
    python: str
    numpy: str
    opencv: str
    big_copy_mb: float
    memory_gb_per_s: float
    state_copy_mb: float
    state_sized_gb_per_s: float
    fixed_work_ms: float
    rounds: int


def measure_machine(state_bytes: int, rounds: int = 30, big_bytes: int = _BIG_BYTES) -> Machine:
    """The machine, with copies of a big array and of one as large as a filter's state."""
    big, big_copy = np.ones(big_bytes // 4, np.float32), np.empty(big_bytes // 4, np.float32)
    small, small_copy = np.ones(state_bytes // 4, np.float32), np.empty(state_bytes // 4, np.float32)

    works: dict[str, Callable[[], object]] = {
        "big": lambda: np.copyto(big_copy, big),
        "small": lambda: np.copyto(small_copy, small),  # twice: the first finds the big ones in the cache
        "small again": lambda: np.copyto(small_copy, small),
        "fixed": ArrayWork(100_000),
    }
    times_s = in_turns(works, rounds, warm_up=2)
    return Machine(
        cpu=_cpu(),
        cores=len(os.sched_getaffinity(0)),
        memory_gb=round(os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 1e9, 1),
        python=platform.python_version(),
        numpy=np.__version__,
        opencv=cv2.__version__,
        big_copy_mb=round(big.nbytes / 1e6, 3),
        memory_gb_per_s=_gb_per_s(big.nbytes, times_s["big"]),
        state_copy_mb=round(small.nbytes / 1e6, 3),
        state_sized_gb_per_s=_gb_per_s(small.nbytes, times_s["small again"]),
        fixed_work_ms=median_ms(times_s["fixed"]),
        rounds=rounds,
    )


def once_ms(n_bytes: int, gb_per_s: float) -> float:
    """How long it takes to read and write so many bytes once."""
    return round(2.0 * n_bytes / gb_per_s * 1e-6, 4)


def _gb_per_s(n_bytes: int, times_s: list[float]) -> float:
    return round(2.0 * n_bytes / float(np.median(times_s)) * 1e-9, 3)


def _cpu() -> str:
    """The model's name; the architecture where the kernel does not say, as on most ARM boards."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        lines = []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith(("model name", "Model"))]
    return names[0] if names else platform.machine()
