"""From a model's output to the smoke's probability in the mask's pixels: scores of pixels, or boxes filled in."""

import math
from collections.abc import Mapping
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from service.segmenters.model_card import ModelCard
from service.segmenters.model_input import Axis, Placement
from service.segmenters.model_session import ModelError

Scores = NDArray[np.float32]

_MOST_BOXES = 300  # of the strongest, as exporters' own suppression has it
# Boxes of which none reaches further are shares of the input's sides: as pixels they would all lie in its corner. The
# boxes of a whole table, a network's guesses from everywhere, may reach well out of the input.
_MOST_SHARE = {"yolov8": 4.0, "yolov5": 4.0, "end-to-end": 1.5}
_MAX_IOU = 0.1  # boxes that overlap more are one thing: in a mask they would run together, centred on neither


@dataclass(frozen=True, slots=True)
class Output:
    """What a model gives for one window: scores or a table of boxes and, beside these, its masks' prototypes."""

    first: Scores
    prototypes: Scores | None = None  # (1, K, h, w): a box's mask is where K coefficients of its row weigh them above 0


@dataclass(frozen=True, slots=True)
class Span:
    """The mask's pixels that a window covers along an axis; pixel i's centre is at slope * i + offset in the input."""

    first: int
    count: int
    slope: float
    offset: float

    @property
    def slice(self) -> slice:
        """Of the mask's rows or columns."""
        return slice(self.first, self.first + self.count)


def span(axis: Axis, mask_side: int) -> Span:
    """The pixels of a mask of `mask_side` whose centres lie in the window; at least one."""
    step = axis.frame / mask_side  # the frame's pixels to one of the mask's
    first = min(mask_side - 1, max(0, math.ceil(axis.start / step - 0.5)))
    end = min(mask_side, math.ceil((axis.start + axis.length) / step - 0.5))
    scale = axis.inner / axis.length
    offset = ((first + 0.5) * step - axis.start) * scale + axis.margin
    return Span(first, max(1, end - first), step * scale, offset)


def add_probability(total: Scores, output: Output, card: ModelCard, place: Placement, threshold: float) -> None:
    """Raise `total` (h, w), the mask's probability, to what the output of one window says; it is written into.

    Raises ModelError for an output of a wrong shape or with numbers that are none.
    """
    first, prototypes = output.first, output.prototypes
    if not np.isfinite(first).all() or (prototypes is not None and not np.isfinite(prototypes).all()):
        raise ModelError("the output has numbers that are not finite")
    down, across = span(place.down, total.shape[0]), span(place.across, total.shape[1])
    part = total[down.slice, across.slice]
    if card.output != "boxes":
        np.maximum(part, _resampled(smoke_scores(first, card), place, across, down), out=part)
        return
    count = 0 if prototypes is None else _coefficients(first, prototypes, card)
    found = _kept(boxes(first, card, place, count), threshold)
    if prototypes is None or not count:
        fill_boxes(part, found, across, down)
    else:
        fill_masks(part, found, prototypes[0], place, (across, down))


def smoke_scores(output: Scores, card: ModelCard) -> Scores:
    """The smoke's probability (h, w) from (1, C, h, w), (1, h, w, C), (1, h, w) or (h, w); C is 1 or the classes'."""
    if output.ndim == 4 and output.shape[0] == 1:
        scores = output[0] if card.is_output_nchw else output[0].transpose(2, 0, 1)
    else:
        scores = output[None] if output.ndim == 2 else output
    if scores.ndim != 3 or scores.size == 0 or scores.shape[0] not in (1, len(card.classes)):
        raise ModelError(f"its output is {_sides(output)}: not 1 or {len(card.classes)} channels of scores")
    if card.output == "probability":
        return np.asarray(scores[0 if scores.shape[0] == 1 else card.smoke_index])
    if scores.shape[0] == 1:
        return np.asarray(1.0 / (1.0 + np.exp(-np.clip(scores[0], -60.0, 60.0))), dtype=np.float32)
    powers = np.exp(scores - scores.max(axis=0))
    return np.asarray(powers[card.smoke_index] / powers.sum(axis=0), dtype=np.float32)


def boxes(output: Scores, card: ModelCard, place: Placement, coefficients: int = 0) -> Scores:
    """(n, 5 + K): left, top, right, bottom in the input's pixels, the smoke's score, the mask's K coefficients.

    yolov8 (and 11): (1, 4 + C + K, n) or (1, n, 4 + C + K), centre, size, a score a class; yolov5: (1, n, 5 + C + K),
    with how sure it is of any object before the classes; end-to-end: (1, n, 6 + K), corners, score and class.
    """
    if output.ndim != 3 or output.shape[0] != 1:
        raise ModelError(f"its output is {_sides(output)}: not one table of boxes")
    table = output[0]
    widths = {kind: width + coefficients for kind, width in _widths(card).items()}
    kind = card.boxes or _box_kind(table, widths, card)
    rows = table.T if kind == "yolov8" and table.shape[0] == widths[kind] else table
    if rows.shape[1] != widths[kind]:
        raise ModelError(f"its output is {_sides(output)}: {kind} with {len(card.classes)} classes has {widths[kind]}")
    if rows[:, :4].any() and np.abs(rows[:, :4]).max() <= _MOST_SHARE[kind]:
        sides = np.array([place.across.side, place.down.side] * 2, np.float32)
        rows = np.column_stack([rows[:, :4] * sides, rows[:, 4:]])
    if kind == "end-to-end":
        return np.asarray(np.delete(rows[np.rint(rows[:, 5]) == card.smoke_index], 5, axis=1))
    score = rows[:, 4 + card.smoke_index] if kind == "yolov8" else rows[:, 4] * rows[:, 5 + card.smoke_index]
    half = rows[:, 2:4] / 2.0
    return np.column_stack([rows[:, :2] - half, rows[:, :2] + half, score, rows[:, widths[kind] - coefficients :]])


