"""Runs independent tasks over processes, in any order, with the results in theirs."""

import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from multiprocessing.connection import wait
from typing import TypeVar

import cv2

T = TypeVar("T")
R = TypeVar("R")


def run_all(function: Callable[[T], R], tasks: Sequence[T], jobs: int, on_done: Callable[[int], None]) -> list[R]:
    """The results of `function`, which must be a module's own, for each task; `on_done` gets how many are done.

    The results don't depend on `jobs`. An exception, Ctrl-C too, ends the processes at once; they end as well where
    this one is killed.
    """
    if jobs < 1:
        raise ValueError(f"jobs must be at least 1, got {jobs}")
    if jobs == 1 or len(tasks) <= 1:
        return [_reported(function(task), number, on_done) for number, task in enumerate(tasks, start=1)]
    context, results = multiprocessing.get_context("spawn"), dict[int, R]()
    with (
        _held_ctrl_c() as is_pressed,
        ProcessPoolExecutor(min(jobs, len(tasks)), mp_context=context, initializer=_start_worker) as pool,
    ):
        try:  # about the starting too: leaving the pool waits for all that was submitted
            futures = {pool.submit(function, task): index for index, task in enumerate(tasks)}
            if is_pressed():  # before there was a process to end
                raise KeyboardInterrupt
            for future in as_completed(futures):
                results[futures[future]] = _reported(future.result(), len(results) + 1, on_done)
        except BaseException as error:
            pool.shutdown(wait=False, cancel_futures=True)
            _terminate_children()
            if is_pressed() and isinstance(error, BrokenProcessPool):
                raise KeyboardInterrupt from None
            raise
    return [results[index] for index in range(len(tasks))]


def _reported(result: R, done: int, on_done: Callable[[int], None]) -> R:
    on_done(done)
    return result


@contextmanager
def _held_ctrl_c() -> Iterator[Callable[[], bool]]:
    """Meanwhile Ctrl-C ends the processes, and so the waiting for them, and raises nothing of itself.

    Raised just as the pool took a lock of its own, KeyboardInterrupt would leave that locked, and the pool's thread
    would wait for it for ever.
    """
    pressed: list[int] = []  # an event takes a lock, which a second Ctrl-C would wait for
    is_main = threading.current_thread() is threading.main_thread()
    if signal.getsignal(signal.SIGINT) is not signal.default_int_handler or not is_main:
        yield lambda: False
        return

    def press(number: int, _frame: object) -> None:
        pressed.append(number)
        _terminate_children()

    signal.signal(signal.SIGINT, press)
    try:
        yield lambda: bool(pressed)
    finally:
        signal.signal(signal.SIGINT, signal.default_int_handler)


def _terminate_children() -> None:
    for process in multiprocessing.active_children():
        process.terminate()


def _start_worker() -> None:
    cv2.setNumThreads(1)  # the processes already fill the cores
    parent = multiprocessing.parent_process()
    if parent is not None:
        threading.Thread(target=_end_with, args=(parent.sentinel,), daemon=True).start()


def _end_with(sentinel: int) -> None:
    wait([sentinel])
    os._exit(1)
