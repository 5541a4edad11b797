"""`study drawn`: drawn frames through the real tracker. Fly them, print the table, write CSV, JSON and the picture."""

import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from distloc.study.drawn.cases import DrawnCase
from distloc.study.drawn.flights import PARTICLES, fly_all
from distloc.study.drawn.summary import LEAST_COVERAGE, MOST_LESS, DrawnSummary, FireSummary, summarised
from service.commands.progress import count_progress
from service.commands.study.files import cell, load_plots, prepared, rounded, write_csv, write_json
from service.common.files import write_whole


def run_drawn(
    out: Path,
    cases: Sequence[DrawnCase],
    runs: int,
    jobs: int,
    seed: int,
    say: Callable[[str], None],
    n_particles: int = PARTICLES,
    length_share: float = 1.0,
) -> None:
    """drawn.json, .csv, .txt (the table) and .png in `out`; `length_share` cuts each flight short."""
    load_plots()
    prepared(out)
    started = time.monotonic()
    with count_progress("drawn", len(cases) * runs) as on_done:
        flights = fly_all(cases, runs, jobs, seed, on_done, n_particles, length_share)
    write_drawn(out, {case.name: summarised(ones) for case, ones in zip(cases, flights, strict=True)}, say)
    say(f"{runs} runs a scene in {time.monotonic() - started:.0f} s; wrote {out}/drawn.json, .csv, .txt and .png")


def write_drawn(out: Path, found: dict[str, DrawnSummary], say: Callable[[str], None]) -> None:
    """The table of scenes by name, and then the picture."""
    from distloc.study.drawn.plots import drawn_figure
    from distloc.study.plots import png_from_figure

    rows = [_row(name, one) for name, one in found.items()]
    text = _text(rows)
    write_json(out / "drawn.json", rows)
    write_csv(out / "drawn.csv", [row | {"misses": "; ".join(row["misses"])} for row in rows])
    write_whole(out / "drawn.txt", f"{text}\n".encode())
    say(text)
    write_whole(out / "drawn.png", png_from_figure(drawn_figure(found)))


def _row(name: str, found: DrawnSummary) -> dict[str, Any]:
    return (
        {
            "scene": name,
            "runs": found.runs,
            "used_share": rounded(found.used_share, 4),
            "heading_rms_deg": rounded(np.degrees(found.heading_rms_rad), 4),
            "heading_told_deg": rounded(np.degrees(found.heading_told_rad), 4),
            "heading_ratio": rounded(found.heading_rms_rad / found.heading_told_rad, 3),
            "attitude_nees": rounded(found.attitude_nees, 3),
        }
        | _columns("without_", found.without)
        | _columns("scenery_", found.scenery)
        | {"misses": found.misses}
    )


def _columns(prefix: str, one: FireSummary) -> dict[str, Any]:
    columns = {
        "confirmed_share": rounded(one.confirmed_share, 4),
        "confirmed_at_share": rounded(one.confirmed_at_share, 4),
        "median_error_share": rounded(one.median_error_share, 5),
        "median_half_share": rounded(one.median_half_share, 5),
        "reports": one.reports,
        "coverage": rounded(one.coverage, 4),
        "lost": one.lost,
        "withdrawn": one.withdrawn,
    }
    return {f"{prefix}{name}": value for name, value in columns.items()}


def _text(rows: Sequence[dict[str, Any]]) -> str:
    of_one = f"{'conf.':>6}{'at %':>6}{'error %':>8}{'half %':>7}{'cov.':>7}{'lost':>5}{'back':>5}"
    head = (
        f"{'':16}{'':5}{'heading, deg':>27}{'':6}  {'smoke alone':44}  with the scenery\n"
        f"{'scene':16}{'runs':>5}{'used':>6}{'error':>7}{'told':>7}{'ratio':>7}{'NEES':>6}  {of_one}  {of_one}  misses"
    )
    return "\n".join(
        [
            head,
            *(_line(row) for row in rows),
            "",
            "used: share of frames whose attitude is the scenery's; from 10 s on: rms error of the heading after",
            "correction, rms of its told sigma, and the attitude's NEES a degree of freedom (1 if the told covariance",
            "is true). conf.: share of flights that end with a confirmed target; at: way flown until the first, as",
            "median, in % of the range; error and half-length of the 95 % ellipse: medians at the end, in % of the",
            "range; cov.: confirmed and coasting reports whose ellipse holds the fire; lost: confirmed targets that",
            "ended though the fire was in view; back: confirmations taken back. misses: coverage over "
            f"{MOST_LESS:g} less than",
            f"by smoke alone, or under {LEAST_COVERAGE:g} where that is not; more lost",
        ]
    )


def _line(row: dict[str, Any]) -> str:
    return (
        f"{row['scene']:16}{row['runs']:>5}{cell(row['used_share'], 6, 2)}{cell(row['heading_rms_deg'], 7, 2)}"
        f"{cell(row['heading_told_deg'], 7, 2)}{cell(row['heading_ratio'], 7, 1)}{cell(row['attitude_nees'], 6, 1)}"
        f"  {_side(row, 'without_')}  {_side(row, 'scenery_')}  {'; '.join(row['misses']) or '-'}"
    )


def _side(row: dict[str, Any], prefix: str) -> str:
    return (
        f"{cell(row[f'{prefix}confirmed_share'], 6, 2)}{_percent(row[f'{prefix}confirmed_at_share'], 6, 1)}"
        f"{_percent(row[f'{prefix}median_error_share'], 8, 2)}{_percent(row[f'{prefix}median_half_share'], 7, 1)}"
        f"{cell(row[f'{prefix}coverage'], 7, 3)}{row[f'{prefix}lost']:>5}{row[f'{prefix}withdrawn']:>5}"
    )


def _percent(share: float | None, width: int, digits: int) -> str:
    return cell(None if share is None else 100.0 * share, width, digits)
