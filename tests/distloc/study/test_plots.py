"""The study's pictures, read back from their axes and their bytes."""

from collections.abc import Callable

import cv2
import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.colors import to_hex
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from distloc.study.plots import (
    BOUND_LABEL,
    error_figure,
    errors_by_noise_figure,
    frame_strip,
    log_x,
    png_from_figure,
    ratio_figure,
    sweep_figure,
)
from distloc.types import FloatArray

T = np.linspace(0.0, 1000.0, 101)
NAN = np.full(T.size, np.nan)
ERRORS = {"MVT": 50.0 + T, "RMVT": 20.0 + T / 50.0, "PF": 80.0 - T / 20.0}
BOUND = np.concatenate([[np.inf], 7000.0 / T[1:]])
ROWS = ["none", "pose (0.5°, 0.1 m)", "+ partial false negatives (0.1, 0.2)"]
VALUES = np.array([0.1, 0.5, 1.0])
SWEPT = {"MVT": np.array([10.0, 50.0, 400.0]), "PF": np.array([40.0, 41.0, 45.0])}


def lines(axes: Axes) -> dict[str, Line2D]:
    return {str(line.get_label()): line for line in axes.lines}


def drawn(axes: Axes) -> dict[str, FloatArray]:
    return {label: np.asarray(line.get_ydata()) for label, line in lines(axes).items()}


def legend_labels(figure: Figure) -> list[str]:
    return [text.get_text() for legend in figure.legends for text in legend.get_texts()]


def decoded(png: bytes) -> FloatArray:
    image = cv2.imdecode(np.frombuffer(png, dtype=np.uint8), cv2.IMREAD_GRAYSCALE)
    assert image is not None
    return image.astype(np.float64)


def square_mask(side: int) -> np.ndarray:
    mask = np.zeros((1080, 1920), dtype=np.uint8)
    mask[500 : 500 + side, 900 : 900 + side] = 255
    return mask


FIGURES: dict[str, Callable[[], Figure]] = {
    "error": lambda: error_figure(T, ERRORS, "pose", BOUND),
    "noise": lambda: errors_by_noise_figure(T, dict.fromkeys(ROWS, ERRORS), {ROWS[1]: BOUND}),
    "ratio": lambda: ratio_figure(T, {row: T / 8000.0 for row in ROWS}),
    "strip": lambda: frame_strip({"none": [square_mask(60), square_mask(0)]}, ["0 m", "500 m"]),
    "sweep": lambda: sweep_figure("rotation noise (deg)", VALUES, SWEPT, {"PF": VALUES / 9.0}, VALUES, log_x=True),
}
EMPTY: dict[str, Callable[[], Figure]] = {
    "error": lambda: error_figure(T, {"MVT": NAN, "PF": NAN}, "nothing", np.full(T.size, np.inf)),
    "no methods": lambda: error_figure(T, {}, "nothing"),
    "noise": lambda: errors_by_noise_figure(T, {"none": {"PF": NAN}, "pose": {"PF": NAN}}, {"none": NAN}),
    "ratio": lambda: ratio_figure(T, {"none": NAN}),
    "no rows": lambda: ratio_figure(T, {}),
    "zero error": lambda: error_figure(T, {"PF": np.zeros(T.size)}, "exact"),
    "sweep": lambda: sweep_figure("x (m)", VALUES, {"PF": NAN[:3]}, {"PF": NAN[:3]}, NAN[:3], log_x=True),
    "log x": lambda: log_x_figure(NAN),
}


def log_x_figure(x: FloatArray) -> Figure:
    figure = Figure()
    axes = figure.subplots()
    axes.plot(x, np.zeros(x.size), "o")
    log_x(axes)
    return figure


def test_error_figure_draws_its_data() -> None:
    (axes,) = error_figure(T, ERRORS, "pose", BOUND).axes
    assert axes.get_yscale() == "log" and axes.get_title() == "pose"
    assert axes.get_xlabel().endswith("(m)") and axes.get_ylabel().endswith("(m)")
    for method, errors in ERRORS.items():
        np.testing.assert_array_equal(lines(axes)[method].get_xdata(), T)
        np.testing.assert_array_equal(drawn(axes)[method], errors)
    np.testing.assert_array_equal(drawn(axes)[BOUND_LABEL], np.where(np.isfinite(BOUND), BOUND, np.nan))
    bound = lines(axes)[BOUND_LABEL]
    assert (bound.get_color(), bound.get_linestyle(), BOUND_LABEL) == ("black", "--", "Cramér–Rao bound")


