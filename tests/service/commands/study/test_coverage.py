"""The coverage study: what a run keeps, its figures by hand, and the command end to end on a few small runs."""

import csv
import json
import math
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from matplotlib.patches import Ellipse as EllipsePatch
from typer.testing import CliRunner

from distloc.geometry.metrics import wilson_interval
from distloc.localizer import LocalizerConfig
from distloc.simulation.corners import SimulatedCorners
from distloc.study.coverage.cases import (
    ASIDE_DEG,
    ERROR_CLASSES,
    POOLED,
    SCENERY,
    CoverageCase,
    coverage_cases,
    main_cases,
)
from distloc.study.coverage.classes import Classes, classes_named
from distloc.study.coverage.flights import SEED, FlightResult, explained_flight, fly, fly_all
from distloc.study.coverage.ledger import Ledger, Track, of_targets
from distloc.study.coverage.plots import coverage_figure, ellipses_figure
from distloc.study.coverage.staging import Run, generators, scene_of, staged
from distloc.study.coverage.summary import curves, pooled, summarised
from distloc.study.fires.cases import GROUPS, scenes_named
from distloc.types import Ellipse, TargetEstimate, TargetState
from service.commands.study.cli import study
from service.commands.study.coverage import run_coverage
from tests.support.estimates import estimate
from tests.support.places import HANG_S

FEW = 5000
TUNED = 900  # seeds that the filter may be tuned on: the study's own are looked at in the study alone
CONFIRMED, TENTATIVE, DISMISSED = TargetState.CONFIRMED, TargetState.TENTATIVE, TargetState.DISMISSED


def told(
    id_: int, east_m: float, north_m: float, state: TargetState = CONFIRMED, observations: int = 10
) -> TargetEstimate:
    """With 10 m of standard deviation east and 20 m north."""
    position_enu_m, covariance_enu_m2 = np.array([east_m, north_m, 0.0]), np.diag([100.0, 400.0, 100.0])
    return estimate(id_, state, position_enu_m, covariance_enu_m2, Ellipse(49.0, 24.5, 0.0), observations)


def track(inside: float, error_m: float, **changed: float) -> Track:
    """Of one target and two steps, the first without an estimate."""
    values = [np.array([[np.nan, value]]) for value in (error_m, 2.0 if np.isfinite(inside) else np.nan, inside)]
    kept = {"believed": 1, "false_believed": 0, "switches": 0, "gospa_m": 10.0} | changed
    kept |= {"half_length_m": np.full((1, 2), np.nan), "is_believed": np.zeros((1, 2), dtype=np.bool_)}
    return Track(*values, **kept)  # type: ignore[arg-type]


def result(calibrated: Track, blind: Track | None = None) -> FlightResult:
    bounds = np.array([[np.inf, 15.0]])
    return FlightResult(np.array([0.0, 500.0]), np.array([1000.0]), bounds, calibrated, blind or calibrated)


@pytest.fixture(scope="module")
def flights() -> list[FlightResult]:
    return fly_all([CoverageCase("perpendicular")], 8, 2, TUNED, n_particles=FEW)[0]


def test_a_ledger_by_hand() -> None:
    truths = np.array([[0.0, 300.0], [1000.0, 1000.0], [0.0, 0.0]])
    ledger = Ledger(truths, 4)
    ledger.enter([])
    ledger.enter([told(1, 300.0, 1020.0, TENTATIVE), told(9, 5000.0, 0.0, DISMISSED)])
    ledger.enter([told(1, 310.0, 1000.0), told(2, 0.0, 1060.0), told(3, 5000.0, 0.0)])
    ledger.enter([told(4, 310.0, 1000.0), told(2, 10.0, 1000.0)])
    kept = ledger.closed()
    nan = np.nan
    np.testing.assert_allclose(kept.error_m, [[nan, nan, 60.0, 10.0], [nan, 20.0, 10.0, 10.0]])
    np.testing.assert_allclose(kept.nees, [[nan, nan, 9.0, 1.0], [nan, 1.0, 1.0, 1.0]])
    np.testing.assert_allclose(kept.is_inside, [[nan, nan, 0.0, 1.0], [nan, 1.0, 1.0, 1.0]])
    np.testing.assert_allclose(kept.half_length_m, [[nan, nan, 49.0, 49.0], [nan, 49.0, 49.0, 49.0]])
    assert kept.is_believed.tolist() == [[False, False, True, True], [False, False, True, True]]
    assert (kept.believed, kept.false_believed, kept.switches) == (2, 1, 1)  # 3 is nobody's, 4 takes over from 1
    assert kept.gospa_m == pytest.approx(np.sqrt(200.0))


