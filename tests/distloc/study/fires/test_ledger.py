"""Whose a target is, what counts as wrong, and a scene's figures, by hand."""

from collections.abc import Sequence

import numpy as np
import pytest

from distloc.geometry.metrics import wilson_interval
from distloc.study.fires.cases import CASES
from distloc.study.fires.flights import fly, fly_all
from distloc.study.fires.ledger import SceneLedger, SceneTrack
from distloc.study.fires.smoke import Smoke, SmokeLook, Source
from distloc.study.fires.staging import SceneFrame, SceneRun
from distloc.study.fires.summary import pooled, summarised
from distloc.types import CameraPose, Ellipse, TargetEstimate, TargetState
from tests.support.cube_samples import R_NORTH
from tests.support.estimates import estimate

TUNED = 900  # seeds that the filter may be tuned on: the study's own are looked at in the study alone
FEW = 500
CONFIRMED, COASTING, TENTATIVE = TargetState.CONFIRMED, TargetState.COASTING, TargetState.TENTATIVE
CALM = np.zeros(3)
nan, inf = float("nan"), float("inf")


def fire(east_m: float, north_m: float = 1000.0, speed_mps: float = 0.0) -> Smoke:
    source = Source(np.array([east_m, north_m, 0.0]), SmokeLook(50.0, 20.0), CALM, np.array([speed_mps, 0.0, 0.0]))
    return Smoke(source, np.random.default_rng(1))


def told(
    id_: int, east_m: float, north_m: float = 1000.0, state: TargetState = CONFIRMED, observations: int = 9
) -> TargetEstimate:
    """An ellipse of 50 by 20 m, the long side to the north."""
    ellipse = Ellipse(50.0, 20.0, 0.0)
    return estimate(id_, state, np.array([east_m, north_m, 30.0]), np.eye(3), ellipse, observations)


def entered(fires: Sequence[Smoke], *steps: Sequence[TargetEstimate], seen_from: int = 0) -> SceneTrack:
    """A step a second, the camera at the origin."""
    ledger = SceneLedger(fires)
    for k, estimates in enumerate(steps):
        pose = CameraPose(float(k), np.zeros(3), R_NORTH)
        is_in_view = np.full(len(fires), k >= seen_from)
        ledger.enter(SceneFrame(np.zeros((2, 2), np.uint8), pose, pose, is_in_view), estimates)
    return ledger.closed()


def test_a_target_at_a_wrong_range_is_the_fires_and_one_elsewhere_is_nobodys() -> None:
    track = entered([fire(0.0)], [], [told(1, 10.0)], [told(1, 0.0, 2000.0), told(2, 400.0)])
    assert track.false_ids == 1 and track.ids_given == 2
    assert track.reports.step.tolist() == [1, 2] and track.reports.target.tolist() == [1, 1]
    assert track.reports.is_inside.tolist() == [True, False]
    np.testing.assert_allclose(track.reports.error_share, [0.01, 1.0])
    np.testing.assert_allclose(track.reports.half_share, [0.05, 0.05])
    np.testing.assert_allclose(track.reports.nees, [10.0**2, 1000.0**2])  # the covariance is 1 m on each axis
    assert track.held.tolist() == [[0, 1, 1]] and track.has_confirmed.tolist() == [False, True, True]


def test_a_target_is_whose_it_is_most_often_and_stays_so_while_it_slides_or_coasts() -> None:
    fires = [fire(0.0), fire(600.0)]
    slides = [[told(1, 0.0)], [told(1, 0.0)], [told(1, 600.0)]]
    track = entered(fires, *slides, [told(1, 600.0, state=COASTING)], [told(1, 600.0, state=COASTING)])
    assert track.reports.fire.tolist() == [0] * 5 and track.false_ids == 0
    assert track.reports.is_inside.tolist() == [True, True, False, False, False]
    assert track.confirmed_s.tolist() == [0.0, inf] and track.told_s.tolist() == [0.0, 2.0]
    assert track.held.tolist() == [[1] * 5, [0] * 5]
    never_seen = entered(fires, [told(1, 0.0, state=COASTING)])
    assert never_seen.false_ids == 1 and never_seen.reports.step.size == 0


def test_of_two_fires_in_line_a_target_is_that_of_the_nearer_on_the_map() -> None:
    track = entered([fire(0.0), fire(0.0, 1700.0)], [told(1, 0.0, 1100.0), told(2, 0.0, 1600.0)])
    assert track.reports.fire.tolist() == [0, 1]


def test_a_fire_that_moves_is_where_its_source_is_now() -> None:
    stays = [[told(1, 0.0)]] * 10
    track = entered([fire(0.0, speed_mps=5.0)], *stays)
    assert track.reports.is_inside.tolist() == [True] * 5 + [False] * 5  # the short half axis is 20 m
    assert track.reports.error_share[-1] == pytest.approx(45.0 / np.hypot(45.0, 1000.0))


