"""`study advice`: fly as advised and by chance, print whether the promises hold, write CSV and JSON."""

import math
import time
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any

from distloc.study.advice.flights import ERRORS, KINDS, AdviceResult, fly_all
from distloc.study.advice.summary import AdviceSummary, summarised
from service.commands.progress import count_progress
from service.commands.study.files import prepared, rounded, write_csv, write_json

_NOTES = """\
promised: advice that came with a half-length; met: the half-length flown came within 30 % of it, either way; most: to
no more than 1.3 of it; ratio: 10, 50 and 90 % quantiles of flown over promised. Half-lengths are medians in metres:
before, after the advised way, after a leg by chance that is as long; paired: the median of advised over chance.
inside: the 95 % ellipse held the truth after the advised way."""


def run_advice(out: Path, runs: int, jobs: int, seed: int, say: Callable[[str], None]) -> None:
    """advice.json and .csv, a row a flight, and a table."""
    prepared(out)
    started = time.monotonic()
    with count_progress("advice", runs) as on_done:
        results = fly_all(runs, jobs, seed, on_done)
    names = [(name, [one for one in results if name in (one.run.kind, one.run.error_class)]) for name in KINDS + ERRORS]
    found = [summarised(name, of) for name, of in [*names, ("all", results)] if of]
    write_json(out / "advice.json", [_told(asdict(one)) for one in found])
    write_csv(out / "advice.csv", [_row(one) for one in results])
    say("\n".join([_HEAD, *map(_line, found), "", _NOTES]))
    say(f"{runs} runs in {time.monotonic() - started:.0f} s; wrote {out}/advice.json, .csv")


_HEAD = (
    f"{'':10}{'runs':>5}{'seen':>5}{'advised':>8}{'promised':>9}{'met':>6}{'most':>6}  {'ratio':16}"
    f"{'before':>8}{'advised':>8}{'chance':>8}{'paired':>7}{'inside':>7}"
)


def _line(one: AdviceSummary) -> str:
    ratio = " ".join(f"{part:.2f}" for part in one.ratio)
    return (
        f"{one.name:10}{one.runs:>5}{one.seen:>5}{one.advised:>8}{one.promised:>9}{one.met:>6.2f}{one.at_most:>6.2f}"
        f"  {ratio:16}{one.before_m:>8.0f}{one.advised_m:>8.0f}{one.by_chance_m:>8.0f}{one.paired:>7.2f}"
        f"{one.inside:>7.3f}"
    )


def _row(one: AdviceResult) -> dict[str, Any]:
    advice, way, chance = one.advice, one.advised, one.by_chance
    return {
        "seed": one.run.seed,
        "camera": one.run.kind,
        "errors": one.run.error_class,
        "range_m": rounded(one.range_m, 1),
        "half_before_m": rounded(one.half_before_m, 1),
        "kind": advice.kind if advice else "",
        "heading_deg": rounded(math.degrees(advice.heading_rad), 1) if advice else None,
        "length_m": rounded(advice.length_m, 1) if advice else None,
        "promised_m": rounded(advice.half_length_m, 1) if advice and advice.half_length_m is not None else None,
        "half_advised_m": rounded(way.half_length_m, 1) if way else None,
        "half_by_chance_m": rounded(chance.half_length_m, 1) if chance else None,
        "is_inside": int(way.is_inside) if way else None,
    }


def _told(row: dict[str, Any]) -> dict[str, Any]:
    return {key: rounded(value, 4) if isinstance(value, float) else value for key, value in row.items()}
