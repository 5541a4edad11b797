"""From a frame to a model's input: which windows of it are run, how each is resized, and its numbers."""

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from service.segmenters.model_card import ModelCard

_WHOLE = 0.01
_LEAST_UINT8_SPAN = 64.0  # of the 255 that there are
_SPANS = 0.1, 600.0  # between black and white; 0 to 255 over a std of 0.5 is the largest that is meant
_PAD = 114  # the grey that YOLO's letterbox is trained with


@dataclass(frozen=True, slots=True)
class Axis:
    """Across or down: a window of the frame and where it lies in the model's input, all in pixels."""

    frame: int  # the frame's side
    start: int  # of the window in the frame
    length: int
    margin: int  # before the window in the input
    inner: int  # the window's length in the input
    side: int  # the input's


@dataclass(frozen=True, slots=True)
class Placement:
    """A window of the frame in the model's input."""

    across: Axis
    down: Axis


def placements(card: ModelCard, width: int, height: int, tiles: int, overlap: float) -> list[Placement]:
    """The whole frame of width x height and, with `tiles`, as many rows and columns of it."""
    columns, rows = (_windows(side, tiles, overlap) for side in (width, height))
    windows = [((0, width), (0, height)), *((column, row) for row in rows for column in columns)]
    return [_placed(card, (width, height), across, down) for across, down in windows]


def levels(card: ModelCard) -> NDArray[np.float32]:
    """(1, 256, 3): what each of a pixel's levels becomes, in the model's colour order."""
    values = np.arange(256, dtype=np.float64)[:, None] * card.scale
    return ((values - card.mean) / card.std)[None].astype(np.float32)


def levels_fault(table: NDArray[np.float32], card: ModelCard, is_uint8: bool) -> str:
    """What is wrong with the numbers that a frame becomes; empty: an input of that type can hold them.

    A float input takes 0 to 1, -1 to 1, about -2 to 3 or 0 to 255: a span beside these is a scale that was left out or
    given twice.
    """
    said = f"scale {card.scale:g}, mean {_shown(card.mean)}, std {_shown(card.std)}"
    low, high = float(table.min()), float(table.max())
    if is_uint8:
        is_whole = np.abs(table - np.round(table)).max() < _WHOLE
        if not is_whole or low < 0.0 or high > 255.0 or (np.ptp(table, axis=1) < _LEAST_UINT8_SPAN).any():
            return (
                f"its input is uint8, and {said} make {low:.3g} to {high:.3g} of a pixel, which would be cut to whole "
                "numbers of 0 to 255: scale = 1, mean = 0 and std = 1 leave pixels as they are"
            )
        return ""
    spans = np.ptp(table, axis=1)
    if not np.isfinite(table).all() or spans.min() < _SPANS[0] or spans.max() > _SPANS[1]:
        return (
            f"{said} make {low:.3g} to {high:.3g} of a pixel, which no network takes: mean and std are of pixels after "
            "the scale: scale = 1 goes with 0 to 255, scale = 0.00392157 (1/255) with 0 to 1"
        )
    return ""


def _shown(values: NDArray[np.float32]) -> str:
    return ", ".join(f"{value:g}" for value in sorted(set(values.tolist())))


def prepared(
    image: NDArray[np.uint8], place: Placement, card: ModelCard, level_table: NDArray[np.float32]
) -> NDArray[np.float32]:
    """The input (1, 3, H, W) or (1, H, W, 3) from a BGR image (h, w, 3)."""
    across, down = place.across, place.down
    window = image[down.start : down.start + down.length, across.start : across.start + across.length]
    shrinks = across.inner < across.length
    small = cv2.resize(
        window, (across.inner, down.inner), interpolation=cv2.INTER_AREA if shrinks else cv2.INTER_LINEAR
    )
    if (across.inner, down.inner) != (across.side, down.side):
        framed = np.full((down.side, across.side, 3), _PAD, np.uint8)
        framed[down.margin : down.margin + down.inner, across.margin : across.margin + across.inner] = small
        small = framed
    ordered = cv2.cvtColor(small, cv2.COLOR_BGR2RGB) if card.is_rgb else small
    values = cv2.LUT(ordered, level_table)
    return np.ascontiguousarray((values.transpose(2, 0, 1) if card.is_nchw else values)[None], dtype=np.float32)


def _windows(side: int, tiles: int, overlap: float) -> list[tuple[int, int]]:
    """(start, length) of tiles along a side: of one length, from edge to edge, each sharing `overlap` of it."""
    if not tiles:
        return []
    length = min(side, math.ceil(side / (tiles - (tiles - 1) * overlap)))
    return [(round(start), length) for start in np.linspace(0.0, side - length, tiles)]


def _placed(card: ModelCard, frame: tuple[int, int], across: tuple[int, int], down: tuple[int, int]) -> Placement:
    inner = {"stretch": _stretched, "letterbox": _letterboxed, "budget": _budgeted}[card.resize](
        card, across[1], down[1]
    )
    sides = inner if card.resize == "budget" else (card.width, card.height)
    return Placement(
        _axis(frame[0], across, inner[0], sides[0]),
        _axis(frame[1], down, inner[1], sides[1]),
    )


def _axis(frame: int, window: tuple[int, int], inner: int, side: int) -> Axis:
    margin = round((side - inner) / 2.0 - 0.1)  # an odd pixel of padding goes behind, as YOLO has it
    return Axis(frame, *window, margin, inner, side)


def _stretched(card: ModelCard, width: int, height: int) -> tuple[int, int]:
    return card.width, card.height


def _letterboxed(card: ModelCard, width: int, height: int) -> tuple[int, int]:
    factor = min(card.width / width, card.height / height)
    return max(1, round(width * factor)), max(1, round(height * factor))


def _budgeted(card: ModelCard, width: int, height: int) -> tuple[int, int]:
    """The window's aspect at about the card's number of pixels, never enlarged, in whole multiples."""
    factor = min(1.0, math.sqrt(card.width * card.height / (width * height)))
    return _multiple(width, factor, card.multiple), _multiple(height, factor, card.multiple)


def _multiple(side: int, factor: float, multiple: int) -> int:
    return max(1, min(round(side * factor / multiple), side // multiple)) * multiple
