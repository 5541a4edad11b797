"""`study table1`: fly it, print the table, write CSV, JSON and plots."""

import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from distloc.study.scenes import NOISES, paper_scene
from distloc.study.table1.cells import Cell, Table1, table1, tasks_of
from distloc.study.table1.curves import mean_over_runs
from distloc.study.table1.silhouette import SilhouetteRow, silhouette_rows
from distloc.study.table1.strip import strip_frames
from service.commands.progress import count_progress
from service.commands.study.files import cell, load_plots, prepared, rounded, write_csv, write_json
from service.common.files import write_whole


def run_table1(out: Path, runs: int, jobs: int, seed: int, say: Callable[[str], None]) -> None:
    """table1.json, .csv, curves.csv, silhouette.json, error.png, ratio.png and frames.png in `out`."""
    plots = load_plots()
    prepared(out)
    started = time.monotonic()
    with count_progress("table1", tasks_of(runs)) as on_done:
        table = table1(runs, jobs, seed, on_done)
    scene = paper_scene()
    bias = silhouette_rows(scene, table.translation_m)
    rows = [_row(one, runs) for one in table.cells]
    write_json(out / "table1.json", rows)
    write_csv(out / "table1.csv", rows)
    write_csv(out / "curves.csv", [row for one in table.cells for row in _curve_rows(table, one)])
    write_json(out / "silhouette.json", [_silhouette_row(row) for row in bias])
    say(_table1_text(table, bias))
    errors = {
        name: {one.method: mean_over_runs(one.curve.error_m) for one in table.cells if one.noise == name}
        for name in NOISES
    }
    ratios = {one.noise: mean_over_runs(one.curve.ratio) for one in table.cells if one.summary.ratio is not None}
    figures = {
        "error.png": plots.errors_by_noise_figure(table.translation_m, errors, table.bounds_m),
        "ratio.png": plots.ratio_figure(table.translation_m, ratios),
        "frames.png": plots.frame_strip(*strip_frames(scene, seed)),
    }
    for name, figure in figures.items():
        write_whole(out / name, plots.png_from_figure(figure))
    say(f"{runs} runs in {time.monotonic() - started:.0f} s; wrote {out}/table1.json, .csv, curves.csv, the plots")


def _row(one: Cell, runs: int) -> dict[str, Any]:
    paper_min_m, paper_mean_m, paper_ratio = one.paper
    return {
        "noise": one.noise,
        "method": one.method,
        "min_m": rounded(one.summary.min_m, 3),
        "mean_m": rounded(one.summary.mean_m, 3),
        "ratio": rounded(one.summary.ratio, 4),
        "bound_mean_m": rounded(one.bound_mean_m, 3),
        "paper_min_m": paper_min_m,
        "paper_mean_m": paper_mean_m,
        "paper_ratio": paper_ratio,
        "runs": runs,
        "rms_m": rounded(one.summary.rms_m, 3),
        "estimated": rounded(one.summary.estimated, 4),
    }


def _silhouette_row(row: SilhouetteRow) -> dict[str, Any]:
    mean_m, end_m = rounded(row.mean_m, 3), rounded(row.end_m, 3)
    return {"centre": row.centre, "is_segment": row.is_segment, "mean_m": mean_m, "end_m": end_m}


def _curve_rows(table: Table1, one: Cell) -> list[dict[str, Any]]:
    errors_m, ratios = mean_over_runs(one.curve.error_m), mean_over_runs(one.curve.ratio)
    columns = zip(table.translation_m, errors_m, ratios, table.bounds_m[one.noise], strict=True)
    return [
        {
            "noise": one.noise,
            "method": one.method,
            "translation_m": rounded(translation_m, 3),
            "error_m": rounded(error_m, 3),
            "ratio": rounded(ratio, 4),
            "bound_m": rounded(bound_m, 3),
        }
        for translation_m, error_m, ratio, bound_m in columns
    ]


def _table1_text(table: Table1, bias: Sequence[SilhouetteRow]) -> str:
    head = f"{'noise':6}{'method':14}{'min m':>8}{'mean m':>9}{'rms m':>9}{'ratio':>7}{'bound m':>9}{'no est.':>9}"
    lines = [f"{head}   paper: {'min':>7}{'mean':>9}{'ratio':>7}"]
    for one in table.cells:
        found = one.summary
        lines.append(
            f"{one.noise:6}{one.method:14}{cell(found.min_m, 8, 2)}{cell(found.mean_m, 9, 2)}{cell(found.rms_m, 9, 2)}"
            f"{cell(found.ratio, 7, 2)}{cell(one.bound_mean_m, 9, 2)}{1 - found.estimated:>9.1%}          "
            + "".join(cell(value, width, 2) for value, width in zip(one.paper, (7, 9, 7), strict=True))
        )
    lines.append("")
    lines.append("noiseless, DLT: what the choice of a silhouette's centre costs        mean m   at 1000 m")
    for row in bias:
        lines.append(f"{row.centre:66}{row.mean_m:10.2f}{row.end_m:12.2f}")
    lines += [
        "",
        f"means over 200 to 1000 m of translation, {table.runs} runs; bound: Cramer-Rao, for the rms; noise adds up:",
        "pose, false positives (fp), false negatives (fn), partial ones (pfn); no est.: frames without an estimate,",
        "which the means leave out. RMVT: segments one by one, gate from the noise; RMVT-literal: as in the paper, one",
        "centre a frame, gate 2 px. RBPF: the filter that flies, told how large the row's pose noise is.",
    ]
    return "\n".join(lines)
