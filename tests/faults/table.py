"""`python -m tests.faults.table`: runs the fault tests and puts what they measured into docs/faults.md."""

import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

from tests.faults.harness import OUT
from tests.support.places import ROOT

DOC = ROOT / "docs" / "faults.md"
BEGIN, END = "<!-- measured: begin -->", "<!-- measured: end -->"
HEADER = "| fault | `degraded` | frames rejected as | STATUSTEXT | well again after |\n|---|---|---|---|---|"


def row(outcome: dict[str, Any]) -> str:
    """One fault's line of the table."""
    names = [", ".join(f"`{name}`" for name in outcome[key]) or "-" for key in ("degraded", "rejects")]
    texts = ", ".join(f"`{text}`" for text in outcome["texts"] if text.startswith("distloc")) or "-"
    return f"| {outcome['fault']} | {names[0]} | {names[1]} | {texts} | {outcome['recovered_s']:.1f} s |"


def with_table(text: str, outcomes: list[dict[str, Any]]) -> str:
    """The document with its measured part replaced."""
    head, tail = text.split(BEGIN, maxsplit=1)[0], text.split(END)[1]
    return f"{head}{BEGIN}\n{HEADER}\n" + "\n".join(row(outcome) for outcome in outcomes) + f"\n{END}{tail}"


def main() -> int:
    """The tests' exit code; the document is only written where they passed."""
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "outcomes.jsonl"
        command = [
            sys.executable,
            "-m",
            "pytest",
            "--numprocesses=0",
            *map(str, sorted(Path(__file__).parent.glob("test_*_faults.py"))),
        ]
        code = subprocess.run(command, cwd=ROOT, env={**os.environ, OUT: str(out)}, check=False).returncode
        if code == 0:
            outcomes = [json.loads(line) for line in out.read_text(encoding="utf-8").splitlines()]
            DOC.write_text(with_table(DOC.read_text(encoding="utf-8"), outcomes), encoding="utf-8")
    return code


if __name__ == "__main__":
    sys.exit(main())