def test_whose_an_estimate_is() -> None:
    one = np.array([[0.0], [1000.0], [0.0]])
    assert of_targets([], one) == [None]
    clutter, seen = told(1, 0.0, 1000.0, observations=4), told(2, 90.0, 1000.0, observations=40)
    assert of_targets([clutter, seen], one) == [seen]  # the one seen most, not the one that happens to be nearest
    two = np.array([[0.0, 300.0], [1000.0, 1000.0], [0.0, 0.0]])
    assert of_targets([told(1, 290.0, 1000.0)], two)[0] is None


def test_figures_of_a_case_by_hand() -> None:
    runs = [result(track(1.0, 10.0)), result(track(1.0, 30.0)), result(track(0.0, 20.0, switches=1))]
    lost = track(np.nan, np.nan, believed=0, false_believed=2, gospa_m=110.0)
    found = summarised([*runs, result(lost, track(1.0, 50.0))])
    ours = found.calibrated
    assert (ours.coverage.share, ours.coverage.trials, ours.lost) == (0.5, 4, 1)
    assert (ours.coverage.low, ours.coverage.high) == wilson_interval(2, 4)
    assert ours.mean_nees == 2.0 and ours.median_error_share == pytest.approx(0.02)
    assert ours.rms_error_share == pytest.approx(np.sqrt((0.01**2 + 0.03**2 + 0.02**2) / 3))
    assert (ours.believed_share, ours.false_believed_a_run, ours.switches, ours.clean_share) == (0.75, 0.5, 1, 0.5)
    assert ours.mean_gospa_m == pytest.approx(35.0)
    assert (found.runs, found.targets) == (4, 1) and found.bound_share == pytest.approx(0.015)
    assert (found.blind.coverage.share, found.blind.lost) == (0.75, 0)
    assert math.isnan(ours.reports_coverage)  # none was confirmed
    nobody = summarised([result(lost)]).calibrated
    assert nobody.coverage.share == 0.0 and math.isnan(nobody.median_error_share)
    drawn = curves([*runs, result(lost)])
    np.testing.assert_allclose(drawn.calibrated.coverage, [np.nan, 2.0 / 3.0])  # of those that have an estimate
    assert drawn.travelled_share.tolist() == [0.0, 0.5]


def test_of_confirmed_reports_those_before_the_end_count_too() -> None:
    one = replace(track(1.0, 10.0), is_inside=np.array([[0.0, 1.0, 1.0]]), is_believed=np.array([[True, True, False]]))
    assert summarised([result(one)]).calibrated.reports_coverage == 0.5


def test_pooled_takes_the_four_geometries_and_nothing_else() -> None:
    good, bad = [result(track(1.0, 1.0))], [result(track(0.0, 1.0))]
    cases = [CoverageCase(geometry) for geometry in POOLED]
    others = [CoverageCase("hover"), CoverageCase("orbit", clutter=True), CoverageCase("orbit", "survey")]
    found = pooled([*cases, *others], [good] * 4 + [bad] * 3, clutter=False)
    assert found is not None and (found.runs, found.calibrated.coverage.share) == (4, 1.0)
    assert pooled([*cases, *others], [good] * 4 + [bad] * 3, clutter=True) is None


