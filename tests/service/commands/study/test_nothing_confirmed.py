"""Studies in which no target is ever confirmed end like any other, and each table is said before a picture is drawn."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from distloc.localizer import Localizer
from distloc.study import plots
from distloc.study.coverage.cases import CoverageCase
from distloc.study.coverage.classes import Classes
from distloc.study.drawn.cases import cases_named
from distloc.study.methods import bootstrap_spec
from distloc.study.scenes import NOISES, paper_scene
from distloc.study.table1.sensitivity import SweepPoint
from distloc.types import TargetEstimate
from service.commands.study.coverage import run_coverage
from service.commands.study.drawn import run_drawn
from service.commands.study.scenery import run_scenery
from service.commands.study.sensitivity import run_sensitivity
from service.commands.study.sequence import run as sequence
from tests.support.places import CUT

TUNED = 900  # seeds that the filter may be tuned on: the study's own are looked at in the study alone
FEW = 200
Say = Callable[[str], None]

CLASSIC, CORNERS = (CoverageCase("perpendicular", one, range_m=(2000.0, 2000.0)) for one in ("constant", "scenery"))
POINT = SweepPoint("particles", "", FEW, paper_scene(200.0), NOISES["none"], (bootstrap_spec("PF", FEW),))
STUDIES: dict[str, tuple[Callable[[Path, Say], None], str]] = {
    "coverage": (lambda out, say: run_coverage(out, Classes([CLASSIC], []), 1, 1, TUNED, say, FEW), "perpendicular"),
    "scenery": (lambda out, say: run_scenery(out, 1, 1, TUNED, say, [CORNERS], FEW), "perpendicular"),
    "drawn": (lambda out, say: run_drawn(out, cases_named("hover"), 1, 1, TUNED, say, FEW, 0.02), "hover"),
}


@pytest.fixture
def said(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """What is said; no picture may be made before something was."""
    lines: list[str] = []
    make = plots.png_from_figure

    def png(figure: Any) -> bytes:
        assert lines, "drawn before the table was said"
        return make(figure)

    monkeypatch.setattr(plots, "png_from_figure", png)
    return lines


@pytest.mark.parametrize("name", STUDIES)
def test_nothing_is_ever_confirmed(name: str, said: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def silent(*_: Any) -> list[TargetEstimate]:
        return []

    monkeypatch.setattr(Localizer, "step", silent)
    run, row = STUDIES[name]
    run(tmp_path, said.append)
    assert row in said[0] and len(said) == 2
    pictures = list(tmp_path.glob("*.png"))
    assert pictures and all(path.stat().st_size > 1000 for path in pictures)


def test_a_sweep_and_a_sequence_say_their_tables_first(
    said: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sequence, "paper_methods", lambda: POINT.methods)
    monkeypatch.setattr(sequence, "calibrated_spec", lambda: bootstrap_spec("other", FEW))
    run_sensitivity(tmp_path / "sweep", 1, 1, TUNED, said.append, [POINT])
    assert "particles" in said[0] and list((tmp_path / "sweep").glob("*.png"))
    said.clear()
    sequence.run_sequence_study(CUT, None, tmp_path / "sequence", 1, 1, TUNED, said.append)
    assert "mean m" in said[0] and (tmp_path / "sequence" / "error.png").exists()
