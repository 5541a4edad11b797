"""The drawn study: its scenes, the ledger and the figures by hand, a short flight, and the command end to end."""

import csv
import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from typer.testing import CliRunner

from distloc.simulation.landscape.scenes import SCENES
from distloc.simulation.pose_noise import NoPoseNoise
from distloc.study.drawn.cases import CASES, PoseStep, cases_named
from distloc.study.drawn.flights import SEED, DrawnFlight, fly, fly_all
from distloc.study.drawn.ledger import FireLedger, FireTrack
from distloc.study.drawn.plots import drawn_figure
from distloc.study.drawn.staging import DrawnRun, SteppingPoses, staged
from distloc.study.drawn.summary import DrawnSummary, summarised
from distloc.types import CameraPose, Ellipse, TargetEstimate, TargetState
from service.commands.study.cli import study
from service.commands.study.drawn import run_drawn
from tests.support.estimates import estimate as estimate_by_hand

FEW = 500
SHORT = 0.12  # of a flight
TUNED = 900  # seeds that the filter may be tuned on: the study's own are looked at in the study alone
TRUTH = np.array([0.0, 1000.0, 100.0])
nan = float("nan")


def estimate(id_: int, state: TargetState, east_m: float, observations: int = 9) -> TargetEstimate:
    """An ellipse of 50 by 20 m, the long side to the north, whose centre is `east_m` east of the truth."""
    position_enu_m = TRUTH + np.array([east_m, 0.0, 0.0])
    return estimate_by_hand(id_, state, position_enu_m, np.eye(3), Ellipse(50.0, 20.0, 0.0), observations)


def entered(*frames: Sequence[TargetEstimate], is_in_view: bool = True) -> FireTrack:
    ledger = FireLedger(TRUTH)
    for one in frames:
        ledger.enter(one, is_in_view)
    return ledger.closed()


def test_every_believed_report_counts_and_the_most_seen_one_is_measured() -> None:
    held = estimate(1, TargetState.CONFIRMED, 10.0, observations=20)
    wrong = estimate(2, TargetState.COASTING, 30.0)
    track = entered([estimate(1, TargetState.TENTATIVE, 0.0)], [held], [held, wrong], [wrong])
    assert track.believed.tolist() == [0, 1, 2, 1] and track.held.tolist() == [0, 1, 1, 0]
    np.testing.assert_allclose(track.error_m, [nan, 10.0, 10.0, 30.0])
    np.testing.assert_allclose(track.half_length_m, [nan, 50.0, 50.0, 50.0])
    assert (track.lost, track.withdrawn) == (0, 0)  # the first one ended, and another was believed


def test_a_target_is_lost_where_it_ends_in_view_and_withdrawn_where_it_goes_on() -> None:
    believed = [estimate(1, TargetState.CONFIRMED, 0.0)]
    doubted, dismissed = [estimate(1, TargetState.TENTATIVE, 0.0)], [estimate(1, TargetState.DISMISSED, 0.0)]
    found = {
        "dismissed": entered(believed, dismissed, []),
        "gone": entered(believed, [], []),
        "doubted": entered(believed, doubted, doubted, believed),
        "doubted and dismissed": entered(believed, doubted, dismissed, []),
        "never believed": entered(doubted, dismissed),
        "out of view": entered(believed, dismissed, [], is_in_view=False),
        "twice": entered(believed, [], [estimate(2, TargetState.CONFIRMED, 0.0)], []),
    }
    assert {name: (one.lost, one.withdrawn) for name, one in found.items()} == {
        "dismissed": (1, 0),
        "gone": (1, 0),
        "doubted": (0, 1),
        "doubted and dismissed": (1, 1),
        "never believed": (0, 0),
        "out of view": (0, 0),
        "twice": (2, 0),
    }


def track(believed: list[int], held: list[int], error_m: float, lost: int = 0) -> FireTrack:
    ends = np.array([nan] * (len(believed) - 1) + [error_m])
    return FireTrack(np.array(believed, float), np.array(held, float), ends, 4.0 * ends, lost, 0)


