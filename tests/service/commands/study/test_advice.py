"""`study advice` end to end on a few flights, and its table by hand."""

import csv
import json
from pathlib import Path

import numpy as np
import pytest

from distloc.advice.advise import Advice
from distloc.study.advice.flights import AdviceResult, AdviceRun, Flown, fly
from distloc.study.advice.summary import summarised
from service.commands.study.advice import run_advice

TUNED = 900  # seeds that the advice may be tuned on


def test_the_command_end_to_end(tmp_path: Path) -> None:
    said: list[str] = []
    run_advice(tmp_path / "out", 2, 1, TUNED, said.append)
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == ["advice.csv", "advice.json"]
    with (tmp_path / "out" / "advice.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [row["seed"] for row in rows] == ["900", "901"] and [row["camera"] for row in rows] == ["nose", "gimbal"]
    found = json.loads((tmp_path / "out" / "advice.json").read_text())
    assert found[-1]["name"] == "all" and found[-1]["runs"] == 2
    table = said[0].split("\n\n")[0].splitlines()
    assert len({len(line) for line in table}) == 1 and "2 runs in" in said[1]


def test_the_same_seed_flies_the_same_and_the_first_part_is_shared() -> None:
    first, second = fly(AdviceRun(901)), fly(AdviceRun(901))
    assert first == second and first.is_seen and first.advice is not None
    assert first.half_before_m > first.advice.likely_m > 0.0


def result(promised_m: float | None, flown_m: float, chance_m: float, is_inside: bool = True) -> AdviceResult:
    advice = Advice(1, "leg", False, 0.0, 600.0, 60.0, promised_m, promised_m or 1.0)
    return AdviceResult(AdviceRun(0), 1000.0, True, 500.0, advice, Flown(flown_m, is_inside), Flown(chance_m, True))


def test_the_shares_by_hand() -> None:
    nothing = AdviceResult(AdviceRun(0), 1000.0, False)
    some = [result(100.0, 129.0, 200.0), result(100.0, 60.0, 120.0), result(100.0, np.inf, np.inf, False)]
    found = summarised("all", [*some, result(None, 90.0, 100.0), nothing])
    assert (found.runs, found.seen, found.advised, found.promised) == (5, 4, 4, 3)
    assert (found.met, found.at_most) == pytest.approx((1 / 3, 2 / 3)) and found.inside == 0.75
    assert (found.advised_m, found.by_chance_m) == (90.0, 120.0) and found.paired == pytest.approx(0.645)
    empty = summarised("none", [nothing])
    assert empty.advised == 0 and np.isnan(empty.met)
