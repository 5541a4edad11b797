"""No part becomes much slower than it is, on whatever machine: its time by that of fixed work, in turns in one run.

Both are CPU time, slice by slice of a few milliseconds, the best of several rounds: other load disturbs that least.
Never an absolute time. A limit is about twice the ratio that was measured when it was set, idle and under load.
"""

import time
from collections.abc import Callable, Iterable, Iterator
from functools import partial

import numpy as np
import pytest

from distloc.filter.calibrated_filter import CalibratedFilter
from distloc.filter.settings import LocalizerConfig
from distloc.sights.detections import detections_from_mask
from distloc.study.scenes import PAPER_CAMERA
from service.commands.bench.fixed_work import ArrayWork, BytesWork, ImageWork
from service.commands.bench.scene import Seen, frames
from service.commands.bench.service.stages import decode_all, telemetry
from service.commands.bench.smoke_scene import plumes_mask

pytestmark = pytest.mark.thorough

N = 100_000
STEPS = 20  # of a flight, resampling among them; a round flies it anew from the same seed
FILTER_LIMIT = 0.9  # measured: 0.49
DETECTIONS_LIMIT = 0.5  # 0.19 to 0.28
DECODING_LIMIT = 4.5  # 2.1 to 2.35


def best_ratio(slices: Callable[[], Iterable[Callable[[], object]]], fixed: Callable[[], object], rounds: int) -> float:
    """Of the slices' best times in all rounds by those of the fixed work, which is done after each."""
    best_s: dict[tuple[int, bool], float] = {}
    for _ in range(rounds):
        for index, one in enumerate(slices()):
            for is_fixed, work in ((False, one), (True, fixed)):
                started_s = time.process_time()
                work()
                taken_s = time.process_time() - started_s
                best_s[index, is_fixed] = min(taken_s, best_s.get((index, is_fixed), taken_s))
    totals = [sum(taken_s for (_, kind), taken_s in best_s.items() if kind is is_fixed) for is_fixed in (False, True)]
    return totals[0] / totals[1]


@pytest.fixture(scope="module")
def seen() -> list[Seen]:
    return list(frames(STEPS + 1))


def filter_ratio(seen: list[Seen], times: int) -> float:
    """Of a filter that does each step so many times; every round flies the same."""
    errors = LocalizerConfig().pose_errors

    def slices() -> Iterator[Callable[[], object]]:
        flown = [CalibratedFilter.alone(N, np.random.Generator(np.random.SFC64(0))) for _ in range(times)]
        for one in flown:
            one.start(seen[0].sight, errors)
        for frame in seen[1:]:
            yield partial(step, flown, frame)

    def step(flown: list[CalibratedFilter], frame: Seen) -> None:
        for one in flown:
            one.predict(frame.pose.stamp_s, errors)
            one.update(frame.sight)

    return best_ratio(slices, ArrayWork(N), 10)


def test_filter_step(seen: list[Seen]) -> None:
    assert filter_ratio(seen, 1) < FILTER_LIMIT


def test_a_filter_that_does_each_step_thrice_is_caught(seen: list[Seen]) -> None:
    assert filter_ratio(seen, 3) > FILTER_LIMIT


def detections_ratio(times: int) -> float:
    mask = plumes_mask(1920, 1080)
    return best_ratio(lambda: [repeated(partial(detections_from_mask, mask, PAPER_CAMERA), times)], ImageWork(), 60)


def test_detections() -> None:
    assert detections_ratio(1) < DETECTIONS_LIMIT


def test_detections_made_four_times_are_caught() -> None:
    assert detections_ratio(4) > DETECTIONS_LIMIT


def decoding_ratio(times: int) -> float:
    datagrams = telemetry(3.0)[0][:100]
    return best_ratio(lambda: [repeated(partial(decode_all, datagrams), times)], BytesWork(), 100)


def test_decoding() -> None:
    assert decoding_ratio(1) < DECODING_LIMIT


def test_decoding_made_three_times_is_caught() -> None:
    assert decoding_ratio(3) > DECODING_LIMIT


def repeated(work: Callable[[], object], times: int) -> Callable[[], object]:
    return lambda: [work() for _ in range(times)]