def flight(without: FireTrack, scenery: FireTrack, range_m: float = 1000.0) -> DrawnFlight:
    return DrawnFlight(
        stamps_s=np.array([0.0, 5.0, 10.0, 15.0]),
        travelled_m=np.array([0.0, 100.0, 200.0, 300.0]),
        range_m=range_m,
        without=without,
        scenery=scenery,
        is_used=np.array([False, True, True, True]),
        heading_error_rad=np.array([nan, 9.0, 0.3, -0.4]),
        heading_sigma_rad=np.array([nan, 9.0, 0.5, 0.5]),
        attitude_nees=np.array([nan, 99.0, 2.0, 4.0]),
    )


def test_figures_of_a_scene_by_hand() -> None:
    never = track([0, 0, 0, 0], [0, 0, 0, 0], nan)
    flights = [
        flight(track([0, 0, 1, 1], [0, 0, 1, 1], 20.0), track([0, 1, 1, 2], [0, 1, 0, 1], 10.0, lost=1)),
        flight(never, track([0, 0, 1, 1], [0, 0, 1, 1], 60.0), range_m=2000.0),
        flight(never, never),
    ]
    found = summarised(flights)
    assert (found.runs, found.used_share, found.attitude_nees) == (3, 0.75, 1.0)
    assert found.heading_rms_rad == pytest.approx(np.sqrt((0.3**2 + 0.4**2) / 2))  # from 10 s on
    assert found.heading_told_rad == pytest.approx(0.5)
    ours, alone = found.scenery, found.without
    assert (ours.reports, ours.coverage, alone.reports, alone.coverage) == (6, pytest.approx(4 / 6), 2, 1.0)
    assert (ours.confirmed_share, ours.confirmed_at_share) == (pytest.approx(2 / 3), pytest.approx(0.1))
    assert (ours.median_error_share, ours.median_half_share) == (pytest.approx(0.02), pytest.approx(0.08))
    assert (alone.confirmed_share, alone.confirmed_at_share) == (pytest.approx(1 / 3), np.inf)
    assert found.misses == ["coverage over 0.02 less", "coverage under 0.93", "more lost"]
    turned = replace(found, without=ours, scenery=alone)
    assert turned.misses == []
    nobody = summarised([flight(never, never)])
    assert nobody.misses == [] and np.isnan([nobody.scenery.coverage, nobody.scenery.median_error_share]).all()


def test_a_step_of_the_pose_comes_goes_and_is_all_that_changes() -> None:
    step = PoseStep(position_m=60.0, heading_rad=0.2, for_s=30.0)
    poses = SteppingPoses(NoPoseNoise(), step, 10.0, np.random.default_rng(3))

    def pose_at(stamp_s: float) -> CameraPose:
        return CameraPose(stamp_s, np.zeros(3), np.eye(3), heading_rad=1.0)

    before, first, last, after = (poses.reported(pose_at, stamp_s) for stamp_s in (9.9, 10.0, 39.9, 40.0))
    assert before.heading_rad == after.heading_rad == 1.0
    for one in (first, last):
        assert np.hypot(*one.position_enu_m[:2]) == pytest.approx(60.0) and one.position_enu_m[2] == 0.0
        assert one.heading_rad is not None
        turned_rad = one.heading_rad - 1.0  # clockwise from above
        assert abs(turned_rad) == pytest.approx(0.2)
        # what lay ahead at azimuth a is reported at a + turned
        ahead = one.R_cam_from_enu.T @ np.array([0.0, 1.0, 0.0])
        np.testing.assert_allclose(ahead, [np.sin(turned_rad), np.cos(turned_rad), 0.0], atol=1e-12)


def test_the_scenes_are_those_that_the_study_promises() -> None:
    assert list(CASES) == [
        *("hills", "mountains", "sea", "night", "snow", "haze", "few_corners", "traffic", "hover", "blur"),
        *("rolling_shutter", "digital_zoom", "wrong_lens", "gnss_jump", "yaw_reset", "lawnmower", "orbit", "ahead"),
    ]
    assert {case.landscape for case in CASES.values()} <= SCENES.keys() and SEED == 64_000
    assert [case.name for case in cases_named(" sea,hills, sea")] == ["sea", "hills"]
    assert cases_named("") == list(CASES.values())


def test_flights_of_one_seed_share_the_fire_and_a_wrong_lens_shows_it_elsewhere() -> None:
    hills, lens, other = (
        staged(DrawnRun(CASES[name], seed, FEW, SHORT))
        for name, seed in (("hills", TUNED), ("wrong_lens", TUNED), ("hills", TUNED + 1))
    )
    np.testing.assert_array_equal(hills.truth_enu_m, lens.truth_enu_m)
    assert not np.allclose(hills.truth_enu_m, other.truth_enu_m)
    true, wrong = next(hills.frames), next(lens.frames)
    np.testing.assert_array_equal(true.pose.R_cam_from_enu, wrong.pose.R_cam_from_enu)
    np.testing.assert_array_equal(true.pose.position_enu_m, wrong.pose.position_enu_m)
    assert true.mask.any() and (true.mask != wrong.mask).any()


