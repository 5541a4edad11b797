"""`study coverage`: is the stated uncertainty true? Fly boxes and scenes, print tables, write CSV, JSON and plots."""

import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from distloc.filter.settings import ENOUGH_PARTICLES
from distloc.study.coverage.cases import CoverageCase
from distloc.study.coverage.classes import Classes
from distloc.study.coverage.flights import FlightResult, explained_flight, fly_all
from distloc.study.coverage.summary import (
    CaseCurves,
    CaseSummary,
    Coverage,
    FilterSummary,
    curves,
    pooled,
    summarised,
)
from distloc.study.fires.flights import PARTICLES
from service.commands.progress import count_progress
from service.commands.study.files import cell, load_plots, prepared, rounded, write_csv, write_json
from service.commands.study.scenes import cover_scenes
from service.common.files import write_whole

_NOTES = """\
At the flights' end. 95 % of it: the interval of the coverage, to which a seed counts once where cases are pooled, as
its flights share their errors; reports: the coverage of all confirmed and coasting reports. Errors on the map: median,
rms and the bound's (of the rms) as % of the range; half: half-length of the ellipse, median. NEES: 2 if the covariance
is true; lost: no estimate, counted as outside; conf.: believed targets (confirmed or coasting); false: tracks believed
in a run that never were a target's; clean: runs with every target believed, no false one and no switch of a target's
track after it was believed."""
_CLUTTER = {False: "no", True: "yes", None: "both"}


def run_coverage(
    out: Path,
    classes: Classes,
    runs: int,
    jobs: int,
    seed: int,
    say: Callable[[str], None],
    n_particles: int = ENOUGH_PARTICLES,
    length_share: float = 1.0,
) -> None:
    """What `_fly_boxes` and `cover_scenes` write in `out`, of what there is; `length_share` cuts scenes short."""
    load_plots()
    prepared(out)
    started = time.monotonic()
    if classes.boxes:
        _fly_boxes(out, classes.boxes, runs, jobs, seed, say, n_particles)
    if classes.scenes:
        cover_scenes(out, classes.scenes, runs, jobs, seed, say, min(n_particles, PARTICLES), length_share)
    parts = ("coverage.json, .csv, curves.csv", classes.boxes), ("scenes.json, .csv", classes.scenes)
    written = ", ".join(names for names, is_there in parts if is_there)
    say(f"{runs} runs a case in {time.monotonic() - started:.0f} s; wrote {out}/{written}, plots")


def _fly_boxes(
    out: Path,
    cases: Sequence[CoverageCase],
    runs: int,
    jobs: int,
    seed: int,
    say: Callable[[str], None],
    n_particles: int,
) -> None:
    """coverage.json, .csv, curves.csv, coverage.png, error.png (also with clutter) and ellipses.png."""
    with count_progress("coverage, boxes", len(cases) * runs) as on_done:
        flights = fly_all(cases, runs, jobs, seed, on_done, n_particles)
    rows = [_row(_names(case), summarised(of_case)) for case, of_case in zip(cases, flights, strict=True)]
    rows += _pooled_rows(cases, flights)
    by_case = {case: curves(of_case) for case, of_case in zip(cases, flights, strict=True)}
    write_json(out / "coverage.json", rows)
    write_csv(out / "coverage.csv", rows)
    write_csv(out / "curves.csv", [row for case, found in by_case.items() for row in _curve_rows(case, found)])
    say(_text(rows))
    _draw(out, by_case, seed, n_particles)


def _draw(out: Path, by_case: dict[CoverageCase, CaseCurves], seed: int, n_particles: int) -> None:
    from distloc.study.coverage import plots as coverage_plots
    from distloc.study.plots import png_from_figure

    figures = {"ellipses.png": coverage_plots.ellipses_figure(explained_flight(seed, n_particles))}
    for suffix, clutter in (("", False), ("_clutter", True)):
        shown: dict[str, CaseCurves] = {
            case.geometry: found
            for case, found in by_case.items()
            if case == CoverageCase(case.geometry, clutter=clutter)
            and case.geometry != "hover"  # which has no baseline
        }
        if shown:
            figures[f"coverage{suffix}.png"] = coverage_plots.coverage_figure(shown)
            figures[f"error{suffix}.png"] = coverage_plots.error_figure(shown)
    for name, figure in figures.items():
        write_whole(out / name, png_from_figure(figure))


def _pooled_rows(cases: Sequence[CoverageCase], flights: Sequence[Sequence[FlightResult]]) -> list[dict[str, Any]]:
    found = {clutter: pooled(cases, flights, clutter) for clutter in (False, True, None)}
    names = _names(CoverageCase("perpendicular")) | {"geometry": "pooled"}
    return [_row(names | {"clutter": clutter}, one) for clutter, one in found.items() if one is not None]


