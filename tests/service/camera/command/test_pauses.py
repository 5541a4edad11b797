"""A raw stream that is cut at the wrong places shows it by its pauses."""

import numpy as np
import pytest

from service.camera.command.pauses import MOST_DOUBT, PauseWatch


def watched(
    real: int, told: int, period_s: float = 0.1, chunk: int = 64, lost: int = 0
) -> tuple[PauseWatch, list[bool]]:
    """400 frames of `real` bytes, written at once each period, cut at `told` bytes; the first lacks `lost`."""
    watch, held, found = PauseWatch(told), 0, list[bool]()
    rng = np.random.default_rng(3)
    for number in range(400):
        left, waited_s = real - (lost if number == 0 else 0), period_s
        while left:
            watch.waited(waited_s, held)
            count = min(chunk, left)
            left, held, waited_s = left - count, held + count, rng.exponential(1e-4)
            while held >= told:
                held -= told
                found.append(watch.is_split())
                if watch.doubt == MOST_DOUBT:
                    return watch, found
    return watch, found


@pytest.mark.parametrize("chunk", [7, 64, 640, 10_000])
def test_the_right_size_is_never_doubted(chunk: int) -> None:
    watch, found = watched(640, 640, chunk=chunk)
    assert not any(found) and watch.doubt == 0


@pytest.mark.parametrize("real", [72, 80, 161, 213, 284, 320, 480, 600, 639, 641, 700, 1000, 2000])
def test_another_size_is_noticed(real: int) -> None:
    watch, found = watched(real, 640)
    assert watch.doubt == MOST_DOUBT and len(found) < 100


def test_a_lost_part_is_noticed() -> None:
    watch, found = watched(640, 640, lost=100)
    assert watch.doubt == MOST_DOUBT and found == [True] * MOST_DOUBT


def test_the_first_frame_of_another_size_is_known_too() -> None:
    watch = PauseWatch(640)
    for held, waited_s in ((0, 2.0), (160, 0.1), (320, 0.1), (480, 0.1)):
        watch.waited(waited_s, held)
    assert watch.is_split()


@pytest.mark.parametrize("stalls", [1, 2, 5])
def test_a_program_that_others_hold_up_is_not_doubted(stalls: int) -> None:
    """As on a computer with ten times the work that it can do: waits in most frames, and before them."""
    rng, watch, found = np.random.default_rng(4), PauseWatch(96 * 65_536), list[bool]()
    for number in range(2000):
        watch.waited(rng.uniform(0.02, 0.1), 0)
        for held in sorted(rng.choice(95, rng.integers(0, stalls + 1), replace=False)):
            watch.waited(rng.uniform(0.0, 0.1), 65_536 * (int(held) + 1))
        is_split = watch.is_split()
        found.append(is_split and number > 0)
        assert watch.doubt < MOST_DOUBT
    assert sum(found) < 60


def test_bytes_that_trickle_in_are_not_judged() -> None:
    rng, watch = np.random.default_rng(2), PauseWatch(40)
    for number in range(20_000):
        watch.waited(rng.uniform(0.004, 0.012), held=number % 40)
        assert number % 40 < 39 or not watch.is_split()


def test_frames_that_come_without_a_pause_are_not_judged() -> None:
    watch, found = watched(640, 480, period_s=1e-4)
    assert not any(found) and watch.doubt == 0


@pytest.mark.parametrize("piece", [4096, 65_536])
def test_the_right_size_without_a_pause_is_not_doubted_where_others_hold_it_up(piece: int) -> None:
    """One wait in each second or third frame, somewhere between two pieces, and none before."""
    rng, told = np.random.default_rng(5), 3_110_400
    watch = PauseWatch(told)
    for _ in range(5000):
        if rng.random() < 0.4:
            watch.waited(rng.uniform(0.005, 0.02), int(rng.integers(1, told // piece)) * piece)
        watch.is_split()
        assert watch.doubt < MOST_DOUBT


def test_a_pipe_that_is_filled_as_soon_as_it_is_empty_says_nothing() -> None:
    told, pipe, position = 3_110_400, 1 << 20, 0
    watch = PauseWatch(told)
    for _ in range(2000):
        position += pipe
        if position >= told:
            position -= told
            assert not watch.is_split()
        watch.waited(0.02, position, was_full=True)
    assert watch.doubt == 0


def test_planes_that_are_written_apart_are_one_frame() -> None:
    watch = PauseWatch(300)
    for _ in range(100):
        watch.waited(0.1, 0)
        watch.waited(0.08, 200)
        watch.is_split()
        assert watch.doubt < MOST_DOUBT
