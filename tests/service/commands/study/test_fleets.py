"""`study fleets` end to end on a few fleets of the seeds that the fusion was tuned on."""

import csv
import json
from pathlib import Path

from service.commands.study.fleets import run_fleets

TUNED = 900


def test_the_command_end_to_end(tmp_path: Path) -> None:
    said: list[str] = []
    run_fleets(tmp_path / "out", 6, 0, 1, TUNED, said.append)
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == ["fleets.csv", "fleets.json"]
    found = json.loads((tmp_path / "out" / "fleets.json").read_text())
    assert found[0]["name"] == "drawn, all" and found[0]["fleets"] == 6
    assert sum(one["fleets"] for one in found[1:]) == 6 and sum(one["fires"] for one in found[1:]) == found[0]["fires"]
    with (tmp_path / "out" / "fleets.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [row["name"] for row in rows] == [one["name"] for one in found]
    table = said[0].split("\n\n")[0].splitlines()
    assert len(table) == 1 + len(found) and "one of two" in table[0] and "6 fleets in" in said[1]
