"""The scenery study: its figures by hand, a few small flights, and the command end to end."""

import csv
import json
from pathlib import Path

import cv2
import numpy as np
import pytest
from typer.testing import CliRunner

from distloc.study.coverage.cases import CoverageCase
from distloc.study.coverage.ledger import Track
from distloc.study.coverage.staging import Run
from distloc.study.scenery.flights import SEED, Bounds, SceneryFlight, fly, fly_all, scenery_cases
from distloc.study.scenery.plots import scenery_figure
from distloc.study.scenery.summary import bound_shares, curves, summarised
from distloc.types import FloatArray
from service.commands.study.cli import study
from service.commands.study.scenery import run_scenery

FEW = 2000
TUNED = 900  # seeds that the filter may be tuned on: the study's own are looked at in the study alone
CASE = CoverageCase("perpendicular", "scenery", range_m=(1000.0, 1000.0), wobble_rad=0.02)
nan = float("nan")


@pytest.fixture(scope="module")
def flights() -> list[SceneryFlight]:
    return fly_all([CASE], 5, 2, TUNED, n_particles=FEW)[0]


def track(error_m: list[float], half_m: list[float], inside: list[float], believed: list[bool]) -> Track:
    return Track(
        error_m=np.array([error_m]),
        nees=np.array([[2.0 * one for one in inside]]),
        is_inside=np.array([inside]),
        believed=int(believed[-1]),
        false_believed=0,
        switches=0,
        gospa_m=0.0,
        half_length_m=np.array([half_m]),
        is_believed=np.array([believed]),
    )


def flight(scenery: Track, heading_rad: FloatArray | None = None) -> SceneryFlight:
    lost = track([nan] * 4, [nan] * 4, [nan] * 4, [False] * 4)
    heading = np.array([9.0, 0.3, -0.4, nan]) if heading_rad is None else heading_rad
    return SceneryFlight(np.array([0.0, 100.0, 200.0, 300.0]), 1000.0, lost, scenery, heading, np.full(4, 0.5))


def test_figures_of_a_case_by_hand() -> None:
    first = track([nan, 40.0, 30.0, 10.0], [nan, 90.0, 80.0, 40.0], [nan, 0.0, 0.0, 1.0], [False, False, True, True])
    second = track([nan, nan, 50.0, 30.0], [nan, nan, 90.0, 60.0], [nan, nan, 1.0, 0.0], [False, False, False, True])
    unsure = track([nan, nan, nan, 99.0], [nan, nan, nan, 999.0], [nan, nan, nan, 1.0], [False] * 4)
    found = summarised([flight(first), flight(second), flight(unsure)])
    ours = found.scenery
    assert (ours.confirmed_share, ours.confirmed_at_share) == (pytest.approx(2 / 3), pytest.approx(0.3))
    assert (ours.median_error_share, ours.median_half_share) == (pytest.approx(0.02), pytest.approx(0.05))
    assert (ours.coverage, ours.end_coverage, ours.mean_nees) == (pytest.approx(1 / 3), 0.5, 1.0)
    assert found.heading_rms_rad == pytest.approx(np.sqrt((0.3**2 + 0.4**2) / 2))  # from a quarter of the flight on
    assert found.heading_told_rad == pytest.approx(0.5)
    nobody = found.without
    assert (nobody.confirmed_share, nobody.confirmed_at_share) == (0.0, np.inf)
    assert np.isnan([nobody.median_error_share, nobody.median_half_share, nobody.coverage, nobody.mean_nees]).all()
    bounds = Bounds(np.full((4, 2, 2), np.inf), np.tile(np.diag([9.0, 16.0]), (4, 1, 1)))
    drawn = curves([flight(first), flight(second), flight(unsure)], bounds)
    np.testing.assert_allclose(drawn.scenery.error, [nan, nan, 0.04, 0.03])  # where most flights have an estimate
    np.testing.assert_allclose(drawn.travelled_share, [0.0, 0.1, 0.2, 0.3])
    np.testing.assert_allclose(drawn.scenery_bound.error, 0.005)
    np.testing.assert_allclose(drawn.scenery_bound.half_length, 0.004 * 2.4477, rtol=1e-4)
    assert np.isinf(drawn.without_bound.error).all()