def _names(case: CoverageCase) -> dict[str, Any]:
    return {
        "geometry": case.geometry,
        "aside_deg": case.aside_deg,
        "error_class": case.error_class,
        "clutter": case.clutter,
        "targets": case.targets,
        "range_from_m": case.range_m[0],
        "range_to_m": case.range_m[1],
    }


def _row(names: dict[str, Any], found: CaseSummary) -> dict[str, Any]:
    return (
        names
        | {"runs": found.runs, "bound_share": rounded(found.bound_share, 5)}
        | _filter_columns("", found.calibrated)
        | _filter_columns("blind_", found.blind)
    )


def _filter_columns(prefix: str, found: FilterSummary) -> dict[str, Any]:
    coverage: Coverage = found.coverage
    columns = {
        "coverage": rounded(coverage.share, 4),
        "coverage_low": rounded(coverage.low, 4),
        "coverage_high": rounded(coverage.high, 4),
        "reports_coverage": rounded(found.reports_coverage, 4),
        "lost": found.lost,
        "mean_nees": rounded(found.mean_nees, 3),
        "median_error_share": rounded(found.median_error_share, 5),
        "rms_error_share": rounded(found.rms_error_share, 5),
        "median_half_share": rounded(found.median_half_share, 5),
        "believed_share": rounded(found.believed_share, 4),
        "false_believed_a_run": rounded(found.false_believed_a_run, 4),
        "switches": found.switches,
        "clean_share": rounded(found.clean_share, 4),
        "mean_gospa_m": rounded(found.mean_gospa_m, 2),
    }
    return {f"{prefix}{name}": value for name, value in columns.items()}


def _curve_rows(case: CoverageCase, found: CaseCurves) -> list[dict[str, Any]]:
    rows = []
    for step, travelled_share in enumerate(found.travelled_share):
        row = _names(case) | {
            "travelled_share": rounded(travelled_share, 4),
            "bound_share": rounded(found.bound_share[step], 5),
        }
        for prefix, one in (("", found.calibrated), ("blind_", found.blind)):
            row |= {
                f"{prefix}coverage": rounded(one.coverage[step], 4),
                f"{prefix}coverage_low": rounded(one.low[step], 4),
                f"{prefix}coverage_high": rounded(one.high[step], 4),
                f"{prefix}median_error_share": rounded(one.median_error_share[step], 5),
                f"{prefix}mean_nees": rounded(one.mean_nees[step], 3),
            }
        rows.append(row)
    return rows


def _text(rows: Sequence[dict[str, Any]]) -> str:
    head = (
        f"{'geometry':14}{'errors':14}{'clutter':8}{'fires':>5}{'range m':>11}{'runs':>5}{'lost':>5}{'coverage':>9}"
        f"  {'95 % of it':13}{'reports':>8}{'NEES':>6}{'error %':>8}{'rms %':>7}{'half %':>7}{'bound %':>8}{'conf.':>7}"
        f"{'false':>7}{'switch':>7}{'clean':>7}{'GOSPA m':>8}   bias-blind: coverage{'error %':>8}"
    )
    return "\n".join([head, *(_line(row) for row in rows), "", _NOTES])


def _line(row: dict[str, Any]) -> str:
    low_m, high_m = row["range_from_m"], row["range_to_m"]
    range_text = f"{low_m:.0f}" if low_m == high_m else f"{low_m:.0f}-{high_m:.0f}"
    interval = f"{row['coverage_low']:.3f}-{row['coverage_high']:.3f}"
    geometry = f"{row['geometry']} {row['aside_deg']:.0f}°" if row["aside_deg"] else row["geometry"]
    return (
        f"{geometry:14}{row['error_class']:14}{_CLUTTER[row['clutter']]:8}{row['targets']:>5}"
        f"{range_text:>11}{row['runs']:>5}{row['lost']:>5}{row['coverage']:>9.3f}  {interval:13}"
        f"{cell(row['reports_coverage'], 8, 3)}{cell(row['mean_nees'], 6, 2)}"
        f"{_percent(row['median_error_share'], 8)}{_percent(row['rms_error_share'], 7)}"
        f"{_percent(row['median_half_share'], 7)}{_percent(row['bound_share'], 8)}{row['believed_share']:>7.3f}"
        f"{row['false_believed_a_run']:>7.3f}{row['switches']:>7}{row['clean_share']:>7.2f}"
        f"{cell(row['mean_gospa_m'], 8, 1)}{row['blind_coverage']:>23.3f}{_percent(row['blind_median_error_share'], 8)}"
    )


def _percent(share: float | None, width: int) -> str:
    return cell(None if share is None else 100.0 * share, width, 2)
