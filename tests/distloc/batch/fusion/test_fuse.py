"""Which claims are one fire, who is outvoted, and what stays two; whatever the order in which they came."""

import itertools

import numpy as np
import pytest

from distloc.batch.fusion.claims import Claim, FusedFire
from distloc.batch.fusion.fuse import fuse
from distloc.batch.fusion.place import squared
from distloc.filter.uncertainty import CHI2_95
from tests.distloc.batch.fusion.samples import claim


def used(claims: list[Claim], **more: object) -> list[tuple[str, ...]]:
    return [one.used for one in fuse(claims, **more).fires]  # type: ignore[arg-type]


THREE = [claim("a/1", (10.0, 0.0), 0.0), claim("b/7", (0.0, 15.0), 90.0), claim("c/2", (-12.0, -8.0), 200.0)]


def test_three_drones_one_fire_is_surer_than_each_and_no_order_changes_it() -> None:
    (fire,) = fuse(THREE).fires
    assert fire.used == ("a/1", "b/7", "c/2")
    assert np.linalg.det(fire.covariance_m2) < 0.5 * min(np.linalg.det(one.covariance_m2) for one in THREE)
    for order in itertools.permutations(THREE):
        (other,) = fuse(order).fires
        assert np.array_equal(other.position_en_m, fire.position_en_m)
        assert np.array_equal(other.covariance_m2, fire.covariance_m2)


def test_two_fires_of_one_drone_are_two_though_another_sees_one_between() -> None:
    claims = [claim("a/1", (-40.0, 0.0)), claim("a/2", (40.0, 0.0)), claim("b/1", (0.0, 0.0), 90.0, (80.0, 60.0))]
    fires = fuse(claims).fires
    assert len(fires) == 2
    assert all(len({name[0] for name in (*one.used, *one.undecided)} & {"a"}) == 1 for one in fires)
    assert [one.undecided for one in fires].count(("b/1",)) == 1  # of neither for sure: it counts for no place


def test_a_compass_that_shifts_all_does_not_tear_two_fires_apart() -> None:
    """Each of the second drone's lies nearer to the other fire's neighbour than a bare nearest would allow."""
    wide = (150.0, 90.0)
    claims = [claim("a/1", (0.0, 0.0), 0.0, wide), claim("a/2", (300.0, 0.0), 0.0, wide)]
    claims += [claim("b/1", (170.0, 0.0), 90.0, wide), claim("b/2", (470.0, 0.0), 90.0, wide)]
    assert used(claims) == [("a/1", "b/1"), ("a/2", "b/2")]


def test_of_three_the_one_that_is_wrong_is_outvoted_and_stays_a_fire_of_its_own() -> None:
    fires = fuse([*THREE[:2], claim("c/2", (300.0, 40.0), 180.0)]).fires
    assert [one.used for one in fires] == [("a/1", "b/7"), ("c/2",)]
    ((word,), none) = (one.outvoted for one in fires)
    assert word.name == "c/2" and none == ()
    assert word.away_m == pytest.approx(300.0, abs=20.0)
    assert word.sigmas > 4.0


def test_a_drone_whose_compass_is_wrong_for_two_fires_is_outvoted_for_both() -> None:
    """All that it says is 300 m to the east, where the other fire is: no part of that is used."""
    others = [claim(f"{name}/{n}", (300.0 * n, 0.0), turn) for name, turn in (("a", 0.0), ("b", 20.0)) for n in (0, 1)]
    fires = fuse([*others, claim("c/0", (300.0, 0.0), 180.0), claim("c/1", (600.0, 0.0), 180.0)]).fires
    assert [one.used for one in fires] == [("a/0", "b/0"), ("a/1", "b/1"), ("c/0",), ("c/1",)]
    assert [[word.name for word in one.outvoted] for one in fires] == [["c/0"], ["c/1"], [], []]


