"""`study scenes` end to end on a few short flights, and what it says to bad input."""

import csv
import json
from pathlib import Path

import cv2
import pytest
from typer.testing import CliRunner

from distloc.study.fires.cases import scenes_named
from distloc.study.fires.plots import scenes_figure
from service.commands.study.cli import study
from service.commands.study.scenes import run_scenes

FEW = 500
SHORT = 0.3  # of a flight
TUNED = 900  # seeds that the filter may be tuned on: the study's own are looked at in the study alone


def test_the_command_end_to_end(tmp_path: Path) -> None:
    said: list[str] = []
    cases = scenes_named("cut,mover_10_along_orbit")
    run_scenes(tmp_path / "out", cases, 1, 1, TUNED, said.append, FEW, SHORT)
    names = ["scenes.csv", "scenes.json", "scenes.png", "scenes.txt"]
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == names
    rows = json.loads((tmp_path / "out" / "scenes.json").read_text())
    scenes = ["tall_1000", "tall_1500", "tall_2000", "side", "side_first_half", "mover_10_along_orbit", "*cut"]
    assert [(row["scene"], row["runs"]) for row in rows] == [(name, 5 if name == "*cut" else 1) for name in scenes]
    assert all(row["told_after_s"] == 3.0 for row in rows)
    assert rows[-1]["reports"] == sum(row["reports"] for row in rows[:5])
    with (tmp_path / "out" / "scenes.csv").open() as file:
        lines = list(csv.DictReader(file))
    assert [float(line["confirmed_steps"]) for line in lines] == [row["confirmed_steps"] for row in rows]
    text = (tmp_path / "out" / "scenes.txt").read_text()
    assert said[0] + "\n" == text and "1 runs a scene" in said[1]
    table = text.split("\n\n")[0].splitlines()
    assert len({len(line) for line in table}) == 1 and len(table) == 1 + len(scenes)
    picture = cv2.imread(str(tmp_path / "out" / "scenes.png"))
    assert picture is not None and picture.std() > 5.0


def test_a_picture_of_nothing_is_refused() -> None:
    with pytest.raises(ValueError, match="at least one scene"):
        scenes_figure({})


def test_an_unknown_scene_and_a_bad_folder_are_one_line(tmp_path: Path) -> None:
    done = CliRunner().invoke(study, ["scenes", "--scenes", "dense,bonfire"])
    assert done.exit_code == 2
    told = " ".join(done.output.split())
    assert "--scenes" in told and "there is no scene 'bonfire': the groups are standing, leaning," in told
    taken = tmp_path / "taken"
    taken.write_text("kept")
    done = CliRunner().invoke(study, ["scenes", "--out", str(taken)])
    assert done.exit_code == 1 and f"--out {taken}: must be a folder" in str(done.exception)
    assert taken.read_text() == "kept"
