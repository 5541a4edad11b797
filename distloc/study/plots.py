"""The study's pictures as matplotlib figures of the object API; the study's command writes them to files.

Nothing here reads or sets pyplot's state. A method has the same colour in every picture.
"""

import io
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from textwrap import fill
from typing import Any

import cv2
import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter
from numpy.typing import NDArray

from distloc.types import FloatArray, MaskArray

DPI = 150
MEAN_FROM_M, MEAN_TO_M = 200.0, 1000.0  # of translation, where the paper takes its means
BOUND_LABEL = "Cramér–Rao bound"

# Okabe and Ito (2008), a palette for every kind of colour vision.
METHOD_COLOURS = {"MVT": "#D55E00", "RMVT": "#0072B2", "PF": "#009E73", "RBPF": "#CC79A7"}
OTHER_COLOURS = ("#E69F00", "#56B4E9", "#7F7F7F")
MARKERS = ("o", "s", "^", "D", "v", "P")

TRANSLATION_LABEL = "translation of the camera (m)"
ERROR_LABEL = "position error (m)"
RATIO_LABEL = "particles inside the target (ratio)"
TEXT_PT, TITLE_PT = 11, 12
THUMBNAIL_PX = 240


def error_figure(
    translation_m: FloatArray, errors_m: Mapping[str, FloatArray], title: str, bound_m: FloatArray | None = None
) -> Figure:
    """Error (T,) of each method against translation (T,) on a log axis; what is not finite leaves a gap."""
    figure = Figure(figsize=(8.0, 4.8), layout="constrained")
    axes = figure.subplots()
    _draw_errors(axes, translation_m, errors_m, bound_m)
    dress(axes, TRANSLATION_LABEL, ERROR_LABEL, title)
    log_y(axes)
    legend(figure, [axes])
    return figure


def errors_by_noise_figure(
    translation_m: FloatArray,
    errors_m: Mapping[str, Mapping[str, FloatArray]],
    bounds_m: Mapping[str, FloatArray],
) -> Figure:
    """One panel a noise row, side by side on the same axes; the light band is where means are taken.

    `errors_m` is by noise row and then by method; a row without a bound in `bounds_m` is drawn without.
    """
    if not errors_m:
        raise ValueError("errors_m must have at least one noise row, got none")
    figure = Figure(figsize=(1.2 + 2.7 * len(errors_m), 4.4), layout="constrained")
    panels = figure.subplots(1, len(errors_m), sharex=True, sharey=True, squeeze=False)[0]
    for axes, (row, by_method) in zip(panels, errors_m.items(), strict=True):
        axes.axvspan(MEAN_FROM_M, MEAN_TO_M, color="0.93", zorder=0)
        _draw_errors(axes, translation_m, by_method, bounds_m.get(row))
        dress(axes, "translation (m)", ERROR_LABEL if axes is panels[0] else "", _wrapped(row, 25))
    log_y(*panels)
    legend(figure, panels)
    return figure


def ratio_figure(translation_m: FloatArray, ratios: Mapping[str, FloatArray]) -> Figure:
    """Share of particles inside the target (T,) against translation (T,), one line a noise row."""
    figure = Figure(figsize=(8.0, 4.8), layout="constrained")
    axes = figure.subplots()
    shades = colormaps["viridis"](np.linspace(0.0, 0.9, max(len(ratios), 1)))
    for i, (row, ratio) in enumerate(ratios.items()):
        _draw_line(axes, translation_m, ratio, row, color=shades[i], linewidth=1.8)
    dress(axes, TRANSLATION_LABEL, RATIO_LABEL)
    _ratio_y(axes)
    legend(figure, [axes])
    return figure


def frame_strip(frames: Mapping[str, Sequence[MaskArray]], labels: Sequence[str]) -> Figure:
    """A row of thumbnails of masks (H, W) for each key, the columns headed by `labels`; positive is white."""
    counts = {row: len(masks) for row, masks in frames.items()}
    if not frames or not labels or set(counts.values()) != {len(labels)}:
        raise ValueError(f"every row must have one mask for each of the {len(labels)} labels, got {counts}")
    height, width = next(iter(frames.values()))[0].shape
    size_in = (1.4 + 1.45 * len(labels), 0.25 + len(frames) * (1.45 * height / width + 0.04))
    figure = Figure(figsize=size_in, layout=ConstrainedLayoutEngine(w_pad=0.02, h_pad=0.02, wspace=0.0, hspace=0.0))
    grid = figure.subplots(len(frames), len(labels), squeeze=False)
    for row_axes, (row, masks) in zip(grid, frames.items(), strict=True):
        for axes, mask in zip(row_axes, masks, strict=True):
            _draw_mask(axes, mask)
        row_axes[0].set_ylabel(
            _wrapped(row, 16), fontsize=TEXT_PT, rotation=0, horizontalalignment="right", verticalalignment="center"
        )
    for axes, label in zip(grid[0], labels, strict=True):
        axes.set_title(label, fontsize=TEXT_PT, pad=4)
    return figure


