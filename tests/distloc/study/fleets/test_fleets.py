"""`study fleets`: fleets are drawn as is said, and the score sees what is wrong with a fusion."""

from dataclasses import replace

import numpy as np
import pytest

from distloc.batch.fusion.claims import Claim
from distloc.batch.fusion.place import squared
from distloc.study.fleets.fleet import APART_M, drawn, reports
from distloc.study.fleets.flown import flown
from distloc.study.fleets.score import score, scored, truths_of
from distloc.study.fleets.summary import summarised
from tests.distloc.batch.fusion.samples import claim

ORIGIN = np.zeros((1, 2))


def test_the_same_seed_draws_the_same_and_every_other_has_two_fires() -> None:
    assert scored(900) == scored(900)
    for seed in (900, 901):
        fires = drawn(seed).fires_en_m
        assert len(fires) == 1 + seed % 2
    assert np.linalg.norm(fires[1] - fires[0]) == pytest.approx(APART_M)


def test_drones_err_as_they_tell_but_for_those_that_are_worse() -> None:
    """The last reports of 150 fleets: chi squared of two degrees of freedom, 2 in the mean and 5.99 at 95 %."""
    by_worse: dict[bool, list[float]] = {False: [], True: []}
    for seed in range(150):
        fleet = drawn(seed)
        truth, worse = truths_of(fleet), {one.name for one in fleet.crafts if one.worse > 1.0}
        for one in list(reports(fleet))[-1][1]:
            away = squared(one.position_en_m - fleet.fires_en_m[truth[one.name]], one.covariance_m2)
            by_worse[one.vehicle in worse].append(away)
    assert 1.8 < np.mean(by_worse[False]) < 2.2 and 0.93 < np.mean(np.array(by_worse[False]) < 5.99) < 0.97
    assert np.mean(by_worse[True]) > 12.0
    assert 0.08 < len(by_worse[True]) / sum(map(len, by_worse.values())) < 0.17


def steps(*claims: Claim) -> list[tuple[float, list[Claim]]]:
    return [(2.0 * step, list(claims)) for step in range(40)]


def test_one_fire_that_two_agree_on_is_one_inside_and_better() -> None:
    told = steps(claim("a/0", (10.0, 5.0)), claim("b/0", (-4.0, 9.0), 90.0))
    one = score(told, {"a/0": 0, "b/0": 0}, ORIGIN, has_worse=False)
    assert (one.longest_two_s, one.was_merged, one.is_mixed, one.wrong, one.named) == (0.0, False, False, set(), set())
    (fire,) = one.fires
    assert fire.used == 2 and fire.is_inside and fire.own_inside == (True, True)
    assert fire.least_m == pytest.approx(np.hypot(4.0, 9.0)) and fire.area_ratio < 1.0


def test_two_told_as_one_and_one_told_as_two_are_seen() -> None:
    near = steps(claim("a/0"), claim("b/1", (10.0, 0.0), 90.0))
    merged = score(near, {"a/0": 0, "b/1": 1}, np.array([[0.0, 0.0], [10.0, 0.0]]), has_worse=False)
    assert merged.was_merged and merged.is_mixed
    far = steps(claim("a/0"), claim("b/0", (1500.0, 0.0), 90.0))
    apart = score(far, {"a/0": 0, "b/0": 0}, ORIGIN, has_worse=True)
    assert apart.longest_two_s == 78.0 and not apart.was_merged and apart.fires == ()


def test_who_is_far_off_where_two_others_see_the_same_is_wrong_and_named() -> None:
    told = steps(claim("a/0", (1.0, 1.0)), claim("b/0", (5.0, 5.0), 90.0), claim("c/0", (300.0, 0.0), 180.0))
    one = score(told, {"a/0": 0, "b/0": 0, "c/0": 0}, ORIGIN, has_worse=True)
    assert one.wrong == one.named == one.ever == {"c"}
    row = summarised("one", [one, replace(one, named=frozenset({"a"}), longest_two_s=31.0)])
    assert (row.wrong, row.named, row.falsely, row.two, row.drones) == (2, 1, 1, 0.5, 6)
    assert np.isnan(row.merged) and np.isnan(summarised("none", []).coverage)


def test_a_flown_fleet_is_scored_as_a_drawn_one() -> None:
    one = flown(902)
    assert one.true_fires == 1 and 2 <= one.drones <= 4 and len(one.fires) <= 1