def test_every_value_lies_within_the_axes() -> None:
    (axes,) = error_figure(T, ERRORS, "pose", BOUND).axes
    low, high = axes.get_ylim()
    assert low < 7.0 and high > 1050.0
    assert axes.get_xlim()[0] <= 0.0 and axes.get_xlim()[1] >= 1000.0


def test_a_log_axis_along_x_holds_its_values() -> None:
    (axes,) = log_x_figure(np.array([np.nan, 0.0, 0.05, 30.0, np.inf])).axes
    low, high = axes.get_xlim()
    assert axes.get_xscale() == "log" and 0.0 < low < 0.05 and 30.0 < high < 1000.0


def test_gaps_stay_gaps() -> None:
    errors = ERRORS["PF"].copy()
    errors[20:40] = np.nan
    errors[0] = np.inf
    figure = error_figure(T, {"PF": errors}, "gaps")
    expected_gaps = [0, *range(20, 40)]
    assert np.flatnonzero(np.isnan(drawn(figure.axes[0])["PF"])).tolist() == expected_gaps
    assert np.isnan(errors[20]) and np.isinf(errors[0])
    png_from_figure(figure)


def test_noise_rows_share_axes_and_one_legend() -> None:
    by_row = {row: {method: errors * (i + 1) for method, errors in ERRORS.items()} for i, row in enumerate(ROWS)}
    figure = errors_by_noise_figure(T, by_row, {ROWS[1]: BOUND})
    assert [axes.get_title().replace("\n", " ") for axes in figure.axes] == ROWS
    assert len({axes.get_ylim() for axes in figure.axes}) == len({axes.get_xlim() for axes in figure.axes}) == 1
    for axes, row in zip(figure.axes, ROWS, strict=True):
        assert axes.get_yscale() == "log"
        assert (BOUND_LABEL in drawn(axes)) == (row == ROWS[1])
        for method, errors in by_row[row].items():
            np.testing.assert_array_equal(drawn(axes)[method], errors)
        (band,) = axes.patches
        left, right = axes.transData.inverted().transform(band.get_extents().get_points())[:, 0]
        assert (left, right) == pytest.approx((200.0, 1000.0))
    assert sorted(legend_labels(figure)) == sorted([*ERRORS, BOUND_LABEL])


def test_ratio_figure_draws_its_data() -> None:
    ratios = {row: T / 8000.0 * (i + 1) for i, row in enumerate(ROWS)}
    figure = ratio_figure(T, ratios)
    (axes,) = figure.axes
    for row, ratio in ratios.items():
        np.testing.assert_array_equal(drawn(axes)[row], ratio)
    assert len({to_hex(line.get_color()) for line in axes.lines}) == len(ROWS)
    assert legend_labels(figure) == ROWS and axes.get_yscale() == "linear"


def test_sweep_draws_errors_and_ratios() -> None:
    ratios = {"PF": VALUES / 9.0, "MVT": NAN[:3]}
    left, right = sweep_figure("rotation noise (deg)", VALUES, SWEPT, ratios, 5.0 * VALUES, log_x=True).axes
    assert left.get_yscale() == "log" and left.get_xscale() == right.get_xscale() == "log"
    assert left.get_xlabel() == right.get_xlabel() == "rotation noise (deg)"
    for label, values in (SWEPT | {BOUND_LABEL: 5.0 * VALUES}).items():
        np.testing.assert_array_equal(drawn(left)[label], values)
    assert list(drawn(right)) == ["PF"]
    np.testing.assert_array_equal(drawn(right)["PF"], ratios["PF"])
    assert lines(left)["PF"].get_color() == lines(right)["PF"].get_color()


@pytest.mark.parametrize("ratios", [{}, {"PF": NAN[:3]}], ids=["none", "none finite"])
def test_sweep_without_ratios_has_one_panel(ratios: dict[str, FloatArray]) -> None:
    (axes,) = sweep_figure("particles", VALUES, SWEPT, ratios).axes
    assert axes.get_xscale() == "linear"