def test_two_that_contradict_each_other_about_what_both_look_at_are_one_fire_that_holds_both() -> None:
    """A second fire would have been missed by both; who of them is wrong nobody knows."""
    claims = [THREE[0], claim("c/2", (300.0, 40.0), 180.0)]
    (fire,) = fuse(claims).fires
    assert fire.used == ("a/1", "c/2") and fire.outvoted == () and fire.larger > 10.0
    for one in claims:
        assert squared(one.position_en_m - fire.position_en_m, fire.covariance_m2) < CHI2_95


@pytest.mark.parametrize("away_m", [(1500.0, 0.0), (0.0, 5000.0)])
def test_two_that_do_not_look_at_each_others_fire_stay_two(away_m: tuple[float, float]) -> None:
    assert used([THREE[0], claim("c/2", away_m, 180.0)]) == [("a/1",), ("c/2",)]


def test_a_drone_that_tells_two_apart_keeps_a_third_from_making_them_one() -> None:
    """Each of the first two sees one of two fires that are 300 m apart; the third drone sees both."""
    claims = [claim("a/1"), claim("b/1", (300.0, 0.0), 90.0)]
    claims += [claim("c/1", (5.0, 5.0), 180.0), claim("c/2", (295.0, 5.0), 180.0)]
    assert used(claims) == [("a/1", "c/1"), ("b/1", "c/2")]


def test_what_is_new_is_not_taken_for_a_contradiction() -> None:
    """The drone may be about to find the other fire too."""
    claims = [THREE[0], claim("c/2", (300.0, 40.0), 180.0)]
    assert used(claims, fresh={"c/2"}) == [("a/1",), ("c/2",)]


def test_two_drones_that_contradict_each_other_about_two_fires_are_matched_by_what_both_are_off_by() -> None:
    """Each of the second drone's is as far from the one fire as from the other."""
    claims = [claim("a/1"), claim("a/2", (300.0, 0.0))]
    claims += [claim("b/1", (150.0, 150.0), 90.0), claim("b/2", (450.0, 150.0), 90.0)]
    assert used(claims) == [("a/1", "b/1"), ("a/2", "b/2")]


def test_a_second_fire_that_others_do_not_look_at_is_not_outvoted() -> None:
    fires = fuse([*THREE[:2], claim("c/2", (900.0, -900.0), 180.0)]).fires
    assert [one.outvoted for one in fires] == [(), ()]


def test_what_is_new_joins_only_what_is_its_own_beyond_doubt_and_what_was_one_stays_so() -> None:
    wide = [claim("a/1", (0.0, 0.0), 0.0, (200.0, 80.0)), claim("b/1", (120.0, 0.0), 90.0, (200.0, 80.0))]
    assert used(wide) == [("a/1", "b/1")]
    assert used(wide, fresh={"b/1"}) == [("a/1",), ("b/1",)]
    close = [claim("a/1"), claim("b/1", (10.0, 0.0), 90.0)]
    assert used(close, fresh={"b/1"}) == [("a/1", "b/1")]
    apart = [claim("a/1", (0.0, 0.0), 0.0, (20.0, 20.0)), claim("b/1", (118.0, 0.0), 90.0, (20.0, 20.0))]
    assert used(apart, fresh={"b/1"}) == [("a/1",), ("b/1",)]
    assert used(apart, before={"a/1": "a/1", "b/1": "a/1"}) == [("a/1", "b/1")]


def test_one_that_disagrees_makes_the_ellipse_larger() -> None:
    def fire(north_m: float) -> FusedFire:
        (one,) = fuse([claim("a/1"), claim("b/1", (0.0, north_m), 90.0)]).fires
        return one

    assert np.linalg.det(fire(150.0).covariance_m2) > 4.0 * np.linalg.det(fire(5.0).covariance_m2)


def test_none_is_none_and_a_claim_that_cannot_be_is_refused() -> None:
    assert fuse([]).fires == ()
    with pytest.raises(ValueError, match="a/1: a claim must be finite"):
        claim("a/1", (float("nan"), 0.0))
    with pytest.raises(ValueError, match="larger than what is shared"):
        claim("a/1", sizes_m=(0.5, 0.5))
