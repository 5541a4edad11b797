"""docs/faults.md: each fault that is tested has its line, each name that the service may say its meaning."""

import re
from pathlib import Path

from service.common.degraded import Degraded
from tests.faults.table import BEGIN, DOC, END, row, with_table

HERE = Path(__file__).parent


def test_the_names_in_degraded_are_those_of_the_code_with_their_meanings_and_mends() -> None:
    told = [f"| `{name}` | {name.meaning} | {name.mend} |" for name in Degraded]
    written = [line for line in DOC.read_text(encoding="utf-8").splitlines() if re.match(r"\| `\w+` \|", line)]
    assert written == told, "put these lines into docs/faults.md:\n" + "\n".join(told)


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
