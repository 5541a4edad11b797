"""Whose the places are where there are fewer than things in view."""

import pytest

from distloc.types import TargetEstimate, TargetState
from tests.support.far_things import FarThings, is_fire

CONFIRMED = TargetState.CONFIRMED
_LIT, _WATCHED = 30, 60  # steps: of far things alone, and with the fire


def confirmed_of(flown: list[list[TargetEstimate]]) -> list[TargetEstimate]:
    return [one for step in flown for one in step if one.state is CONFIRMED]


def lit_among(things: FarThings) -> list[list[TargetEstimate]]:
    return [things.step(has_fire=k >= _LIT) for k in range(_LIT + _WATCHED)]


@pytest.mark.parametrize("count", [8, 20, 60])
def test_things_without_a_range_keep_no_place_from_a_fire(count: int) -> None:
    flown = lit_among(FarThings(count, max_targets=8))
    believed = confirmed_of(flown)
    assert believed and all(map(is_fire, believed))
    assert len({one.id for one in believed}) == 1 and any(one.state is CONFIRMED for one in flown[-1])
    given = {one.id for step in flown for one in step}
    assert given <= set(range(1, 8 + 3))  # one goes for the fire, and not all by turns
    assert max(map(len, flown)) <= 8


@pytest.mark.thorough
@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("count", [64, 86, 120])
def test_more_far_things_than_there_are_places_by_default(count: int, seed: int) -> None:
    believed = confirmed_of(lit_among(FarThings(count, max_targets=64, seed=seed)))
    assert believed and all(map(is_fire, believed))


@pytest.mark.parametrize("seed", range(2))
def test_a_fire_in_a_flood_is_confirmed_and_nothing_else(seed: int) -> None:
    things = FarThings(40, max_targets=16, seed=seed)
    believed = confirmed_of([things.step_in_clutter(has_fire=True) for _ in range(50)])
    assert believed and all(map(is_fire, believed))


def test_things_that_are_alike_do_not_take_turns() -> None:
    things = FarThings(12, max_targets=4)
    flown = [things.step(has_fire=False) for _ in range(80)]
    assert {one.id for step in flown for one in step} == {1, 2, 3, 4}
    assert {one.state for step in flown for one in step} == {TargetState.TENTATIVE}
    assert things.localizer.explain().candidates == 8


def test_what_is_confirmed_keeps_its_place() -> None:
    things = FarThings(0, max_targets=1)
    flown = [things.step(has_fire=True) for _ in range(50)]
    (fire,) = flown[-1]
    assert fire.state is CONFIRMED
    things.count = 12
    things._pixels, things._sizes_px = things._anywhere(480.0)
    flown = [things.step(has_fire=k < 20) for k in range(23)]
    assert {(one.id, one.state) for step in flown[:20] for one in step} == {(fire.id, CONFIRMED)}
    assert {(one.id, one.state) for step in flown[20:] for one in step} == {(fire.id, TargetState.COASTING)}


def test_segments_that_get_no_place_are_counted() -> None:
    things = FarThings(60, max_targets=4)
    things.step(has_fire=False)
    first = things.localizer.explain()
    assert (first.candidates, first.candidate_places, first.left_out, first.left_out_ever) == (24, 24, 36, 36)
    things.step(has_fire=False)
    second = things.localizer.explain()
    assert (second.candidates, second.left_out, second.left_out_ever) == (24, 36, 72)
