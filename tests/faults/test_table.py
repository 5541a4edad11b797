"""docs/faults.md: each fault that is tested has its line, each name that the service may say its meaning."""

import re
from pathlib import Path

from tests.faults.table import BEGIN, DOC, END, row, with_table

HERE = Path(__file__).parent
SERVICE = HERE.parents[1] / "service"


def test_each_name_in_degraded_is_explained() -> None:
    text = DOC.read_text(encoding="utf-8")
    explained = set(re.findall(r"^\| `(\w+)` \|", text, re.MULTILINE))
    health = (SERVICE / "pipeline_health.py").read_text(encoding="utf-8")
    autopilot = (SERVICE / "autopilot.py").read_text(encoding="utf-8")
    said = set(re.findall(r'names\.append\("(\w+)"\)', health)) | set(re.findall(r'\("(\w+)", self\._app\.', health))
    faults = autopilot[autopilot.index("        faults = {") :]
    said |= set(re.findall(r'"(\w+)":', faults[: faults.index("}")]))
    assert said == explained


def test_each_tested_fault_has_its_line() -> None:
    lines = DOC.read_text(encoding="utf-8").split(BEGIN)[1].split(END)[0].splitlines()
    for path in HERE.glob("test_*_faults.py"):
        names = re.findall(r'\.fault\(\s*f?"([^"{]+)', path.read_text(encoding="utf-8"))
        assert names
        for name in names:
            assert any(line.startswith(f"| {name}") for line in lines), f"{name}: run python -m tests.faults.table"


def test_a_row_and_its_place() -> None:
    outcome = {
        "fault": "camera slow",
        "degraded": ["camera"],
        "rejects": [],
        "texts": ["Smoke 1", "distloc ok"],
        "recovered_s": 1.25,
    }
    line = "| camera slow | `camera` | - | `distloc ok` | 1.2 s |"
    assert row(outcome) == line
    made = with_table(f"before\n{BEGIN}\nold\n{END}\nafter\n", [outcome])
    assert made.startswith("before\n") and made.endswith("\nafter\n") and line in made and "old" not in made