def test_a_flight_is_its_seeds() -> None:
    run = DrawnRun(CASES["hills"], TUNED, FEW, SHORT)
    first, again = fly(run), fly(run)
    np.testing.assert_array_equal(first.heading_error_rad, again.heading_error_rad)
    np.testing.assert_array_equal(first.scenery.error_m, again.scenery.error_m)
    assert first.is_used.any() and not first.is_used[0]
    assert 1000.0 <= first.range_m <= 2000.0 and first.travelled_m[-1] == pytest.approx(SHORT * first.range_m, abs=15.0)
    told = np.isfinite(first.heading_sigma_rad)
    assert told.any() and (np.degrees(first.heading_sigma_rad[told]) < 2.0).all()


@pytest.mark.thorough
def test_the_scenery_helps_over_hills_and_not_in_a_hover() -> None:
    hills, hover = (summarised(ones) for ones in fly_all(cases_named("hills,hover"), 2, 2, TUNED, n_particles=2000))
    assert hills.used_share > 0.8 and np.degrees(hills.heading_rms_rad) < 0.7  # told 2 degrees
    assert hills.scenery.confirmed_share == 1.0 and hills.misses == []
    assert 0.001 < hills.scenery.median_half_share < 0.6 * hills.without.median_half_share
    assert hover.used_share < 0.1 and hover.scenery.reports == 0


def test_a_picture_of_nothing_is_refused() -> None:
    with pytest.raises(ValueError, match="at least one scene"):
        drawn_figure({})


def test_the_command_end_to_end(tmp_path: Path) -> None:
    said: list[str] = []
    cases = cases_named("hills,sea")
    run_drawn(tmp_path / "out", cases, 1, 1, TUNED, said.append, FEW, SHORT)
    names = ["drawn.csv", "drawn.json", "drawn.png", "drawn.txt"]
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == names
    rows = json.loads((tmp_path / "out" / "drawn.json").read_text())
    assert [(row["scene"], row["runs"]) for row in rows] == [("hills", 1), ("sea", 1)]
    assert rows[0]["used_share"] > rows[1]["used_share"]
    assert rows[0]["heading_told_deg"] is None  # it is over before the attitude is judged
    with (tmp_path / "out" / "drawn.csv").open() as file:
        lines = list(csv.DictReader(file))
    assert float(lines[0]["used_share"]) == rows[0]["used_share"]
    text = (tmp_path / "out" / "drawn.txt").read_text()
    assert said[0] + "\n" == text and "hills" in text and "1 runs a scene" in said[1]
    picture = cv2.imread(str(tmp_path / "out" / "drawn.png"))
    assert picture is not None and picture.std() > 5.0


def test_an_unknown_scene_and_a_bad_folder_are_one_line(tmp_path: Path) -> None:
    done = CliRunner().invoke(study, ["drawn", "--scenes", "hills,desert"])
    assert done.exit_code == 2
    told = " ".join(done.output.split())
    assert "--scenes" in told and "there is no scene 'desert': the scenes are hills, mountains," in told
    taken = tmp_path / "taken"
    taken.write_text("kept")
    done = CliRunner().invoke(study, ["drawn", "--out", str(taken)])
    assert done.exit_code == 1 and f"--out {taken}: must be a folder" in str(done.exception)
    assert taken.read_text() == "kept"


def test_a_summary_misses_no_bound_within_two_points() -> None:
    never = track([0, 0, 0, 0], [0, 0, 0, 0], nan)
    one = summarised([flight(never, never)])

    def with_coverages(alone: float, ours: float) -> DrawnSummary:
        return replace(one, without=replace(one.without, coverage=alone), scenery=replace(one.scenery, coverage=ours))

    assert with_coverages(0.97, 0.96).misses == [] and with_coverages(0.5, 0.6).misses == []
    assert with_coverages(0.94, 0.925).misses == ["coverage under 0.93"]
    assert with_coverages(0.99, 0.96).misses == ["coverage over 0.02 less"]