def test_a_method_has_one_colour_everywhere() -> None:
    (full,) = error_figure(T, ERRORS | {"RBPF": T + 1.0, "x": T + 2.0, "y": T + 3.0}, "all").axes
    (alone,) = error_figure(T, {"RBPF": T + 1.0, "PF": T + 1.0}, "two").axes
    colours = {label: to_hex(line.get_color()) for label, line in lines(full).items()}
    assert len(set(colours.values())) == 6
    assert {label: to_hex(line.get_color()) for label, line in lines(alone).items()}.items() <= colours.items()


@pytest.mark.parametrize("side_px", [1, 3, 60])
def test_small_targets_stay_in_sight(side_px: int) -> None:
    mask = square_mask(side_px)
    (axes,) = frame_strip({"none": [mask]}, ["0 m"]).axes
    shown = np.asarray(axes.images[0].get_array())
    assert shown.max() == pytest.approx(1.0)
    rows, columns = np.nonzero(shown > 0.5)
    scale = mask.shape[1] / shown.shape[1]
    assert (columns.mean() + 0.5) * scale == pytest.approx(900 + side_px / 2, abs=scale)
    assert (rows.mean() + 0.5) * scale == pytest.approx(500 + side_px / 2, abs=scale)
    assert len(rows) <= max(16, (side_px / scale + 2) ** 2)
    assert np.count_nonzero(mask) == side_px**2


def test_a_hole_in_a_target_stays_a_hole() -> None:
    mask = square_mask(80)
    mask[524:556, 924:956] = 0
    shown = np.asarray(frame_strip({"none": [mask]}, ["0 m"]).axes[0].images[0].get_array())
    assert shown[540 * shown.shape[0] // 1080, 940 * shown.shape[1] // 1920] == 0.0


def test_strip_names_its_rows_and_columns() -> None:
    frames = {"none": [square_mask(60)] * 3, "pose": [square_mask(0)] * 3}
    axes = frame_strip(frames, ["0 m", "125 m", "250 m"]).axes
    assert [a.get_title() for a in axes] == ["0 m", "125 m", "250 m", "", "", ""]
    assert [a.get_ylabel() for a in axes] == ["none", "", "", "pose", "", ""]
    assert all(len(a.get_xticks()) == len(a.get_yticks()) == 0 for a in axes)


def test_broken_contracts_are_named() -> None:
    with pytest.raises(ValueError, match="labels"):
        frame_strip({"none": [square_mask(1)]}, ["0 m", "125 m"])
    with pytest.raises(ValueError, match="one mask"):
        frame_strip({}, ["0 m"])
    with pytest.raises(ValueError, match="noise row"):
        errors_by_noise_figure(T, {}, {})
    with pytest.raises(ValueError, match="positive"):
        sweep_figure("noise (deg)", np.array([0.0, 1.0]), {"PF": np.ones(2)}, {}, log_x=True)


@pytest.mark.parametrize("make", EMPTY.values(), ids=EMPTY.keys())
def test_nothing_to_draw_is_no_error(make: Callable[[], Figure]) -> None:
    assert decoded(png_from_figure(make())).size > 0


@pytest.mark.parametrize("make", FIGURES.values(), ids=FIGURES.keys())
def test_png_is_reproducible_and_decodes(make: Callable[[], Figure]) -> None:
    figure = make()
    png = png_from_figure(figure)
    assert png == png_from_figure(make()) == png_from_figure(figure)
    image = decoded(png)
    height, width = image.shape
    assert (width, height) == pytest.approx(150.0 * figure.get_size_inches(), abs=1.0)
    assert image.min() < 100.0 and image.max() == 255.0
    assert b"Software" not in png and b"matplotlib" not in png


@pytest.mark.parametrize("make", FIGURES.values(), ids=FIGURES.keys())
def test_legends_lie_within_the_picture_and_off_the_panels(make: Callable[[], Figure]) -> None:
    figure = make()
    png_from_figure(figure)
    for legend in figure.legends:
        box = legend.get_window_extent()
        assert box.x0 >= 0.0 and box.y0 >= 0.0 and box.x1 <= figure.bbox.x1
        assert all(box.y1 <= axes.get_tightbbox().y0 + 1.0 for axes in figure.axes)
