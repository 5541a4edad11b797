"""Runs independent tasks over processes, in any order, with the results in theirs."""

import multiprocessing
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from typing import TypeVar

import cv2

T = TypeVar("T")
R = TypeVar("R")


def run_all(function: Callable[[T], R], tasks: Sequence[T], jobs: int, on_done: Callable[[int], None]) -> list[R]:
    """The results of `function`, which must be a module's own, for each task; `on_done` gets how many are done.

    Each process computes on one thread, so that `jobs` of them fill as many cores. The results don't depend on `jobs`.
    """
    if jobs < 1:
        raise ValueError(f"jobs must be at least 1, got {jobs}")
    if jobs == 1 or len(tasks) <= 1:
        return [_reported(function(task), number, on_done) for number, task in enumerate(tasks, start=1)]
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(min(jobs, len(tasks)), mp_context=context, initializer=_one_thread) as pool:
        futures = {pool.submit(function, task): index for index, task in enumerate(tasks)}
        results: dict[int, R] = {}
        try:
            for future in as_completed(futures):
                results[futures[future]] = _reported(future.result(), len(results) + 1, on_done)
        except BaseException:
            pool.shutdown(cancel_futures=True)
            raise
    return [results[index] for index in range(len(tasks))]


def _reported(result: R, done: int, on_done: Callable[[int], None]) -> R:
    on_done(done)
    return result


def _one_thread() -> None:
    cv2.setNumThreads(1)
