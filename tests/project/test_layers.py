"""Which module may import which, read from the source."""

import ast
from pathlib import Path

import pytest

from tests.support.places import ROOT

SIMULATORS = {
    "distloc.simulation",
    "service.simulator.simulate",
    "service.simulator.scenario",
    "service.simulator.simulated_autopilot",
    "service.simulator.rendered_camera",
    "service.commands.demo.demo",
    "service.bench",
    "service.soak",
    "distloc.study",
    "service.commands.study.table1",
    "service.commands.study.coverage",
    "service.commands.study.sensitivity",
    "service.commands.study.sequence",
    "service.commands.study.segmentation",
    "service.commands.study.images",
    "service.commands.study.observed_sequence",
}
MAY_SIMULATE = {
    "study_files.py",
    "demo.py",
    "simulate.py",
    "scenario.py",
    "simulated_autopilot.py",
    "rendered_camera.py",
    "study_table1.py",
    "study_coverage.py",
    "study_sensitivity.py",
    "study_sequence.py",
    "study_segmentation.py",
    "study_images.py",
}
CORE = sorted((ROOT / "distloc").rglob("*.py"))
PRODUCTION = sorted(
    path
    for path in (ROOT / "service").rglob("*.py")
    if path.name not in MAY_SIMULATE and path.parent.name not in ("bench", "soak")  # which simulate what they measure
)


def imported(path: Path, *, at_top_only: bool = False) -> set[str]:
    tree = ast.parse(path.read_text(encoding="utf-8"))
    nodes = list(ast.walk(tree))
    if at_top_only:
        functions = [node for node in nodes if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)]
        inner = {id(node) for function in functions for node in ast.walk(function)}
        nodes = [node for node in nodes if id(node) not in inner]
    names: set[str] = set()
    for node in nodes:
        if isinstance(node, ast.Import):
            names.update(alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: a relative import hides its layer"
            names.add(node.module or "")
            names.update(f"{node.module}.{alias.name}" for alias in node.names)
    return names


def among(names: set[str], modules: set[str]) -> set[str]:
    return {name for name in names if any(name == module or name.startswith(f"{module}.") for module in modules)}


def name_of(path: Path) -> str:
    return str(path.relative_to(ROOT))


def test_the_walk_finds_the_modules() -> None:
    assert {"distloc/geometry/camera.py", "distloc/simulation/plume.py"} <= {name_of(path) for path in CORE}
    assert {"service/flight/app.py", "service/ground/subscriber.py"} <= {name_of(path) for path in PRODUCTION}
    assert among(imported(ROOT / "service" / "demo.py"), SIMULATORS)


@pytest.mark.parametrize("path", CORE, ids=name_of)
def test_core_is_pure(path: Path) -> None:
    assert among(imported(path), {"service", "asyncio", "logging", "random"}) == set()


@pytest.mark.parametrize("path", [path for path in CORE if path.parent.name == "distloc"], ids=name_of)
def test_core_knows_no_simulator(path: Path) -> None:
    assert among(imported(path), SIMULATORS) == set()


@pytest.mark.parametrize("path", PRODUCTION, ids=name_of)
def test_production_imports_no_simulator(path: Path) -> None:
    is_cli = path.name in ("cli.py", "cli_study.py")
    assert among(imported(path, at_top_only=is_cli), SIMULATORS) == set()