def test_the_cases_are_those_that_the_study_promises() -> None:
    cases = coverage_cases()
    assert len(set(cases)) == len(cases)
    in_the_middle = [one for one in cases if not one.aside_deg]
    assert {(one.geometry, one.error_class) for one in in_the_middle if not one.clutter and one.targets == 1} == {
        (geometry, name)
        for geometry in ("perpendicular", "oblique", "head-on", "orbit", "hover", "lawnmower")
        for name in ERROR_CLASSES
    }
    assert {one.range_m for one in cases} >= {(700.0, 4000.0), (500.0, 500.0), (10_000.0, 10_000.0)}
    assert {one.targets for one in cases if one.clutter} == {1, 2, 3, 4, 5}
    assert {(one.geometry, one.error_class) for one in cases if one.aside_deg} == {
        ("head-on", name) for name in ("wandering", *SCENERY)
    }
    assert SEED == 60_000
    with pytest.raises(ValueError, match="'gone'"):
        CoverageCase("orbit", "gone")
    with pytest.raises(ValueError, match="targets must be >= 1"):
        CoverageCase("orbit", targets=0)
    with pytest.raises(ValueError, match="within 35 of 0, got nan"):
        CoverageCase("head-on", aside_deg=float("nan"))


def test_fires_off_the_middle_are_seen_there() -> None:
    case = CoverageCase("head-on", "scenery", aside_deg=ASIDE_DEG)
    scene = scene_of(Run(case, 1))
    pose = scene.flight.pose_at(0.0)
    x, _, z = pose.R_cam_from_enu @ (scene.truths_enu_m[:, 0] - pose.position_enu_m)
    assert np.degrees(np.arctan2(x, z)) == pytest.approx(15.0, abs=0.1)
    same = scene_of(Run(replace(case, aside_deg=0.0), 1))
    assert np.hypot(*scene.truths_enu_m[:2, 0]) == pytest.approx(np.hypot(*same.truths_enu_m[:2, 0]))


def test_the_filter_is_told_the_errors_that_are_flown() -> None:
    errors = CoverageCase("orbit").pose_errors
    degrees = np.degrees([errors.heading_bias_rad, errors.tilt_bias_rad, errors.attitude_white_rad])
    assert degrees == pytest.approx([2.0, 0.5, 0.1])
    assert (errors.position_m, errors.bias_time_constant_s) == (0.3, 1e5)
    assert CoverageCase("orbit", "drifting").pose_errors == replace(errors, bias_time_constant_s=600.0)


def test_the_scenerys_classes_tell_the_filter_nothing_but_its_defaults() -> None:
    for name, degrees in (("scenery", 2.0), ("scenery_worse", 5.0)):
        assert CoverageCase("orbit", name).pose_errors == LocalizerConfig().pose_errors
        flown = ERROR_CLASSES[name]
        found = np.degrees([flown.heading_bias_rad, flown.tilt_bias_rad, flown.attitude_white_rad])
        assert found == pytest.approx([degrees, 0.5, 0.1])
        assert (flown.position_white_m, flown.position_drift_m, flown.tau_s) == (0.1, 1.5, 120.0)
    assert all(one.position_drift_m == 0.0 for name, one in ERROR_CLASSES.items() if name not in SCENERY)


def test_the_other_classes_draw_what_they_drew_before_there_was_a_scenery() -> None:
    before = [np.random.Generator(np.random.SFC64(one)) for one in np.random.SeedSequence([77, TUNED]).spawn(4)]
    for one, other in zip(before, generators(TUNED), strict=False):  # the fifth is the corners'
        assert np.array_equal(one.random(5), other.random(5))
    for name in ERROR_CLASSES:
        frames = staged(Run(CoverageCase("perpendicular", name), TUNED)).frames
        corners = next(frames)[1]
        assert (corners is not None and corners.names.size > 20) == (name in SCENERY)


def test_corners_reach_the_calibrated_filter_and_not_the_blind_one(monkeypatch: pytest.MonkeyPatch) -> None:
    def without(*_: object) -> None:
        return None

    case = CoverageCase("perpendicular", "scenery", range_m=(1000.0, 1000.0))
    seen = fly(Run(case, TUNED, 2000))
    monkeypatch.setattr(SimulatedCorners, "at", without)
    unseen = fly(Run(case, TUNED, 2000))
    np.testing.assert_array_equal(seen.blind.error_m, unseen.blind.error_m)
    assert 1.0 < seen.calibrated.half_length_m[0, -1] < 0.85 * unseen.calibrated.half_length_m[0, -1]
    assert seen.calibrated.is_believed[0, -1] and not seen.calibrated.is_believed[0, :3].any()


