"""The drawn study's picture: coverage and error of each scene, by smoke alone and with the scenery."""

from collections.abc import Mapping

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from distloc.study.drawn.summary import LEAST_COVERAGE, DrawnSummary, FireSummary
from distloc.study.plots import dress, legend, log_x
from distloc.study.scenery.plots import SCENERY_COLOUR, WITHOUT_COLOUR

_APART = 0.16  # of a line: half of what is between the two of a scene
_LEAST_PERCENT = 0.05


def drawn_figure(found: Mapping[str, DrawnSummary]) -> Figure:
    """A line a scene, from the top in the order given: the coverage, and error and half-length on a log axis."""
    if not found:
        raise ValueError("there must be at least one scene, got none")
    figure = Figure(figsize=(11.0, 1.6 + 0.36 * len(found)), layout="constrained")
    coverage, error = figure.subplots(1, 2, sharey=True)
    sides = (
        ("smoke alone", WITHOUT_COLOUR, -_APART, [one.without for one in found.values()]),
        ("with the scenery", SCENERY_COLOUR, _APART, [one.scenery for one in found.values()]),
    )
    coverage.axvline(LEAST_COVERAGE, color="0.6", linewidth=1.0, zorder=0)
    for label, colour, lower, ones in sides:
        _draw(coverage, error, label, colour, lower, ones)
    dress(coverage, "confirmed reports whose ellipse holds the fire", "", f"coverage (line: {LEAST_COVERAGE:g})")
    dress(error, "% of the range, medians at the end", "", "error, and half-length of the ellipse")
    coverage.set_xlim(-0.03, 1.03)
    log_x(error)
    coverage.set_yticks(range(len(found)), list(found))
    coverage.set_ylim(len(found) - 0.5, -0.5)
    legend(figure, [error])
    return figure


def _draw(coverage: Axes, error: Axes, label: str, colour: str, lower: float, ones: list[FireSummary]) -> None:
    """One side's dots; a scene without a confirmed report has none."""
    y = np.arange(len(ones)) + lower
    coverage.plot([one.coverage for one in ones], y, "o", color=colour, markersize=7)
    for words, mark, name, face in (
        ("error", "o", "median_error_share", colour),
        ("half-length of the 95 % ellipse", "D", "median_half_share", "none"),
    ):
        percent = 100.0 * np.array([getattr(one, name) for one in ones])
        shown = np.maximum(percent, _LEAST_PERCENT)
        error.plot(shown, y, mark, color=colour, markerfacecolor=face, markersize=7, label=f"{label}: {words}")
