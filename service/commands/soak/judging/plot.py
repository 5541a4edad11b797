"""The soak's picture: memory, CPU, latency and rates over time, and which fault when. Needs matplotlib."""

import math

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from distloc.study.plots import dress, png_from_figure
from service.commands.soak.judging.result import MOST_LATENCY_MS, SoakResult
from service.commands.soak.judging.series import Series

_BLUE, _ORANGE, _GREEN, _RED, _BAND = "#0072B2", "#E69F00", "#009E73", "#D55E00", "#CC79A7"
_LEGEND_PT = 9
_ROOM = 1.2  # for the legend
_LEAST_KINDS = 6  # so that a few are no thick bars


def soak_png(result: SoakResult, series: Series) -> bytes:
    """Five panels over one axis of minutes; each fault is a band through all of them, named in the lowest."""
    figure = Figure(figsize=(12.0, 13.0), layout="constrained")
    memory, cpu, latency, rates, faults = figure.subplots(
        5, 1, sharex=True, gridspec_kw={"height_ratios": [1.0, 1.0, 1.0, 1.0, 1.5]}
    )
    minutes = series["t_s"] / 60.0
    _memory(memory, minutes, series, result)
    cpu.plot(minutes, series["cpu_share"], color=_BLUE, linewidth=0.5, alpha=0.5)
    cpu.plot(*_means(minutes, series["cpu_share"]), color=_BLUE, linewidth=1.5)
    cpu.set_ylim(bottom=0.0)
    dress(
        cpu, "", "CPU (cores)", f"CPU: mean {result.cpu.mean:.2f} of a core, 95 % of seconds under {result.cpu.p95:.2f}"
    )
    _latency(latency, minutes, series, result)
    _rates(rates, minutes, series, result)
    _faults(faults, result)
    for axes in (memory, cpu, latency, rates):
        for fault in result.faults:
            axes.axvspan(fault.start_s / 60.0, fault.end_s / 60.0, color=_BAND, alpha=0.15, linewidth=0.0)
    faults.set_xlim(0.0, max(float(minutes[-1]), 1e-3))
    said = "passed" if result.verdict.passed else "FAILED"
    figure.suptitle(
        f"distloc soak: {result.minutes:.1f} minutes at {result.speed:g} times the rates, "
        f"{len(result.faults)} faults: {said}",
        fontsize=14,
    )
    return png_from_figure(figure)


def _memory(axes: Axes, minutes: np.ndarray, series: Series, result: SoakResult) -> None:
    memory = result.memory
    axes.plot(minutes, series["memory_mb"], color=_BLUE, linewidth=1.0)
    settled = minutes >= memory.slope_from_s / 60.0
    x = minutes[settled]
    middle = np.median(series["memory_mb"][settled])
    axes.plot(x, middle + memory.slope_mb_h * (x - np.median(x)) / 60.0, color=_RED, linewidth=1.0, linestyle="--")
    dress(
        axes,
        "",
        "resident (MB)",
        f"memory of the service: {memory.end_mb:.0f} MB at the end, peak {memory.peak_mb:.0f} MB, "
        f"slope {memory.slope_mb_h:+.2f} MB/h (dashed)",
    )


def _latency(axes: Axes, minutes: np.ndarray, series: Series, result: SoakResult) -> None:
    for name, colour in (("max", _RED), ("p95", _ORANGE), ("p50", _BLUE)):
        values = series[f"latency_{name}_ms"]
        there = np.isfinite(values)
        axes.plot(minutes[there], values[there], color=colour, linewidth=1.2, marker=".", markersize=4, label=name)
    axes.axhline(MOST_LATENCY_MS, color="0.3", linewidth=0.8, linestyle="--")
    axes.set_yscale("log")
    axes.set_yticks([10, 30, 100, 300, 1000], labels=["10", "30", "100", "300", "1000"])
    axes.legend(loc="lower right", ncols=3, fontsize=_LEGEND_PT)
    found = result.latency
    dress(
        axes,
        "",
        "latency (ms)",
        "no report was heard"
        if found.p50_ms is None
        else f"frame handed over to report heard, by ten seconds: p50 {found.p50_ms:.0f} ms, "
        f"p95 {found.p95_ms:.0f} ms, latest {found.max_ms:.0f} ms",
    )


def _rates(axes: Axes, minutes: np.ndarray, series: Series, result: SoakResult) -> None:
    for name, label, colour in (
        ("frames_hz", "frames handed over", _ORANGE),
        ("localised_hz", "frames localised", _BLUE),
        ("reports_hz", "reports heard", _GREEN),
    ):
        axes.plot(*_means(minutes, series[name]), color=colour, linewidth=1.2, label=label)
    axes.plot(minutes, series["targets"], color="0.5", linewidth=1.0, label="targets (not a rate)")
    axes.set_ylim(0.0, _ROOM * max(1.0, axes.get_ylim()[1]))
    axes.legend(loc="upper right", ncols=4, fontsize=_LEGEND_PT)
    counts = result.counts
    seconds = result.minutes * 60.0
    dress(
        axes,
        "",
        "a second",
        f"{counts.frames_sent} frames ({counts.frames_sent / seconds:.1f}/s), {counts.frames_localised} localised, "
        f"{counts.messages_sent} MAVLink messages ({counts.messages_sent / seconds:.0f}/s), {counts.reports} reports",
    )


def _faults(axes: Axes, result: SoakResult) -> None:
    kinds = sorted({fault.kind for fault in result.faults})
    for fault in result.faults:
        colour = _RED if fault.recovered_s is None else _BAND
        axes.barh(
            kinds.index(fault.kind), (fault.end_s - fault.start_s) / 60.0, left=fault.start_s / 60.0, color=colour
        )
    axes.set_yticks(range(len(kinds)), labels=kinds)
    axes.set_axisbelow(True)
    axes.set_ylim(max(len(kinds), _LEAST_KINDS) - 0.4, -0.6)
    seen = [fault.recovered_s for fault in result.faults if fault.recovered_s is not None]
    slowest = f", the slowest after {max(seen):.1f} s" if seen else ""
    dress(
        axes,
        "minutes",
        "",
        f"faults: {len(result.faults)}, all well again after {len(seen)}{slowest} (red: not well again)",
    )


def _means(minutes: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Both by ten rows, or by more where there are over 500 tens."""
    rows = max(10, math.ceil(len(values) / 500))
    whole = len(values) // rows * rows
    return minutes[:whole].reshape(-1, rows).mean(axis=1), values[:whole].reshape(-1, rows).mean(axis=1)
