"""The alert study's picture: seconds to be told of and false alarms by the threshold, and one against the other."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from distloc.study.alerts.places import LEVELS
from distloc.study.alerts.summary import Alerts
from distloc.study.plots import MARKERS, METHOD_COLOURS, dress, legend
from distloc.types import FloatArray

_COLOURS = (METHOD_COLOURS["MVT"], METHOD_COLOURS["RMVT"], METHOD_COLOURS["PF"])
_RATE = "false alarms a camera-hour"
_TIME = "seconds from ignition"
_LEAST_TOP_S = 60.0


def alerts_figure(curve: Sequence[Alerts], title: str) -> Figure:
    """Three panels over one or more thresholds; what was never told of lies on the first one's dashed line."""
    if not curve:
        raise ValueError("there must be at least one threshold, got none")
    figure = Figure(figsize=(14.0, 4.9), layout="constrained")
    times, rates, trade = figure.subplots(1, 3)
    after_s = np.array([one.after_s for one in curve])
    per_hour = np.array([one.false_per_hour for one in curve])
    longest_s = max(float(np.nanmax(after_s)) if np.isfinite(after_s).any() else 0.0, _LEAST_TOP_S)
    never_s = 1.12 * longest_s
    drawn_s = np.where(np.isfinite(after_s), after_s, never_s if curve[0].fires else np.nan)
    x = np.arange(len(curve))
    names = ["none" if one.threshold is None else f"{one.threshold:g}" for one in curve]
    for level, (name, colour) in enumerate(zip(LEVELS, _COLOURS, strict=True)):
        style = {
            "color": colour,
            "marker": MARKERS[level],
            "markersize": 9.0 - 2.0 * level,
            "linewidth": 2.6 - 0.6 * level,
        }
        times.plot(x, drawn_s[:, level], label=name, **style)
        rates.plot(x, per_hour[:, level], **style)
        trade.plot(per_hour[:, level], after_s[:, level], **style)
    _name_ends(trade, per_hour[:, 0], after_s[:, 0], names)
    for axes in (times, rates):
        axes.set_xticks(x, names)
    times.axhline(never_s, color="0.5", linestyle="--", linewidth=1.0, zorder=0)
    times.text(0.02, never_s, "not told of", transform=times.get_yaxis_transform(), va="bottom", color="0.35")
    for axes in (times, trade):
        axes.set_ylim(0.0, 1.12 * never_s)
    for set_scale, set_limit in ((rates.set_yscale, rates.set_ylim), (trade.set_xscale, trade.set_xlim)):
        set_scale("symlog", linthresh=1.0)
        set_limit(-0.1, 1.5 * max(float(np.nanmax(per_hour)) if np.isfinite(per_hour).any() else 0.0, 1.0))
    for axis in (rates.yaxis, trade.xaxis):
        axis.set_major_formatter(lambda value, _: f"{value:g}")
    fires = f"{curve[0].fires} fire{'s' * (curve[0].fires != 1)}"
    dress(times, "threshold", f"{_TIME}, median of {fires}", title)
    dress(rates, "threshold", _RATE, f"{curve[0].hours:.1f} h before ignition")
    dress(trade, _RATE, _TIME, "one against the other")
    legend(figure, [times])
    return figure


def _name_ends(axes: Axes, x: FloatArray, y: FloatArray, names: Sequence[str]) -> None:
    """The first and the last threshold at which there is something to draw, beside their points."""
    drawn = np.flatnonzero(np.isfinite(x) & np.isfinite(y)).tolist()
    for at in {*drawn[:1], *drawn[-1:]} if len(names) > 1 else ():
        axes.annotate(f"at {names[at]}", (x[at], y[at]), textcoords="offset points", xytext=(4, 9), color="0.25")
