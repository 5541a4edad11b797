"""How a whole `Localizer.step` grows with the targets in view: the mask's segments, their tracks, a filter each."""

from collections.abc import Callable
from functools import partial

import msgspec
import numpy as np
from numpy.typing import NDArray

from distloc.filter.settings import ENOUGH_PARTICLES, LocalizerConfig
from distloc.localizer import Localizer
from distloc.simulation.targets import Box
from distloc.study.scenes import PAPER_CAMERA, paper_scene
from distloc.types import CameraPose
from service.commands.bench.timing import Figure, figure, median_ms, timed_s

COUNTS = (1, 4, 16, 64)
_IN_A_ROW = 16
_APART_M = 130.0  # of their middles, in rows across the view 2 km ahead: no two ever touch
_SIDE_M = 60.0


class TargetsCost(msgspec.Struct, frozen=True):
    """Steps with this many targets followed; the ratio is to the first count's."""

    targets: int
    step: Figure


def measure_targets(
    n_particles: int = ENOUGH_PARTICLES,
    counts: tuple[int, ...] = COUNTS,
    number: int | None = None,
    on_step: Callable[[], None] = lambda: None,
) -> tuple[TargetsCost, ...]:
    """All counts fly the paper's flight in turns, each with a localizer of its own."""
    config = LocalizerConfig(n_particles=n_particles, max_targets=max(counts))
    localizers = {
        count: Localizer(PAPER_CAMERA, config, rng=np.random.Generator(np.random.SFC64(0))) for count in counts
    }
    times_s: dict[int, list[float]] = {count: [] for count in counts}
    flight = paper_scene().flight
    for stamp_s in flight.stamps_s[:number]:
        pose = flight.pose_at(float(stamp_s))
        for count, localizer in localizers.items():
            mask = _mask(pose, count)
            taken_s = timed_s(partial(localizer.step, pose, mask))
            if len(localizer.step(pose, mask)) == count:  # all are told of: not due again, so it steps nothing
                times_s[count].append(taken_s)
        on_step()
    unit_ms = median_ms(times_s[counts[0]])
    return tuple(TargetsCost(count, figure(times_s[count], unit_ms)) for count in counts)


def _mask(pose: CameraPose, count: int) -> NDArray[np.uint8]:
    mask: NDArray[np.uint8] = np.zeros((PAPER_CAMERA.height, PAPER_CAMERA.width), dtype=np.uint8)
    for index in range(count):
        row, column = divmod(index, _IN_A_ROW)
        east_m = 500.0 + (column - (min(count, _IN_A_ROW) - 1) / 2.0) * _APART_M
        up_m = 200.0 + (row - (-(-count // _IN_A_ROW) - 1) / 2.0) * _APART_M
        Box(np.array([east_m, 2000.0, up_m]), (_SIDE_M, _SIDE_M, _SIDE_M)).draw(mask, PAPER_CAMERA, pose)
    return mask
