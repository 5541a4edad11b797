"""The coverage study's pictures: coverage and error against baseline, and one flight's two ellipses on a map."""

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Ellipse as EllipsePatch
from matplotlib.patches import Rectangle

from distloc.study.coverage.flights import ExplainedFlight
from distloc.study.coverage.summary import CaseCurves, FilterCurves
from distloc.study.plots import BOUND_LABEL, METHOD_COLOURS, dress, legend
from distloc.types import Ellipse, FloatArray, TargetEstimate

CALIBRATED, BLIND = "calibrated", "bias-blind"
COLOURS = {CALIBRATED: METHOD_COLOURS["RBPF"], BLIND: METHOD_COLOURS["RMVT"]}
NOMINAL_LABEL = "0.95"
BASELINE_LABEL = "baseline (travel / range)"
_ZOOM = 1.3  # of what must be seen


def coverage_figure(curves: Mapping[str, CaseCurves]) -> Figure:
    """Share of runs whose 95 % ellipse holds the truth, with Wilson's 95 % band, one panel a geometry."""
    figure, panels = _panels(len(curves))
    for axes, (name, one) in zip(panels, curves.items(), strict=True):
        axes.axhline(0.95, color="black", linestyle="--", linewidth=1.2, label=NOMINAL_LABEL)
        for label, found in _filters(one):
            axes.fill_between(one.travelled_share, found.low, found.high, color=COLOURS[label], alpha=0.2, linewidth=0)
            axes.plot(one.travelled_share, found.coverage, color=COLOURS[label], linewidth=1.8, label=label)
        axes.set_ylim(-0.02, 1.02)
        dress(axes, BASELINE_LABEL, "truth inside the 95 % ellipse" if axes is panels[0] else "", name)
    legend(figure, panels)
    return figure


def error_figure(curves: Mapping[str, CaseCurves]) -> Figure:
    """Median error on the map and the bound as per cent of the range on a log axis, one panel a geometry."""
    figure, panels = _panels(len(curves))
    drawn = []
    for axes, (name, one) in zip(panels, curves.items(), strict=True):
        for label, found in _filters(one):
            axes.plot(
                one.travelled_share, 100.0 * found.median_error_share, color=COLOURS[label], linewidth=1.8, label=label
            )
            drawn.append(found.median_error_share)
        bound = np.where(np.isfinite(one.bound_share), one.bound_share, np.nan)
        axes.plot(one.travelled_share, 100.0 * bound, color="black", linestyle="--", linewidth=1.4, label=BOUND_LABEL)
        drawn.append(bound[one.travelled_share >= 0.1])  # earlier it is far above what the prior of the range allows
        dress(axes, BASELINE_LABEL, "median error (% of range)" if axes is panels[0] else "", name)
    values = 100.0 * np.concatenate(drawn)
    values = values[np.isfinite(values) & (values > 0.0)]
    low, high = (values.min() / 1.5, values.max() * 1.5) if values.size else (0.1, 100.0)
    for axes in panels:
        axes.set_ylim(float(low), float(high))
        axes.set_yscale("log")
        axes.yaxis.set_major_formatter("{x:g}")
    legend(figure, panels)
    return figure


def ellipses_figure(flight: ExplainedFlight) -> Figure:
    """One flight on the map, and beside it what lies about the target: the truth and both filters' 95 % ellipses."""
    figure = Figure(figsize=(12.0, 6.9), layout="constrained")
    panels = figure.subplots(1, 2)
    seen = [flight.truth_en_m[:, None]]
    for label, estimate in ((CALIBRATED, flight.calibrated), (BLIND, flight.blind)):
        if estimate is not None:
            seen.append(_outline(estimate))
            for axes in panels:
                _draw_estimate(axes, estimate, label)
    for axes in panels:
        axes.plot(*flight.truth_en_m, "x", color="black", markersize=9, markeredgewidth=2, label="truth")
    panels[0].plot(*flight.path_en_m, color="0.4", linewidth=2.0, label="the drone's path")
    _fit(panels[0], np.hstack([*seen, flight.path_en_m]))
    _fit(panels[1], np.hstack(seen))
    (left, right), (low, high) = panels[1].get_xlim(), panels[1].get_ylim()
    panels[0].add_patch(Rectangle((left, low), right - left, high - low, fill=False, color="0.6", linewidth=0.8))
    dress(panels[0], "east (m)", "north (m)", "the flight")
    dress(panels[1], "east (m)", "north (m)", "the target, with both 95 % ellipses")
    legend(figure, panels)
    return figure


def _panels(count: int) -> tuple[Figure, Sequence[Axes]]:
    if count == 0:
        raise ValueError("there must be at least one geometry, got none")
    figure = Figure(figsize=(1.2 + 2.9 * count, 4.2), layout="constrained")
    return figure, list(figure.subplots(1, count, sharex=False, sharey=True, squeeze=False)[0])


def _filters(curves: CaseCurves) -> tuple[tuple[str, FilterCurves], ...]:
    return (CALIBRATED, curves.calibrated), (BLIND, curves.blind)


def _draw_estimate(axes: Axes, estimate: TargetEstimate, label: str) -> None:
    ellipse, (east, north) = estimate.ellipse95, estimate.position_enu_m[:2]
    angle_deg = 90.0 - float(np.degrees(ellipse.azimuth_rad))  # anticlockwise from east
    axes.add_patch(
        EllipsePatch(
            (float(east), float(north)),
            2.0 * ellipse.semi_major_m,
            2.0 * ellipse.semi_minor_m,
            angle=angle_deg,
            facecolor="none",
            edgecolor=COLOURS[label],
            linewidth=2.0,
            label=f"{label}, 95 %",
            zorder=3.0,
        )
    )
    axes.plot(east, north, "o", color=COLOURS[label], markersize=4)


def _outline(estimate: TargetEstimate) -> FloatArray:
    """Points (2, N) on the ellipse."""
    ellipse: Ellipse = estimate.ellipse95
    angle = np.linspace(0.0, 2.0 * np.pi, 73)
    along = np.array([np.sin(ellipse.azimuth_rad), np.cos(ellipse.azimuth_rad)])
    across = np.array([along[1], -along[0]])
    offsets_m = np.outer(along, ellipse.semi_major_m * np.cos(angle)) + np.outer(
        across, ellipse.semi_minor_m * np.sin(angle)
    )
    return np.asarray(estimate.position_enu_m[:2, None] + offsets_m)


def _fit(axes: Axes, points_en_m: FloatArray) -> None:
    """Equal axes around points (2, N), as wide as high."""
    low, high = points_en_m.min(axis=1), points_en_m.max(axis=1)
    half_m = _ZOOM * max(float((high - low).max()), 10.0) / 2.0
    east, north = (low + high) / 2.0
    axes.set_xlim(float(east) - half_m, float(east) + half_m)
    axes.set_ylim(float(north) - half_m, float(north) + half_m)
    axes.set_aspect("equal")
    axes.ticklabel_format(useOffset=False)