def fill_boxes(part: Scores, found: Scores, across: Span, down: Span) -> None:
    """Raise `part` (h, w), which is written into, to each box's score inside it; one outside the window adds none."""
    for left, top, right, bottom, score in found[:, :5]:
        columns = _covered(across, float(left), float(right))
        rows = _covered(down, float(top), float(bottom))
        np.maximum(part[rows, columns], score, out=part[rows, columns])


def fill_masks(part: Scores, found: Scores, prototypes: Scores, place: Placement, spans: tuple[Span, Span]) -> None:
    """Raise `part` (h, w), which is written into, to each box's score where its mask is; `spans` across and down."""
    across, down = spans
    for one in found:
        columns = _covered(across, float(one[0]), float(one[2]))
        rows = _covered(down, float(one[1]), float(one[3]))
        weighed = _resampled(np.tensordot(one[5:], prototypes, 1), place, across, down)[rows, columns]
        np.maximum(part[rows, columns], np.where(weighed > 0.0, one[4], 0.0), out=part[rows, columns])


def _widths(card: ModelCard) -> dict[str, int]:
    """The numbers of a box, without a mask's coefficients."""
    count = len(card.classes)
    return {"yolov8": 4 + count, "yolov5": 5 + count, "end-to-end": 6}


def _coefficients(table: Scores, prototypes: Scores, card: ModelCard) -> int:
    """How many a box has for its mask: as many as there are prototypes, or none."""
    if prototypes.ndim != 4 or prototypes.shape[0] != 1 or prototypes.size == 0:
        raise ModelError(f"its second output is {_sides(prototypes)}: not one set of masks' prototypes")
    count = int(prototypes.shape[1])
    return count if any(width + count in table.shape[1:] for width in _widths(card).values()) else 0


def _box_kind(table: Scores, widths: Mapping[str, int], card: ModelCard) -> str:
    fits = ["yolov8"] if widths["yolov8"] in table.shape else []
    fits += [kind for kind in ("yolov5", "end-to-end") if table.shape[1] == widths[kind]]
    if table.shape[0] == widths["yolov8"]:
        fits = ["yolov8"]
    if len(fits) != 1:
        none = f"no boxes of {len(card.classes)} classes: export a model that detects, or segments"
        may = f"may be {' or '.join(fits)}: say which by the key boxes" if fits else none
        raise ModelError(f"its output is 1 x {_sides(table)}: {may}")
    return fits[0]


def _kept(found: Scores, threshold: float) -> Scores:
    """Those above the threshold, without the weaker ones of the same thing."""
    strong: Scores = found[found[:, 4] > threshold]
    if not len(strong):
        return strong
    corners_and_sizes = np.column_stack([strong[:, :2], strong[:, 2:4] - strong[:, :2]]).tolist()
    kept = np.asarray(cv2.dnn.NMSBoxes(corners_and_sizes, strong[:, 4].tolist(), threshold, _MAX_IOU), dtype=int)
    return np.asarray(strong[kept.ravel()[:_MOST_BOXES]])


def _covered(along: Span, low: float, high: float) -> slice:
    """The span's pixels whose centres lie between two places in the input; the nearest one where there is none."""
    if high <= along.offset - 0.5 * along.slope or low >= along.offset + (along.count - 0.5) * along.slope:
        return slice(0, 0)
    first = math.ceil((low - along.offset) / along.slope)
    end = math.ceil((high - along.offset) / along.slope)
    if end <= first:
        first = round(((low + high) / 2.0 - along.offset) / along.slope)
        end = first + 1
    return slice(max(0, first), max(0, min(along.count, end)))


def _resampled(scores: Scores, place: Placement, across: Span, down: Span) -> Scores:
    """The scores, which cover the whole input however coarsely, at the mask's pixels."""
    x, y = scores.shape[1] / place.across.side, scores.shape[0] / place.down.side
    matrix = np.array([[across.slope * x, 0.0, across.offset * x - 0.5], [0.0, down.slope * y, down.offset * y - 0.5]])
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    size = (across.count, down.count)
    resampled = cv2.warpAffine(np.ascontiguousarray(scores), matrix, size, flags=flags, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(resampled, dtype=np.float32)


def _sides(array: Scores) -> str:
    return " x ".join(map(str, array.shape))
