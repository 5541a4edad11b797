"""How everything here is timed: rounds in which all take their turn, so that they see the same machine."""

import time
from collections.abc import Callable, Mapping, Sequence

import msgspec
import numpy as np


class Figure(msgspec.Struct, frozen=True):
    """The median of `n` times, and that by the median of what it is compared with."""

    median_ms: float
    ratio: float
    n: int


def timed_s(work: Callable[[], object]) -> float:
    """Seconds that one call takes."""
    started_s = time.perf_counter()
    work()
    return time.perf_counter() - started_s


def in_turns(works: Mapping[str, Callable[[], object]], rounds: int, warm_up: int = 1) -> dict[str, list[float]]:
    """Seconds of each work's calls: every round calls each once; the first `warm_up` rounds don't count."""
    times_s: dict[str, list[float]] = {name: [] for name in works}
    for number in range(warm_up + rounds):
        for name, work in works.items():
            taken_s = timed_s(work)
            if number >= warm_up:
                times_s[name].append(taken_s)
    return times_s


def median_ms(times_s: Sequence[float]) -> float:
    """Of at least one time; to 0.1 us."""
    return round(float(np.median(times_s)) * 1e3, 4)


def figure(times_s: Sequence[float], unit_ms: float) -> Figure:
    """A figure compared with a median of `unit_ms`."""
    median = median_ms(times_s)
    return Figure(median, ratio(median, unit_ms), len(times_s))


def ratio(median_ms: float, unit_ms: float) -> float:
    """The one by the other, of the medians as they are printed."""
    return round(median_ms / unit_ms, 4)
