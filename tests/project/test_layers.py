"""Rooms import downwards only, in the order that is written here, and no module imports in a circle."""

import ast
import subprocess
from pathlib import Path

import pytest

from tests.support.places import ROOT

# From the bottom up: a module may import those of its own room and of rooms above it in this list.
ORDER = (
    "distloc.backports",
    "distloc.types",
    "distloc.snapshot",
    "distloc.geometry",
    "distloc.sights",
    "distloc.filter",
    "distloc.tracks",
    "distloc.scenery",
    "distloc.localizer",
    "distloc.advice",
    "distloc.calibration",
    "distloc.batch",
    "distloc",
    "distloc.simulation",
    "distloc.study",
    "service",
    "service.common",
    "service.config",
    "service.mavlink",
    "service.autopilot",
    "service.camera",
    "service.segmenters",
    "service.localise",
    "service.publish",
    "service.recordings",
    "service.flight",
    "service.ground",
    "service.simulator",
    "service.commands",
    "service.__main__",
)
FLIES = ORDER[: ORDER.index("service.ground") + 1]  # what runs on the drone and at the ground station
SIMULATES = ("distloc.simulation", "distloc.study", "service.simulator")
ROOMS = ("distloc", "service")
MOST_ENTRIES = 15
IMPURE = {
    *("service", "asyncio", "logging", "random", "socket", "threading"),
    *("time", "datetime", "pathlib", "os", "io"),
}
EXCUSED = {"distloc.study.runner": {"os", "threading"}, "distloc.study.plots": {"io"}}  # processes; a picture's bytes


def module_of(path: Path) -> str:
    parts = path.relative_to(ROOT).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


MODULES = {module_of(path): path for room in ROOMS for path in sorted((ROOT / room).rglob("*.py"))}


def room_of(module: str) -> str:
    """The longest name in ORDER that the module is or lies in."""
    names = [room for room in ORDER if module == room or module.startswith(f"{room}.")]
    return max(names, key=len)


def imported(path: Path) -> set[str]:
    """Modules of ours that a file imports, wherever in it."""
    names: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names.update(alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: a relative import hides its room"
            for alias in node.names:
                inner = f"{node.module}.{alias.name}"
                names.add(inner if inner in MODULES else str(node.module))
    return names & MODULES.keys()


GRAPH = {module: imported(path) for module, path in MODULES.items()}


def upwards(module: str, names: set[str]) -> set[str]:
    """What a module imports from rooms that lie higher than its own."""
    floor = ORDER.index(room_of(module))
    return {name for name in names if ORDER.index(room_of(name)) > floor}


def circle(graph: dict[str, set[str]]) -> list[str]:
    """Modules that import each other in a ring; empty where there is none."""
    done: set[str] = set()

    def walk(module: str, way: list[str]) -> list[str]:
        if module in way:
            return way[way.index(module) :]
        if module in done:
            return []
        for name in sorted(graph[module]):
            if found := walk(name, [*way, module]):
                return found
        done.add(module)
        return []

    return next((found for module in sorted(graph) if (found := walk(module, []))), [])


def test_a_breach_and_a_circle_are_found() -> None:
    assert upwards("service.common.latest", {"service.flight.app", "distloc.types"}) == {"service.flight.app"}
    assert upwards("service.localise.terrain.dem", {"service.publish.wire"}) == {"service.publish.wire"}
    assert sorted(circle({"a": {"b"}, "b": {"c"}, "c": {"b"}})) == ["b", "c"]
    assert {"distloc.geometry.camera", "service.flight.app", "service.ground.subscriber"} <= MODULES.keys()
    assert "service.localise.pipeline" in GRAPH["service.flight.app"]


@pytest.mark.parametrize("room", ROOMS)
def test_no_import_runs_up(room: str) -> None:
    breaches = {module: up for module, names in GRAPH.items() if (up := upwards(module, names))}
    assert {module: up for module, up in breaches.items() if module.startswith(room)} == {}


def test_no_module_imports_in_a_circle() -> None:
    assert circle(GRAPH) == []


def test_what_flies_imports_no_simulator() -> None:
    flying = [module for module in MODULES if room_of(module) in FLIES and room_of(module) not in SIMULATES]
    assert {m: GRAPH[m] for m in flying if any(room_of(name) in SIMULATES for name in GRAPH[m])} == {}


def test_core_is_pure() -> None:
    for module, path in MODULES.items():
        if module.startswith("distloc"):
            tree = ast.parse(path.read_text(encoding="utf-8"))
            names = {alias.name for node in ast.walk(tree) if isinstance(node, ast.Import) for alias in node.names}
            names |= {str(node.module) for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)}
            tops = {name.partition(".")[0] for name in names}
            assert tops.isdisjoint(IMPURE - EXCUSED.get(module, set())), module
            called = [node.func for node in ast.walk(tree) if isinstance(node, ast.Call)]
            assert "open" not in {function.id for function in called if isinstance(function, ast.Name)}, module


def test_commands_do_not_reach_into_each_other() -> None:
    """A folder a command; what two of them need lies below both, but for the unit's environment and the files."""
    allowed = {"service.commands.install.unit_environment", "service.commands.study.files"}
    for module, names in GRAPH.items():
        parts = module.split(".")
        if module.startswith("service.commands.") and len(parts) > 3:
            others = {n for n in names if n.startswith("service.commands.") and len(n.split(".")) > 3}
            assert {n for n in others if n.split(".")[2] != parts[2]} <= allowed, module


def test_one_room_leaves_anothers_private_names_alone() -> None:
    for module, path in MODULES.items():
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom) and str(node.module).split(".")[0] in ROOMS:
                assert not [alias.name for alias in node.names if alias.name.startswith("_")], module


def test_each_folder_is_a_package_and_no_file_of_it_is_ignored() -> None:
    paths = {path.parent / "__init__.py" for path in MODULES.values()} | set(MODULES.values())
    assert [path for path in paths if not path.exists()] == []
    asked = "\n".join(str(path.relative_to(ROOT)) for path in paths)
    command = ["git", "check-ignore", "--no-index", "--stdin"]
    done = subprocess.run(command, input=asked, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.stdout == "", f"{done.stdout}: .gitignore hides them from who clones"


def test_each_room_says_what_it_is_and_nothing_else() -> None:
    for module, path in MODULES.items():
        if path.name == "__init__.py" and module not in ROOMS:
            (node,) = ast.parse(path.read_text(encoding="utf-8")).body
            assert isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant), module


def test_no_folder_is_crowded() -> None:
    folders = {path.parent for path in MODULES.values()}
    for folder in folders:
        entries = [one.name for one in folder.iterdir() if not one.name.startswith((".", "__", "py.typed"))]
        assert len(entries) <= MOST_ENTRIES, f"{folder.relative_to(ROOT)}: {sorted(entries)}"
