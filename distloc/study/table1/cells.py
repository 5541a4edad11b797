"""The paper's Table 1: five rows of noise by every method, beside the paper's own figures and the bound."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from distloc.study.methods import MethodSpec, all_methods
from distloc.study.runner import run_all
from distloc.study.scenes import NOISES, Noise, paper_scene
from distloc.study.table1.curves import Curve, Summary, Task, bound_m, fly, stacked, summarised, translation_m
from distloc.types import BoolArray, FloatArray

COUNTED_M = (200.0, 1000.0)  # of translation; the paper leaves out what depends on the start

# minimum, mean over 200-1000 m, ratio: the paper's Table 1
PAPER: dict[tuple[str, str], tuple[float, float, float | None]] = {
    ("none", "MVT"): (1.06, 3.95, None),
    ("pose", "MVT"): (1.08, 3.79, None),
    ("fp", "MVT"): (1.08, 147.84, None),
    ("fn", "MVT"): (1.32, 277.88, None),
    ("pfn", "MVT"): (1.54, 257.67, None),
    ("none", "RMVT"): (1.06, 3.92, None),
    ("pose", "RMVT"): (1.25, 3.88, None),
    ("fp", "RMVT"): (1.21, 3.66, None),
    ("fn", "RMVT"): (1.26, 3.21, None),
    ("pfn", "RMVT"): (1.20, 3.94, None),
    ("none", "PF"): (9.44, 44.83, 0.15),
    ("pose", "PF"): (9.57, 45.67, 0.15),
    ("fp", "PF"): (10.99, 46.97, 0.15),
    ("fn", "PF"): (13.04, 46.86, 0.15),
    ("pfn", "PF"): (17.87, 63.97, 0.15),
}


@dataclass(frozen=True, slots=True)
class Cell:
    """One method under one row's noise: R flights (R, T), their figures and the paper's."""

    noise: str
    method: str
    curve: Curve
    summary: Summary
    bound_mean_m: float

    @property
    def paper(self) -> tuple[float | None, float | None, float | None]:
        """Minimum, mean and ratio; None where it has no such cell. Both kinds of RMVT stand beside its one."""
        return PAPER.get((self.noise, self.method.removesuffix("-literal")), (None, None, None))


@dataclass(frozen=True, slots=True)
class Table1:
    """All cells, and what they share: translation (T,) and each row's bound (T,)."""

    cells: tuple[Cell, ...]
    translation_m: FloatArray
    bounds_m: dict[str, FloatArray]
    runs: int


def table1(
    runs: int,
    jobs: int,
    seed: int,
    on_done: Callable[[int], None] = lambda done: None,
    methods_for: Callable[[Noise], tuple[MethodSpec, ...]] = all_methods,
) -> Table1:
    """Fly every row `runs` times by the methods for its noise; `on_done` gets how many of the 5 x runs are done."""
    scene = paper_scene()
    # the rows of one run share their random numbers: a row differs from the one before by its own noise alone
    tasks = [Task(scene, noise, methods_for(noise), (seed, run)) for noise in NOISES.values() for run in range(runs)]
    flights = run_all(fly, tasks, jobs, on_done)
    translation = translation_m(scene)
    counted = is_counted(translation)
    bounds = {name: bound_m(scene, noise) for name, noise in NOISES.items()}
    cells = []
    for row, (name, noise) in enumerate(NOISES.items()):
        of_row = flights[row * runs : (row + 1) * runs]
        for index, spec in enumerate(methods_for(noise)):
            curve = stacked([curves[index] for curves in of_row])
            mean_bound_m = float(bounds[name][counted].mean())
            cells.append(Cell(name, spec.name, curve, summarised(curve, counted), mean_bound_m))
    return Table1(tuple(cells), translation, bounds, runs)


def tasks_of(runs: int) -> int:
    """How many flights `table1` makes."""
    return len(NOISES) * runs


def is_counted(translation: FloatArray) -> BoolArray:
    """Which frames (T,) the means are taken over."""
    return np.asarray((translation >= COUNTED_M[0] - 1e-6) & (translation <= COUNTED_M[1] + 1e-6))
