"""`study fleets`: are fires that several drones tell of fused honestly? Print the table, write CSV and JSON."""

import time
from collections.abc import Callable, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from distloc.study.fleets.flown import fly_all
from distloc.study.fleets.score import FleetScore, score_all
from distloc.study.fleets.summary import Summary, summarised
from service.commands.progress import count_progress
from service.commands.study.files import cell, prepared, rounded, write_csv, write_json

_NOTES = """\
95 % of it: the fused ellipses that hold the fire, and the drones' own. By nearest, by surest: the fused place's error
by that of the drone that happens to be nearest, and of the one with the smallest ellipse, medians. One of two: fleets
where two fires were told as one at some time; two of one: where a fire was two for over 30 s, who is outvoted left out.
Wrong: drones off by over 3.5 of their told standard deviations where two others see the same; named at the end."""


def run_fleets(out: Path, fleets: int, flown: int, jobs: int, seed: int, say: Callable[[str], None]) -> None:
    """fleets.json and .csv in `out`: drawn reports, and the real localizer in a smaller number of flights."""
    prepared(out)
    started = time.monotonic()
    with count_progress("fleets", fleets) as on_done:
        drawn = score_all(fleets, jobs, seed, on_done)
    rows = _rows("drawn", drawn)
    if flown:
        with count_progress("flown", flown) as on_done:
            rows += _rows("flown", fly_all(flown, jobs, seed, on_done))
    write_json(out / "fleets.json", [asdict(one) for one in rows])
    write_csv(out / "fleets.csv", [_cells(one) for one in rows])
    say(_text(rows))
    say(f"{fleets} fleets in {time.monotonic() - started:.0f} s; wrote {out}/fleets.json, .csv")


def _rows(kind: str, scores: Sequence[FleetScore]) -> list[Summary]:
    parts = [(f"{kind}, all", scores)]
    for name, has_worse in (("as told", False), ("some worse", True)):
        parts.append((f"{kind}, {name}", [one for one in scores if one.has_worse is has_worse]))
    return [summarised(name, own) for name, own in parts if own]


def _cells(one: Summary) -> dict[str, Any]:
    return {name: rounded(value, 4) if isinstance(value, float) else value for name, value in asdict(one).items()}


def _text(rows: Sequence[Summary]) -> str:
    heads = ("fleets", "fires", "95 % of it", "own", "by nearest", "by surest", "one of two", "two of one")
    widths = (8, 7, 12, 8, 12, 11, 12, 12)
    lines = [f"{'':20}" + "".join(f"{head:>{width}}" for head, width in zip(heads, widths, strict=True))]
    lines[0] += "   wrong: named, others named"
    for one in rows:
        values = (one.coverage, one.own_coverage, one.by_nearest, one.by_surest, one.merged, one.two)
        lines.append(
            f"{one.name:20}{one.fleets:8}{one.fires:7}"
            + "".join(cell(value, width, 3) for value, width in zip(values, widths[2:], strict=True))
            + f"{one.wrong:8}: {one.named}, {one.falsely} of {one.drones - one.wrong}"
        )
    return "\n".join([*lines, "", _NOTES])
