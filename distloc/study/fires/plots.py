"""The picture of fires as they are: of each scene the coverage, what is confirmed, and error and half-length."""

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import NullFormatter

from distloc.study.fires.summary import THIRDS, SceneSummary
from distloc.study.plots import METHOD_COLOURS, dress, legend
from distloc.types import FloatArray

_COLOUR, _OTHER = METHOD_COLOURS["RMVT"], METHOD_COLOURS["MVT"]
_NOMINAL = 0.95
_LEAST_PERCENT = 0.05
_THIRD_APART = 0.18  # of a line


def scenes_figure(found: Mapping[str, SceneSummary]) -> Figure:
    """A line a scene, from the top in the order given; error and half-length on a log axis."""
    if not found:
        raise ValueError("there must be at least one scene, got none")
    figure = Figure(figsize=(14.0, 1.8 + 0.3 * len(found)), layout="constrained")
    coverage, confirmed, error = figure.subplots(1, 3, sharey=True)
    ones, y = list(found.values()), np.arange(len(found), dtype=np.float64)
    coverage.axvline(_NOMINAL, color="0.6", linewidth=1.0, zorder=0)
    _dots(coverage, [one.coverage for one in ones], y, "o", _COLOUR, "all confirmed reports")
    low, high = np.array([one.coverage_low for one in ones]), np.array([one.coverage_high for one in ones])
    is_told = np.isfinite([one.coverage for one in ones])
    coverage.hlines(y[is_told], low[is_told], high[is_told], color=_COLOUR, linewidth=0.8, alpha=0.5)
    for third in range(THIRDS):
        values = [one.third_coverages[third] for one in ones]
        label = "in each third of the flight, from above" if third == 0 else ""
        _dots(coverage, values, y + _THIRD_APART * (third - 1.0), "|", _OTHER, label)
    _dots(confirmed, [one.confirmed_steps for one in ones], y, "o", _COLOUR, "steps with anything confirmed")
    _dots(confirmed, [one.held_share for one in ones], y, "D", _OTHER, "fires held at the end")
    for label, mark, colour, name in (
        ("error", "o", _COLOUR, "median_error_share"),
        ("half-length of the 95 % ellipse", "D", _OTHER, "median_half_share"),
    ):
        percent = 100.0 * np.array([getattr(one, name) for one in ones])
        _dots(error, np.maximum(percent, _LEAST_PERCENT), y, mark, colour, label)
    dress(coverage, "confirmed reports whose ellipse holds the fire", "", f"coverage (line: {_NOMINAL:g})")
    dress(confirmed, "share", "", "confirmed, and held")
    dress(error, "% of the range, medians", "", "at the last confirmed report")
    for axes in (coverage, confirmed):
        axes.set_xlim(-0.03, 1.03)
    error.set_xscale("log")
    error.xaxis.set_major_formatter(lambda value, _: f"{value:g}")
    error.xaxis.set_minor_formatter(NullFormatter())
    coverage.set_yticks(range(len(found)), list(found))
    coverage.set_ylim(len(found) - 0.5, -0.5)
    legend(figure, [coverage, confirmed, error])
    return figure


def _dots(axes: Axes, values: Sequence[float] | FloatArray, y: FloatArray, mark: str, colour: str, label: str) -> None:
    """What is not a number has none."""
    face = colour if mark == "o" else "none"
    axes.plot(values, y, mark, color=colour, markerfacecolor=face, markersize=6, label=label or "_nolegend_")
