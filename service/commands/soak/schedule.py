"""When which fault comes: drawn by a seed, one after the other, each with time to recover. Free of I/O."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, slots=True)
class Pace:
    """One fault in each `every_s`, none in the first `warm_s`; after each at least `rest_s` without."""

    every_s: float = 40.0
    warm_s: float = 20.0
    rest_s: float = 15.0
    lasting_s: tuple[float, float] = (4.0, 8.0)

    def __post_init__(self) -> None:
        if not 0.0 < self.lasting_s[0] <= self.lasting_s[1] < self.every_s - self.rest_s:
            raise ValueError(f"every_s is {self.every_s}: it must be more than lasting_s {self.lasting_s} and rest_s")


@dataclass(frozen=True, slots=True)
class PlannedFault:
    """Seconds from the service's being ready."""

    kind: str
    start_s: float
    end_s: float


def planned_faults(duration_s: float, kinds: Sequence[str], pace: Pace, rng: np.random.Generator) -> list[PlannedFault]:
    """In order of time, none overlapping; each kind comes once before any comes again; none without kinds."""
    planned: list[PlannedFault] = []
    waiting: list[str] = []
    begin_s = pace.warm_s
    while kinds and begin_s + pace.every_s <= duration_s:
        waiting = waiting or [str(kind) for kind in rng.permutation(list(kinds))]
        lasts_s = float(rng.uniform(*pace.lasting_s))
        start_s = begin_s + float(rng.uniform(0.0, pace.every_s - pace.rest_s - pace.lasting_s[1]))
        planned.append(PlannedFault(waiting.pop(), round(start_s, 2), round(start_s + lasts_s, 2)))
        begin_s += pace.every_s
    return planned
