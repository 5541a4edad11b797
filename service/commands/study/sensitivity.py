"""`study sensitivity`: fly the sweeps, print them, write CSV, JSON and a plot for each."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from distloc.study.table1.sensitivity import SweepPoint, SweepResult, sensitivity, sweep_points
from service.commands.progress import count_progress
from service.commands.study.files import cell, load_plots, prepared, rounded, write_csv, write_json
from service.common.files import write_whole


def run_sensitivity(
    out: Path,
    runs: int,
    jobs: int,
    seed: int,
    say: Callable[[str], None],
    points: Sequence[SweepPoint] | None = None,
) -> None:
    """sensitivity.json, .csv and one plot a sweep in `out`."""
    plots = load_plots()
    prepared(out)
    points = points or sweep_points()
    with count_progress("sensitivity", len(points) * runs) as on_done:
        results = sensitivity(points, runs, jobs, seed, on_done)
    rows = [_sweep_row(one, runs) for one in results]
    write_json(out / "sensitivity.json", rows)
    write_csv(out / "sensitivity.csv", rows)
    head = f"{'sweep':28}{'value':>12}  {'method':8}{'mean m':>9}{'rms m':>9}{'ratio':>7}{'bound m':>9}{'no est.':>9}"
    say("\n".join([head, *(_sweep_line(one) for one in results)]))
    for sweep in dict.fromkeys(one.sweep for one in results):
        figure = _sweep_figure(plots, [one for one in results if one.sweep == sweep])
        write_whole(out / f"{sweep.replace(',', '').replace(' ', '_')}.png", plots.png_from_figure(figure))
    say(f"means over 200 to 1000 m of translation, {runs} runs; wrote {out}/sensitivity.json, .csv and a plot a sweep")


def _sweep_row(one: SweepResult, runs: int) -> dict[str, Any]:
    return {
        "sweep": one.sweep,
        "unit": one.unit,
        "value": one.value,
        "method": one.method,
        "min_m": rounded(one.summary.min_m, 3),
        "mean_m": rounded(one.summary.mean_m, 3),
        "rms_m": rounded(one.summary.rms_m, 3),
        "ratio": rounded(one.summary.ratio, 4),
        "bound_mean_m": rounded(one.bound_mean_m, 3),
        "estimated": rounded(one.summary.estimated, 4),
        "runs": runs,
    }


def _sweep_line(one: SweepResult) -> str:
    mean, rms = cell(one.summary.mean_m, 9, 1), cell(one.summary.rms_m, 9, 1)
    ratio, bound = cell(one.summary.ratio, 7, 2), cell(one.bound_mean_m, 9, 1)
    value = f"{one.value:g} {one.unit}"
    return f"{one.sweep:28}{value:>12}  {one.method:8}{mean}{rms}{ratio}{bound}{1 - one.summary.estimated:>9.1%}"


def _sweep_figure(plots: Any, results: Sequence[SweepResult]) -> Any:
    values = np.array(list(dict.fromkeys(one.value for one in results)))
    by_method: dict[str, list[SweepResult]] = {}
    for one in results:
        by_method.setdefault(one.method, []).append(one)
    errors = {name: np.array([one.summary.mean_m for one in ones]) for name, ones in by_method.items()}
    ratios = {
        name: np.array([np.nan if one.summary.ratio is None else one.summary.ratio for one in ones])
        for name, ones in by_method.items()
        if any(one.summary.ratio is not None for one in ones)
    }
    bound_m = np.array([one.bound_mean_m for one in next(iter(by_method.values()))])
    title = f"{results[0].sweep} ({results[0].unit})" if results[0].unit else results[0].sweep
    return plots.sweep_figure(title, values, errors, ratios, bound_m, log_x=results[0].sweep in ("particles", "range"))