@pytest.mark.thorough
def test_calibrated_holds_the_truth_where_bias_blind_does_not(flights: list[FlightResult]) -> None:
    found = summarised(flights)
    assert found.calibrated.lost == 0 and found.calibrated.believed_share == 1.0
    assert found.calibrated.coverage.share >= 6 / 8  # 0.95 gives less in one of 170
    assert found.blind.coverage.share <= 5 / 8
    assert 0.2 < found.calibrated.mean_nees < 5.0 < found.blind.mean_nees
    assert 0.2 * found.bound_share < found.calibrated.rms_error_share < 3.0 * found.bound_share
    for one in flights:
        assert 700.0 <= one.range_m[0] <= 4000.0 and one.travelled_m.size == 61
        assert one.travelled_m[-1] == pytest.approx(one.range_m[0])  # as long as it is far
        assert np.isnan(one.calibrated.error_m[0, :3]).all()  # four sightings until it is told of
    assert len({one.travelled_m[-1] for one in flights}) == 8


@pytest.mark.thorough
def test_several_fires_and_any_number_of_processes() -> None:
    case = CoverageCase("perpendicular", clutter=True, targets=3, range_m=(2000.0, 2000.0))
    one, other = (fly_all([case], 2, jobs, TUNED, n_particles=FEW)[0] for jobs in (1, 2))
    for a, b in zip(one, other, strict=True):
        np.testing.assert_array_equal(a.calibrated.error_m, b.calibrated.error_m)
        assert a.calibrated.error_m.shape == (3, 61) and a.calibrated.believed == 3
        np.testing.assert_allclose(a.range_m, 2000.0)
    assert not np.array_equal(one[0].calibrated.error_m, one[1].calibrated.error_m)


def test_hover_goes_nowhere() -> None:
    one = fly(Run(CoverageCase("hover"), TUNED, FEW))
    assert one.travelled_m.max() == pytest.approx(0.0)
    assert one.calibrated.error_m[0, -1] > 0.0


def test_pictures(flights: list[FlightResult]) -> None:
    figure = coverage_figure({"perpendicular": curves(flights)})
    labels = [line.get_label() for line in figure.axes[0].lines]
    assert labels == ["0.95", "calibrated", "bias-blind"]
    with pytest.raises(ValueError, match="at least one geometry"):
        coverage_figure({})
    flight = explained_flight(TUNED, FEW)
    assert flight.calibrated is not None and flight.path_en_m.shape == (2, 61)
    panels = ellipses_figure(flight).axes
    assert all(axes.get_aspect() == 1.0 for axes in panels)
    patch = next(one for one in panels[1].patches if isinstance(one, EllipsePatch))
    ellipse = flight.calibrated.ellipse95
    assert (patch.width, patch.height) == (2.0 * ellipse.semi_major_m, 2.0 * ellipse.semi_minor_m)
    along = np.array([np.sin(ellipse.azimuth_rad), np.cos(ellipse.azimuth_rad)])
    drawn = np.array([np.cos(np.radians(patch.angle)), np.sin(np.radians(patch.angle))])
    assert abs(along @ drawn) == pytest.approx(1.0)
    east_m, north_m = panels[1].get_xlim(), panels[1].get_ylim()
    assert east_m[0] < flight.truth_en_m[0] < east_m[1] and north_m[0] < flight.truth_en_m[1] < north_m[1]


def test_pooled_a_seed_counts_once_to_the_interval() -> None:
    good, bad = [result(track(1.0, 1.0))] * 9, [result(track(0.0, 1.0))]
    cases = main_cases()
    found = pooled(cases, [good + bad] * len(cases), clutter=None)
    assert found is not None and (found.runs, found.calibrated.coverage.share) == (80, 0.9)
    assert (found.calibrated.coverage.low, found.calibrated.coverage.high) == wilson_interval(9, 10)
    part = pooled(cases, [good + bad] * len(cases), clutter=True)
    assert part is not None and (part.runs, part.calibrated.coverage.low) == (40, wilson_interval(9, 10)[0])
    assert pooled(cases[:-1], [good] * (len(cases) - 1), clutter=None) is None