def test_a_bounds_ellipse_is_that_of_its_largest_direction() -> None:
    turned = np.array([[5.0, 4.0], [4.0, 5.0]])  # 9 along the diagonal, 1 across
    found = bound_shares(np.stack([turned, np.full((2, 2), np.inf)]), 100.0)
    np.testing.assert_allclose(found.half_length, [0.03 * 2.4477, np.inf], rtol=1e-4)
    np.testing.assert_allclose(found.error, [np.sqrt(10.0) / 100.0, np.inf])


def test_corners_shrink_the_ellipse_and_the_headings_error_is_what_is_told(flights: list[SceneryFlight]) -> None:
    found = summarised(flights)
    assert 0.005 < np.degrees(found.heading_rms_rad) < 0.6  # told 2 degrees
    assert 0.2 < found.heading_rms_rad / found.heading_told_rad < 5.0
    assert found.scenery.confirmed_share == 1.0 and 0.02 < found.scenery.confirmed_at_share < 0.5
    assert 0.001 < found.scenery.median_half_share < 0.5 * found.without.median_half_share
    assert 0.0 < found.scenery.median_error_share < 0.05
    for one in flights:
        assert one.range_m == pytest.approx(1000.0) and one.travelled_m[-1] == pytest.approx(1000.0)


def test_a_flight_is_its_seeds_for_any_number_of_processes(flights: list[SceneryFlight]) -> None:
    again = fly(Run(CASE, TUNED + 1, FEW))
    np.testing.assert_array_equal(again.scenery.error_m, flights[1].scenery.error_m)
    np.testing.assert_array_equal(again.heading_error_rad, flights[1].heading_error_rad)
    assert not np.array_equal(flights[0].scenery.error_m, flights[1].scenery.error_m)


def test_the_cases_are_those_that_the_study_promises() -> None:
    cases = scenery_cases()
    assert len(set(cases)) == len(cases) == 16 and SEED == 62_000
    geometries = ("perpendicular", "oblique", "orbit", "lawnmower")
    assert {(one.geometry, one.range_m[0], one.error_class) for one in cases} == {
        (geometry, range_m, "scenery") for geometry in geometries for range_m in (1000.0, 2000.0, 4000.0)
    } | {(geometry, 2000.0, "scenery_worse") for geometry in geometries}


def test_a_picture_of_nothing_is_refused() -> None:
    with pytest.raises(ValueError, match="at least one geometry"):
        scenery_figure({})


def test_the_command_end_to_end(tmp_path: Path) -> None:
    case = CoverageCase("orbit", "scenery", range_m=(2000.0, 2000.0), wobble_rad=0.02)
    said: list[str] = []
    run_scenery(tmp_path / "out", 1, 1, TUNED, said.append, [case], FEW)
    names = ["curves.csv", "scenery.csv", "scenery.json", "scenery.png"]
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == names
    without, scenery = json.loads((tmp_path / "out" / "scenery.json").read_text())
    assert (without["scenery"], scenery["scenery"], scenery["geometry"], scenery["runs"]) == (False, True, "orbit", 1)
    assert without["heading_rms_deg"] is None and 0.0 < scenery["heading_rms_deg"] < 2.0
    assert 0.0 < scenery["bound_error_share"] < 0.3 * without["bound_error_share"]
    assert scenery["bound_half_share"] < 1.5 * scenery["median_half_share"]
    with (tmp_path / "out" / "curves.csv").open() as file:
        lines = list(csv.DictReader(file))
    assert len(lines) == 61 and float(lines[60]["travelled_share"]) == pytest.approx(1.5, abs=0.01)
    assert float(lines[60]["scenery_half_share"]) == scenery["median_half_share"]
    picture = cv2.imread(str(tmp_path / "out" / "scenery.png"))
    assert picture is not None and picture.std() > 5.0
    assert said[0].count("orbit") == 2 and "1 runs a case" in said[1]


def test_bad_numbers_and_folders_are_one_line(tmp_path: Path) -> None:
    taken = tmp_path / "taken"
    taken.write_text("kept")
    done = CliRunner().invoke(study, ["scenery", "--runs", "0"])
    assert done.exit_code == 2 and "--runs" in done.output
    done = CliRunner().invoke(study, ["scenery", "--out", str(taken)])
    assert done.exit_code == 1 and f"--out {taken}: must be a folder" in str(done.exception)
    assert taken.read_text() == "kept"
