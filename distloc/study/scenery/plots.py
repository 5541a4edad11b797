"""The scenery study's picture: error and half-length against baseline, without and with the corners; their bounds."""

from collections.abc import Mapping

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from distloc.study.plots import dress, legend, log_y
from distloc.study.scenery.summary import CaseCurves
from distloc.types import FloatArray

WITHOUT_COLOUR, SCENERY_COLOUR = "#D55E00", "#0072B2"  # Okabe and Ito (2008)
_ERROR, _HALF_LENGTH, _BOUND = "-", (0, (6, 2)), (0, (1, 1.2))
_FIRST_SHARE = 0.04  # of the range flown: the bounds before are of nobody's interest


def scenery_figure(curves: Mapping[str, CaseCurves]) -> Figure:
    """One panel a geometry, all on the same log axis, as per cent of the range."""
    if not curves:
        raise ValueError("there must be at least one geometry, got none")
    rows = (len(curves) + 1) // 2
    figure = Figure(figsize=(11.0, 0.9 + 3.9 * rows), layout="constrained")
    panels = list(figure.subplots(rows, min(len(curves), 2), sharey=True, squeeze=False).flat)
    for axes, (name, one) in zip(panels, curves.items(), strict=False):
        _draw(axes, one)
        dress(axes, "baseline (way flown / range)", "% of the range" if axes in panels[::2] else "", name)
        axes.set_xlim(left=0.0)
    for axes in panels[len(curves) :]:
        axes.set_visible(False)
    log_y(*panels[: len(curves)])
    legend(figure, panels)
    return figure


def _draw(axes: Axes, one: CaseCurves) -> None:
    x = one.travelled_share
    for label, colour, found, bound in (
        ("smoke alone", WITHOUT_COLOUR, one.without, one.without_bound),
        ("with the scenery", SCENERY_COLOUR, one.scenery, one.scenery_bound),
    ):
        drawn = np.where((x >= _FIRST_SHARE) & np.isfinite(bound.half_length), bound.half_length, np.nan)
        _line(axes, x, found.half_length, f"{label}: half-length of the 95 % ellipse", colour, _HALF_LENGTH, 1.6)
        _line(axes, x, drawn, f"{label}: that of the Cramér–Rao bound", colour, _BOUND, 1.8)
        _line(axes, x, found.error, f"{label}: median error", colour, _ERROR, 2.2)


def _line(
    axes: Axes,
    x: FloatArray,
    share: FloatArray,
    label: str,
    colour: str,
    style: str | tuple[float, tuple[float, ...]],
    width_pt: float,
) -> None:
    axes.plot(x, 100.0 * share, label=label, color=colour, linestyle=style, linewidth=width_pt)