def sweep_figure(
    name: str,
    values: FloatArray,
    errors_m: Mapping[str, FloatArray],
    ratios: Mapping[str, FloatArray],
    bound_m: FloatArray | None = None,
    log_x: bool = False,
) -> Figure:
    """Mean error and ratio (K,) of each method against a parameter's values (K,); `name` carries its unit.

    Methods without a finite ratio are left out of the second panel, and the panel too where there is none.
    """
    if log_x and not np.all(np.asarray(values) > 0.0):
        raise ValueError(f"values on a log axis must be positive, got {values}")
    ratios = {method: ratio for method, ratio in ratios.items() if np.isfinite(ratio).any()}
    count = 2 if ratios else 1
    figure = Figure(figsize=(6.0 * count + 0.5, 4.6), layout="constrained")
    panels = figure.subplots(1, count, squeeze=False)[0]
    _draw_errors(panels[0], values, errors_m, bound_m, with_markers=True)
    dress(panels[0], name, "mean position error (m)")
    if ratios:
        _draw_methods(panels[1], values, ratios, _styles([*errors_m, *ratios]), with_markers=True)
        dress(panels[1], name, RATIO_LABEL)
        _ratio_y(panels[1])
    log_y(panels[0])
    for axes in panels if log_x else ():
        axes.set_xscale("log")
        _plain_log_ticks(axes.xaxis, float(np.min(values)), float(np.max(values)))
    legend(figure, panels)
    return figure


def png_from_figure(figure: Figure) -> bytes:
    """The figure as PNG at 150 dpi, without date or version, so that the same data gives the same bytes.

    The layout is frozen by the first call: solved anew from its own result it moves by a pixel.
    """
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=DPI, metadata={"Software": None})
    figure.set_layout_engine("none")
    return buffer.getvalue()


def _draw_errors(
    axes: Axes,
    x: FloatArray,
    errors_m: Mapping[str, FloatArray],
    bound_m: FloatArray | None,
    with_markers: bool = False,
) -> None:
    _draw_methods(axes, x, errors_m, _styles(errors_m), with_markers)
    if bound_m is not None:
        _draw_line(axes, x, bound_m, BOUND_LABEL, color="black", linestyle="--", linewidth=1.6)


def _draw_methods(
    axes: Axes,
    x: FloatArray,
    curves: Mapping[str, FloatArray],
    styles: Mapping[str, "_Style"],
    with_markers: bool,
) -> None:
    for method, curve in curves.items():
        style = styles[method]
        marker = {"marker": style.marker, "markersize": 4.0 + style.width_pt} if with_markers else {}
        _draw_line(axes, x, curve, method, color=style.colour, linewidth=style.width_pt, **marker)


def _draw_line(axes: Axes, x: FloatArray, y: FloatArray, label: str, **style: Any) -> None:
    """A line with gaps where it is not finite; the axis covers all of x, drawn or not."""
    x = np.asarray(x, dtype=np.float64)
    axes.update_datalim(np.column_stack([x, np.ones_like(x)]), updatey=False)
    axes.plot(x, _finite(y), label=label, **style)


@dataclass(frozen=True, slots=True)
class _Style:
    colour: str
    marker: str
    width_pt: float


def _styles(methods: Iterable[str]) -> dict[str, _Style]:
    """How each method is drawn; names that are not the study's own take turns in the order given.

    The first are wider, so that MVT still shows under an RMVT that agrees with it.
    """
    others = [method for method in dict.fromkeys(methods) if method not in METHOD_COLOURS]
    colours = METHOD_COLOURS | {name: OTHER_COLOURS[i % len(OTHER_COLOURS)] for i, name in enumerate(others)}
    return {
        name: _Style(colour, MARKERS[i % len(MARKERS)], max(2.8 - 0.7 * i, 1.5))
        for i, (name, colour) in enumerate(colours.items())
    }