def test_classes_by_name() -> None:
    assert classes_named("main") == Classes(main_cases(), []) and len(main_cases()) == 8
    some = classes_named("leaning, puffs_calm, main, leaning_away")
    assert [one.name for one in some.scenes] == ["leaning_toward", "leaning_across", "leaning_away", "puffs_calm"]
    assert some.boxes == main_cases() and set(some.boxes) < set(classes_named("boxes").boxes)
    every = classes_named("")
    assert every.boxes == coverage_cases()
    assert {one.group for one in every.scenes} == set(GROUPS) - {"hour"}
    assert classes_named("main,boxes").boxes[:8] == main_cases()
    assert len(classes_named("main,boxes").boxes) == len(coverage_cases())


def test_an_unknown_class_is_one_line() -> None:
    done = CliRunner().invoke(study, ["coverage", "--classes", "main,bonfire"])
    assert done.exit_code == 2
    told = " ".join(done.output.split())
    assert "--classes" in told and "there is no class 'bonfire': there are boxes, main, the groups of scenes" in told


def test_scenes_are_classes_of_the_command(tmp_path: Path) -> None:
    said: list[str] = []
    out = tmp_path / "out"
    run_coverage(out, classes_named("cut"), 1, 1, TUNED, said.append, 500, 0.3)
    assert sorted(path.name for path in out.iterdir()) == ["scenes.csv", "scenes.json", "scenes.png"]
    rows = json.loads((out / "scenes.json").read_text())
    assert [row["scene"] for row in rows] == [*(one.name for one in scenes_named("cut")), "*cut"]
    told = [row for row in rows if row["reports"]]
    assert told and all(row["coverage_low"] <= row["coverage"] <= row["coverage_high"] for row in told)
    assert all(row["mean_nees"] > 0.0 for row in told)
    table = said[0].split("\n\n")[0].splitlines()
    assert len(table) == 1 + len(rows) and len({len(line) for line in table}) == 1 and "NEES" in table[0]
    assert "1 runs a case" in said[1] and "coverage.json" not in said[1]


def test_the_command_end_to_end(tmp_path: Path) -> None:
    cases = [CoverageCase(geometry) for geometry in POOLED]
    cases.append(CoverageCase("perpendicular", clutter=True, targets=2, range_m=(2000.0, 2000.0)))
    said: list[str] = []
    run_coverage(tmp_path / "out", Classes(cases, []), 2, 2, TUNED, said.append, FEW)
    names = ["coverage.csv", "coverage.json", "coverage.png", "curves.csv", "ellipses.png", "error.png"]
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == names
    rows = json.loads((tmp_path / "out" / "coverage.json").read_text())
    assert [row["geometry"] for row in rows] == [*POOLED, "perpendicular", "pooled"]
    assert [row["runs"] for row in rows] == [2] * 5 + [8]
    inside = sum(row["coverage"] * row["runs"] for row in rows[:4])
    assert rows[-1]["coverage"] == pytest.approx(inside / 8, abs=1e-3)
    assert (rows[4]["targets"], rows[4]["clutter"]) == (2, True)
    with (tmp_path / "out" / "curves.csv").open() as file:
        lines = list(csv.DictReader(file))
    assert len(lines) == 5 * 61
    assert float(lines[60]["travelled_share"]) == pytest.approx(1.0, abs=1e-3)
    assert float(lines[60]["coverage"]) == rows[0]["coverage"]
    for name in ("coverage.png", "error.png", "ellipses.png"):
        picture = cv2.imread(str(tmp_path / "out" / name))
        assert picture is not None and picture.std() > 5.0
    assert "pooled" in said[0] and "2 runs a case" in said[1]


def test_bad_numbers_and_folders_are_one_line(tmp_path: Path) -> None:
    taken = tmp_path / "taken"
    taken.write_text("kept")
    command = [sys.executable, "-m", "service", "study", "coverage", "--out", str(taken)]
    done = subprocess.run([*command, "--runs", "0"], capture_output=True, text=True, timeout=HANG_S, check=False)
    assert done.returncode == 2 and "--runs" in done.stderr
    done = subprocess.run(command, capture_output=True, text=True, timeout=HANG_S, check=False)
    assert done.returncode == 1 and done.stderr.startswith(f"distloc: --out {taken}: must be a folder")
    assert taken.read_text() == "kept"