def test_only_confirmed_reports_count_and_the_most_seen_one_is_held() -> None:
    first, second = told(1, 0.0, observations=20), told(2, 5.0, observations=30)
    steps = [[told(1, 0.0, state=TENTATIVE)], [first], [second, first], [second], [], [first]]
    track = entered([fire(0.0)], *steps, seen_from=1)
    assert track.held.tolist() == [[0, 1, 2, 2, 0, 1]] and track.reports.step.tolist() == [1, 2, 2, 3, 5]
    assert (track.seen_s[0], track.told_s[0], track.confirmed_s[0]) == (1.0, 0.0, 1.0)
    found = summarised([track])
    assert (found.switches_a_run, found.ids_a_fire, found.reports, found.ids_a_run) == (2.0, 2.0, 5, 2.0)
    assert (found.told_after_s, found.confirmed_after_s) == (0.0, 0.0)
    assert found.confirmed_steps == pytest.approx(4 / 5)  # since it was first in view


def test_figures_of_a_scene_by_hand() -> None:
    good = entered([fire(0.0)], *([[]] * 3), *([[told(1, 10.0)]] * 6))
    wrong = entered([fire(0.0)], *([[]] * 6), *([[told(1, 0.0, 1100.0)]] * 2), [])
    never = entered([fire(0.0)], *([[]] * 9), seen_from=20)
    found = summarised([good, wrong, never])
    assert (found.runs, found.fires, found.reports) == (3, 1, 8)
    assert found.confirmed_runs == pytest.approx(2 / 3) and found.confirmed_steps == pytest.approx(8 / 18)
    assert found.coverage == pytest.approx(6 / 8) and found.mean_nees == pytest.approx((6 * 10.0**2 + 2 * 100.0**2) / 8)
    assert (found.coverage_low, found.coverage_high) == wilson_interval(1.5, 2)  # of the two flights that told
    np.testing.assert_allclose(found.third_coverages, [nan, 1.0, 3 / 5])
    assert found.held_share == pytest.approx(1 / 3) and found.held_coverage == 1.0
    assert (found.median_error_share, found.median_half_share) == (pytest.approx((0.01 + 0.1) / 2), 0.05)
    assert (found.told_after_s, found.confirmed_after_s) == (4.5, 4.5)  # of the two that were seen
    assert (found.false_a_run, found.switches_a_run, found.ids_a_fire) == (0.0, 0.0, pytest.approx(2 / 3))
    nothing = summarised([never])
    assert nothing.confirmed_runs == 0.0 and np.isnan([nothing.coverage, nothing.median_error_share]).all()
    assert np.isnan(nothing.confirmed_steps) and np.isnan(nothing.confirmed_after_s)


def test_a_whole_group_of_several_scenes_is_pooled() -> None:
    good, wrong = entered([fire(0.0)], [told(1, 0.0)]), entered([fire(0.0)], [told(1, 0.0, 1100.0)])
    groups = {"pair": ["a", "b"], "part": ["a", "c"], "single": ["a"]}
    found = pooled(groups, {"a": [good], "b": [wrong]})
    assert list(found) == ["pair"] and (found["pair"].runs, found["pair"].coverage) == (2, 0.5)
    assert (found["pair"].coverage_low, found["pair"].coverage_high) == wilson_interval(0.5, 1)  # of one seed
    assert (summarised([good, wrong]).coverage_low, 1.0) == (wilson_interval(1, 2)[0], summarised([good]).coverage_high)
    nothing = summarised([entered([fire(0.0)], [])])
    assert (nothing.coverage_low, nothing.coverage_high) == (0.0, 1.0) and np.isnan(nothing.mean_nees)


def test_a_flight_is_its_seeds_for_any_number_of_processes() -> None:
    case = CASES["tall_1000"]
    one, two = (fly_all([case], 2, jobs, TUNED, n_particles=FEW, length_share=0.3)[0] for jobs in (1, 2))
    for a, b in zip(one, two, strict=True):
        np.testing.assert_array_equal(a.held, b.held)
        np.testing.assert_array_equal(a.reports.error_share, b.reports.error_share)
        assert a.stamps_s.tolist() == list(range(30)) and (a.seen_s, a.told_s) == (0.0, 3.0)


def test_a_steady_fire_without_wind_is_found_and_held() -> None:
    track = fly(SceneRun(CASES["steady_calm"], TUNED, FEW))
    found = summarised([track])
    assert found.confirmed_runs == found.held_share == 1.0
    assert found.false_a_run == 0.0 and found.ids_a_fire == 1.0
    assert 0.0 < found.median_error_share < 0.3 and 0.01 < found.median_half_share < 0.5