def _draw_mask(axes: Axes, mask: MaskArray) -> None:
    """White on black, by area; the square root of a pixel's share keeps thin things in sight."""
    positive = np.where(np.asarray(mask) != 0, 255, 0).astype(np.uint8)
    step = max(1, round(positive.shape[1] / THUMBNAIL_PX))
    _grow_specks(positive, least_px=3 * step)
    size = (positive.shape[1] // step, positive.shape[0] // step)
    small = cv2.resize(positive, size, interpolation=cv2.INTER_AREA)
    axes.imshow(np.sqrt(small / 255.0), cmap="gray", vmin=0.0, vmax=1.0)
    axes.set_xticks([])
    axes.set_yticks([])
    for spine in axes.spines.values():
        spine.set(color="0.5", linewidth=0.6)


def _grow_specks(out: NDArray[np.uint8], least_px: int) -> None:
    """Make each segment that is smaller than `least_px` both ways a square of that size, in place."""
    for left, top, width, height, _ in np.asarray(cv2.connectedComponentsWithStats(out)[2])[1:]:
        if max(width, height) < least_px:
            x, y = (max(0, int(start + (size - least_px) // 2)) for start, size in ((left, width), (top, height)))
            out[y : y + least_px, x : x + least_px] = 255


def _finite(values: FloatArray) -> FloatArray:
    """The values with NaN, which is drawn as a gap, for what is not finite."""
    values = np.asarray(values, dtype=np.float64)
    return np.where(np.isfinite(values), values, np.nan)


def _wrapped(text: str, width: int) -> str:
    """A text too long for one line, broken before its parentheses first."""
    parts = [text] if len(text) <= width else text.replace(" (", "\n(").split("\n")
    return "\n".join(fill(part, width) for part in parts)


def dress(axes: Axes, x_label: str, y_label: str, title: str = "") -> None:
    axes.set_xlabel(x_label, fontsize=TEXT_PT)
    axes.set_ylabel(y_label, fontsize=TEXT_PT)
    axes.set_title(title, fontsize=TITLE_PT)
    axes.tick_params(labelsize=TEXT_PT - 1)
    axes.grid(True, color="0.85", linewidth=0.6)
    axes.spines[["top", "right"]].set_visible(False)


def log_x(axes: Axes) -> None:
    """A log axis, as `log_y`."""
    low, high = _log_limits(line.get_xdata() for line in axes.lines)
    axes.set_xlim(low, high)
    axes.set_xscale("log", nonpositive="mask")
    _plain_log_ticks(axes.xaxis, low, high)


def log_y(*panels: Axes) -> None:
    """One log axis for all; its limits are set from the values, for without any matplotlib has none to find."""
    low, high = _log_limits(line.get_ydata() for axes in panels for line in axes.lines)
    for axes in panels:
        axes.set_ylim(low, high)  # first: a log scale warns where it finds no limits itself
        axes.set_yscale("log", nonpositive="mask")
        _plain_log_ticks(axes.yaxis, low, high)


def _log_limits(curves: Iterable[Any]) -> tuple[float, float]:
    """About all positive values, wide enough for two ticks; 1 to 1000, widened so too, where there are none."""
    positive = [float(value) for curve in curves for value in curve if 0.0 < value < np.inf]
    low, high = (min(positive), max(positive)) if positive else (1.0, 1000.0)
    middle, reach = np.sqrt(low * high), max(1.25 * np.sqrt(high / low), 2.5)
    return float(middle / reach), float(middle * reach)


def _plain_log_ticks(axis: Axis, low: float, high: float) -> None:
    """Ticks as 10, 100, 1,000; also at 2 and 5 where few decades are shown."""
    axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if high < 100.0 * low else (1.0,)))
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:,.0f}" if value >= 1.0 else f"{value:g}"))
    axis.set_minor_formatter(NullFormatter())


def _ratio_y(axes: Axes) -> None:
    """From none to just over the largest, and at most to all."""
    ratios = [float(value) for line in axes.lines for value in np.asarray(line.get_ydata()) if np.isfinite(value)]
    top = min(1.02, 1.15 * max([*ratios, 0.05]))
    axes.set_ylim(-0.02 * top, top)


def legend(figure: Figure, panels: Iterable[Axes]) -> None:
    """One legend under all panels, each label once."""
    entries = {}
    for axes in panels:
        handles, labels = axes.get_legend_handles_labels()
        entries.update({label: handle for label, handle in zip(labels, handles, strict=True) if label not in entries})
    widths_in = [0.7 + 0.09 * len(label) for label in entries]
    is_one_row = sum(widths_in) <= figure.get_figwidth()
    columns = len(entries) if is_one_row else max(1, int(figure.get_figwidth() / max(widths_in)))
    if entries:
        figure.legend(
            entries.values(), entries.keys(), loc="outside lower center", ncols=columns, fontsize=TEXT_PT, frameon=False
        )
