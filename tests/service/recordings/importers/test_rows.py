"""Samples that are cleaned: what is wild costs itself, and is counted."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from service.recordings.importers.flight import Remarks
from service.recordings.importers.rows import attitudes_of, home_of, most_rising, positions_of, sampled

UNIT = np.array([1.0, 0.0, 0.0, 0.0])


@given(st.lists(st.integers(0, 30), min_size=1, max_size=40))
def test_the_longest_rising_part_is_kept(times: list[int]) -> None:
    times_s = np.array(times, dtype=np.float64)
    kept = most_rising(times_s)
    assert (np.diff(kept) > 0).all() and (np.diff(times_s[kept]) > 0).all()
    lengths = [1] * len(times)  # the slow way
    for i in range(len(times)):
        lengths[i] = 1 + max((lengths[k] for k in range(i) if times[k] < times[i]), default=0)
    assert len(kept) == max(lengths)


@pytest.mark.parametrize(("wild_s", "reason"), [(1e9, "a time days from the others'"), (1000.0, "time runs backwards")])
def test_one_wild_time_costs_one_row(wild_s: float, reason: str) -> None:
    times_s = np.arange(50.0)
    times_s[10] = wild_s
    remarks = Remarks()
    found = attitudes_of(times_s, np.repeat(UNIT[None], 50, axis=0), remarks)
    assert found is not None and len(found.time_s) == 49
    assert remarks.dropped == {f"attitude: {reason}": 1}


def test_quaternions_are_made_unit_or_left_out() -> None:
    q = np.stack([1.2 * UNIT, 0.0 * UNIT, np.full(4, np.nan), 50.0 * UNIT])
    remarks = Remarks()
    found = attitudes_of(np.arange(4.0), q, remarks)
    assert found is not None and found.q_ned_from_body.tolist() == [UNIT.tolist()]
    assert remarks.dropped == {"attitude: not a number": 1, "attitude: no rotation": 2}


def test_places_that_are_none_are_counted_by_reason() -> None:
    lat = np.array([47.0, np.nan, 0.0, 95.0, 47.0, 47.1])
    remarks = Remarks()
    found = positions_of(
        np.array([0.0, 1.0, 2.0, 3.0, 4.0, np.nan]),
        lat,
        np.array([8.0, 8.0, 0.0, 8.0, 8.0, 8.0]),
        remarks,
        alt_msl_m=np.array([1.0, 1.0, 1.0, 1.0, 1e7, 1.0]),
    )
    assert found is not None and found.time_s.tolist() == [0.0]
    assert remarks.dropped == {
        "position: no time": 1,
        "position: not a number": 1,
        "position: no place on earth": 1,
        "position: 0, 0, as before a fix": 1,
        "position: no height": 1,
    }


def test_nothing_usable_is_none() -> None:
    assert attitudes_of([], np.zeros((0, 4)), Remarks()) is None
    assert positions_of([np.nan], [1.0], [1.0], Remarks(), alt_msl_m=np.zeros(1)) is None


def test_values_are_sampled_between_and_not_far_from_rows() -> None:
    values = sampled(np.array([0.0, 2.0, np.nan]), np.array([[0.0], [4.0], [9.0]]), np.array([0.5, 1.0, 2.9, 3.1]))
    assert values[:3, 0] == pytest.approx([1.0, 2.0, 4.0]) and np.isnan(values[3, 0])


def test_times_that_are_no_numbers_are_no_part_of_the_rise() -> None:
    times_s = np.array([np.nan, 1.0, np.inf, 2.0, -np.inf, 0.5, 3.0])
    assert most_rising(times_s).tolist() == [1, 3, 6]
    assert most_rising(np.full(3, np.nan)).tolist() == []
    assert np.isnan(sampled(np.full(2, np.nan), np.ones((2, 1)), np.zeros(4))).all()


def test_a_home_is_a_place_on_earth() -> None:
    assert home_of(47.0, 8.0, 430.0) == (47.0, 8.0, 430.0)
    assert home_of(470.0, 8.0, 430.0) is home_of(47.0, 8.0, np.nan) is home_of(47.0, 8.0, 1e6) is None
