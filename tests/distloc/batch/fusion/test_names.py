"""Names that stay when fires split, merge and lose contributors."""

import numpy as np

from distloc.batch.fusion.claims import FusedFire
from distloc.batch.fusion.names import Names

SINCE = {"a/1": 1.0, "b/1": 2.0, "c/1": 3.0, "d/1": 4.0}


def fires(*members: str) -> list[FusedFire]:
    return [FusedFire(tuple(one.split()), np.zeros(2), np.eye(2)) for one in members]


def test_a_name_outlives_its_first_claim_and_a_split() -> None:
    names = Names()
    assert names.name(fires("a/1 b/1 c/1"), SINCE) == ["a/1"]
    assert names.name(fires("b/1 c/1"), SINCE) == ["a/1"]  # the first one is gone
    assert names.is_joined("a/1")


def test_of_halves_the_one_with_the_first_claim_keeps_the_name_and_most_claims_win() -> None:
    names = Names()
    names.name(fires("a/1 b/1"), SINCE)
    assert names.name(fires("a/1", "b/1"), SINCE) == ["a/1", "b/1"]
    assert names.is_joined("a/1") and not names.is_joined("b/1")
    names = Names()
    names.name(fires("a/1 b/1 c/1"), SINCE)
    assert names.name(fires("a/1", "b/1 c/1"), SINCE) == ["a/1+", "a/1"]


def test_where_two_become_one_the_older_name_stays_and_a_new_fire_takes_no_living_name() -> None:
    names = Names()
    assert names.name(fires("c/1 d/1"), SINCE) == ["c/1"]
    assert names.name(fires("a/1 b/1", "c/1 d/1"), SINCE) == ["a/1", "c/1"]
    assert names.name(fires("a/1 b/1 c/1 d/1"), SINCE) == ["c/1"]
    assert names.name(fires("c/1 d/1", "a/1 b/1"), SINCE) == ["c/1", "a/1"]


def test_it_keeps_no_more_than_there_is() -> None:
    names = Names()
    for number in range(200):
        names.name(fires(f"a/{number} b/{number}"), {})
    assert len(names.fire_of) == 2
