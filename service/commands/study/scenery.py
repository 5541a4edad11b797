"""`study scenery`: what corners of the scenery add. Fly it, print the table, write CSV, JSON and the picture."""

import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from distloc.study.coverage.cases import ERROR_CLASSES, CoverageCase
from distloc.study.scenery.flights import DRAWN_RANGE_M, PARTICLES, bounds_of_all, fly_all, scenery_cases
from distloc.study.scenery.summary import BoundShares, CaseCurves, CaseSummary, TargetSummary, curves, summarised
from service.commands.progress import count_progress
from service.commands.study.files import cell, load_plots, prepared, rounded, write_csv, write_json
from service.common.files import write_whole


def run_scenery(
    out: Path,
    runs: int,
    jobs: int,
    seed: int,
    say: Callable[[str], None],
    cases: Sequence[CoverageCase] | None = None,
    n_particles: int = PARTICLES,
) -> None:
    """scenery.json, .csv, curves.csv and scenery.png (of the flights at 2 km) in `out`."""
    load_plots()
    prepared(out)
    started = time.monotonic()
    cases = scenery_cases() if cases is None else cases
    with count_progress("scenery", len(cases) * runs) as on_done:
        flights = fly_all(cases, runs, jobs, seed, on_done, n_particles)
    bounds = bounds_of_all(cases, jobs, seed)
    found = {case: summarised(of_case) for case, of_case in zip(cases, flights, strict=True)}
    drawn = {case: curves(ones, bound) for case, ones, bound in zip(cases, flights, bounds, strict=True)}
    rows = [row for case in cases for row in _rows(case, found[case], drawn[case])]
    write_json(out / "scenery.json", rows)
    write_csv(out / "scenery.csv", rows)
    write_csv(out / "curves.csv", [row for case, one in drawn.items() for row in _curve_rows(case, one)])
    say(_text(rows))
    _draw(out, drawn)
    say(f"{runs} runs a case in {time.monotonic() - started:.0f} s; wrote {out}/scenery.json, .csv, curves.csv, plot")


def _draw(out: Path, drawn: dict[CoverageCase, CaseCurves]) -> None:
    from distloc.study.plots import png_from_figure
    from distloc.study.scenery.plots import scenery_figure

    shown: dict[str, CaseCurves] = {
        case.geometry: one
        for case, one in drawn.items()
        if case.range_m[0] == DRAWN_RANGE_M and case.error_class == "scenery"
    }
    if shown:
        write_whole(out / "scenery.png", png_from_figure(scenery_figure(shown)))


def _names(case: CoverageCase) -> dict[str, Any]:
    heading_deg = float(np.degrees(ERROR_CLASSES[case.error_class].heading_bias_rad))
    return {"geometry": case.geometry, "range_m": case.range_m[0], "heading_sigma_deg": round(heading_deg, 3)}


def _rows(case: CoverageCase, found: CaseSummary, drawn: CaseCurves) -> list[dict[str, Any]]:
    """Without and with the corners."""
    heading = {
        "heading_rms_deg": rounded(np.degrees(found.heading_rms_rad), 4),
        "heading_told_deg": rounded(np.degrees(found.heading_told_rad), 4),
    }
    both = (
        (False, found.without, drawn.without_bound, dict.fromkeys(heading)),
        (True, found.scenery, drawn.scenery_bound, heading),
    )
    return [
        _names(case) | {"scenery": has, "runs": found.runs} | _columns(one, bound) | columns
        for has, one, bound, columns in both
    ]


def _columns(one: TargetSummary, bound: BoundShares) -> dict[str, Any]:
    return {
        "confirmed_share": rounded(one.confirmed_share, 4),
        "confirmed_at_share": rounded(one.confirmed_at_share, 4),
        "median_error_share": rounded(one.median_error_share, 5),
        "median_half_share": rounded(one.median_half_share, 5),
        "bound_error_share": rounded(bound.error[-1], 5),
        "bound_half_share": rounded(bound.half_length[-1], 5),
        "coverage": rounded(one.coverage, 4),
        "end_coverage": rounded(one.end_coverage, 4),
        "mean_nees": rounded(one.mean_nees, 3),
    }


def _curve_rows(case: CoverageCase, one: CaseCurves) -> list[dict[str, Any]]:
    columns = {
        "travelled_share": one.travelled_share,
        "without_error_share": one.without.error,
        "without_half_share": one.without.half_length,
        "without_bound_error_share": one.without_bound.error,
        "without_bound_half_share": one.without_bound.half_length,
        "scenery_error_share": one.scenery.error,
        "scenery_half_share": one.scenery.half_length,
        "scenery_bound_error_share": one.scenery_bound.error,
        "scenery_bound_half_share": one.scenery_bound.half_length,
    }
    return [
        _names(case) | {name: rounded(values[step], 5) for name, values in columns.items()}
        for step in range(one.travelled_share.size)
    ]


def _text(rows: Sequence[dict[str, Any]]) -> str:
    head = (
        f"{'geometry':14}{'range m':>8}{'heading':>8} {'scenery':8}{'runs':>5}{'conf.':>7}{'at %':>7}{'error %':>9}"
        f"{'bound %':>8}{'half %':>8}{'bound %':>8}{'coverage':>9}{'at end':>8}{'NEES':>6}{'heading error, told':>21}"
    )
    return "\n".join(
        [
            head,
            *(_line(row) for row in rows),
            "",
            "heading: sigma of the compass' error in degrees, told 2; the rest is of confirmed and coasting targets;",
            "conf.: share of flights that end with one; at: way flown until the first report of one, median, in % of",
            "the range; error and half-length of the 95 % ellipse: medians at the end, in % of the range, each beside",
            "the Cramer-Rao bound's (of the rms error); coverage: reports of all steps whose ellipse holds the truth,",
            "and those at the end; NEES at the end: 2 if the covariance is true; heading error, told: rms after the",
            "corners' correction and the told sigma, in degrees",
        ]
    )


def _line(row: dict[str, Any]) -> str:
    has = "yes" if row["scenery"] else "no"
    return (
        f"{row['geometry']:14}{row['range_m']:>8.0f}{row['heading_sigma_deg']:>8g} {has:8}{row['runs']:>5}"
        f"{row['confirmed_share']:>7.2f}{_percent(row['confirmed_at_share'], 7, 1)}"
        f"{_percent(row['median_error_share'], 9, 2)}{_percent(row['bound_error_share'], 8, 2)}"
        f"{_percent(row['median_half_share'], 8, 1)}{_percent(row['bound_half_share'], 8, 1)}"
        f"{cell(row['coverage'], 9, 3)}{cell(row['end_coverage'], 8, 2)}{cell(row['mean_nees'], 6, 2)}"
        f"{cell(row['heading_rms_deg'], 14, 3)}{cell(row['heading_told_deg'], 7, 3)}"
    )


def _percent(share: float | None, width: int, digits: int) -> str:
    return cell(None if share is None else 100.0 * share, width, digits)
