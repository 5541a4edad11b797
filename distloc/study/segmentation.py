"""How well a segmenter finds smoke: the scores of one image, and the summary of many; the segmentation study calls it.

Pixels are the camera's full-size ones, their centres at whole numbers.
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from distloc.geometry.camera import Camera
from distloc.sights.detections import MAX_DETECTIONS, MIN_AREA_PX, checked_mask, detections_from_mask, joined
from distloc.types import BoolArray, FloatArray, MaskArray, RejectReason

_NEAR_PX, _NEAR_WIDTH_PX = 10.0, 512  # so far beside the truth is found too, in an image of that width
_NAN = float("nan")


@dataclass(frozen=True, slots=True)
class Truth:
    """Where an image's smoke is: `region` (H, W), never empty, and its centres (N, 2) as (u, v).

    A mask has one centre, that of its area; boxes have one each, and a region that says nothing of single pixels.
    """

    region: BoolArray
    centres_px: FloatArray
    is_mask: bool


@dataclass(frozen=True, slots=True)
class ImageScore:
    """One image's scores; NaN where there is nothing to score.

    `iou`, `precision` and `recall` are of pixels and need a truth of pixels, and so does the base's error. The errors
    are those of the segment nearest to the truth's centre among those that lie on it: NaN where none does.
    """

    is_smoke: bool
    is_found: bool
    iou: float
    precision: float
    recall: float
    centroid_error_px: float
    base_error_px: float
    false_segments: int
    rejected: RejectReason | None


@dataclass(frozen=True, slots=True)
class Summary:
    """Of many images: counts, shares, means, medians; NaN where there is nothing to average.

    `found_share`, `iou_mean`, `precision`, `recall` and the errors are of the images with smoke. A missed plume is 0 in
    `iou_mean` and `recall`; an empty mask has no precision.
    """

    smoke_images: int
    found_share: float
    iou_mean: float
    precision: float
    recall: float
    centroid_error_px_median: float
    base_error_px_median: float
    false_per_smoke_image: float
    negative_images: int
    false_per_negative: float
    ms_median: float
    rejected: dict[str, int]


def truth_from_mask(smoke: BoolArray) -> Truth | None:
    """The truth of a mask (H, W); None where it is empty."""
    rows, columns = np.nonzero(smoke)
    if rows.size == 0:
        return None
    return Truth(smoke, np.array([[columns.mean(), rows.mean()]]), is_mask=True)


def truth_from_boxes(boxes: FloatArray, width: int, height: int) -> Truth | None:
    """The truth of boxes (N, 4), each cx, cy, w, h as shares of the image's size; None where N is 0.

    Raises ValueError for a centre outside the image or a box without size.
    """
    if boxes.size == 0:
        return None
    cx, cy, across, up = boxes.T
    is_inside = ((boxes[:, :2] >= 0.0) & (boxes[:, :2] <= 1.0)).all()
    if not (np.isfinite(boxes).all() and is_inside and (boxes[:, 2:] > 0.0).all()):
        raise ValueError(f"a box must have its centre from 0 to 1 and a size above 0, got {boxes.tolist()}")
    region = np.zeros((height, width), np.bool_)
    for left, top, right, bottom in np.stack([cx - across / 2, cy - up / 2, cx + across / 2, cy + up / 2], axis=1):
        region[_covered(top, bottom, height), _covered(left, right, width)] = True
    return Truth(region, np.stack([cx * width - 0.5, cy * height - 0.5], axis=1), is_mask=False)


def score_image(mask: MaskArray | RejectReason, truth: Truth | None, camera: Camera) -> ImageScore:
    """Scores of a segmenter's mask, or of its refusal, which counts as no segments; `truth` is None without smoke."""
    if isinstance(mask, RejectReason):
        empty = np.zeros((camera.height, camera.width), np.uint8)
        return _scored(empty, truth, camera, mask)
    return _scored(mask, truth, camera, None)


def summarised(scores: Sequence[ImageScore], durations_ms: Sequence[float]) -> Summary:
    """Of the images of a folder or of all of them, and how long the segmenter took for each."""
    smoke = [one for one in scores if one.is_smoke]
    negative = [one for one in scores if not one.is_smoke]
    return Summary(
        smoke_images=len(smoke),
        found_share=_mean([float(one.is_found) for one in smoke]),
        iou_mean=_mean([one.iou for one in smoke]),
        precision=_mean([one.precision for one in smoke]),
        recall=_mean([one.recall for one in smoke]),
        centroid_error_px_median=_median([one.centroid_error_px for one in smoke]),
        base_error_px_median=_median([one.base_error_px for one in smoke]),
        false_per_smoke_image=_mean([float(one.false_segments) for one in smoke]),
        negative_images=len(negative),
        false_per_negative=_mean([float(one.false_segments) for one in negative]),
        ms_median=_median(durations_ms),
        rejected=dict(Counter(str(one.rejected) for one in scores if one.rejected is not None)),
    )


def share_error(found: Sequence[Sequence[bool]]) -> float:
    """The standard error of the share found over all frames, where only fires are independent; NaN for fewer than two.

    `found` has a list for each fire.
    """
    counts = np.array([(sum(one), len(one)) for one in found if one], np.float64)
    if len(counts) < 2:
        return float("nan")
    share = counts[:, 0].sum() / counts[:, 1].sum()
    residuals = counts[:, 0] - share * counts[:, 1]
    return float(np.sqrt(len(counts) / (len(counts) - 1) * np.square(residuals).sum()) / counts[:, 1].sum())


def rank(score: ImageScore) -> tuple[float, ...]:
    """A key that sorts images from best to worst: smoke first, by what was found of it, then those without."""
    false_and_refused = float(score.false_segments), float(score.rejected is not None)
    if not score.is_smoke:
        return 1.0, *false_and_refused
    overlap, error_px = np.nan_to_num([score.iou, score.centroid_error_px])
    return 0.0, float(not score.is_found), -float(overlap), float(error_px), *false_and_refused


def _scored(mask: MaskArray, truth: Truth | None, camera: Camera, rejected: RejectReason | None) -> ImageScore:
    labels, centroids_px = _segments(mask, camera)
    on_truth = np.array([truth is not None and is_near(truth, point, camera) for point in centroids_px], np.bool_)
    seen = np.flatnonzero(on_truth[:MAX_DETECTIONS])  # a tracker gets no more
    iou, precision, recall = _pixel_scores(mask, truth, camera)
    centroid_error_px, base_error_px = _NAN, _NAN
    if truth is not None and seen.size:
        errors_px = np.linalg.norm(centroids_px[seen, None] - truth.centres_px[None], axis=2).min(axis=1)
        nearest = int(seen[errors_px.argmin()])
        centroid_error_px = float(errors_px.min())
        base_error_px = _base_error_px(labels == nearest + 1, truth, camera)
    return ImageScore(
        is_smoke=truth is not None,
        is_found=seen.size > 0,
        iou=iou,
        precision=precision,
        recall=recall,
        centroid_error_px=centroid_error_px,
        base_error_px=base_error_px,
        false_segments=int((~on_truth).sum()),
        rejected=rejected,
    )


def _segments(mask: MaskArray, camera: Camera) -> tuple[NDArray[np.int32], FloatArray]:
    """The mask's segments as labels (h, w) from 1, the largest first, and their area centroids (N, 2) as (u, v)."""
    pixels, scale = checked_mask(mask, camera)
    count, labelled, stats, centroids = cv2.connectedComponentsWithStats(pixels, connectivity=8)
    areas = np.asarray(stats)[1:count, cv2.CC_STAT_AREA]
    order = np.argsort(-areas, kind="stable")
    kept = order[areas[order] >= MIN_AREA_PX] + 1
    new_label = np.zeros(count, np.int32)
    new_label[kept] = np.arange(1, kept.size + 1)
    centroids_px = np.asarray(centroids, dtype=np.float64)[kept] * scale + (scale - 1) / 2.0
    return new_label[np.asarray(labelled)], centroids_px


def is_near(truth: Truth, point_px: FloatArray, camera: Camera) -> bool:
    """Whether a point lies in the truth's pixels, which are squares, or close by."""
    near_px = _NEAR_PX * camera.width / _NEAR_WIDTH_PX
    u, v = (float(value) for value in point_px)
    left, top = (max(0, int(value - near_px - 1.0)) for value in (u, v))
    around = truth.region[top : int(v + near_px + 2.0), left : int(u + near_px + 2.0)]
    rows, columns = np.nonzero(around)
    beside_px = np.maximum(np.abs(columns + left - u) - 0.5, 0.0)
    above_px = np.maximum(np.abs(rows + top - v) - 0.5, 0.0)
    return bool((np.hypot(beside_px, above_px) <= near_px).any())


def _pixel_scores(mask: MaskArray, truth: Truth | None, camera: Camera) -> tuple[float, float, float]:
    """Intersection over union, precision and recall at full size."""
    if truth is None or not truth.is_mask:
        return _NAN, _NAN, _NAN
    pixels, _ = checked_mask(mask, camera)
    full = cv2.resize(pixels, (camera.width, camera.height), interpolation=cv2.INTER_NEAREST) > 0
    both = int((full & truth.region).sum())
    claimed, true = int(full.sum()), int(truth.region.sum())
    return both / (claimed + true - both), both / claimed if claimed else _NAN, both / true


def _base_error_px(segment: BoolArray, truth: Truth, camera: Camera) -> float:
    pieces = detections_from_mask(truth.region, camera) if truth.is_mask else []
    if not pieces:
        return _NAN
    found = detections_from_mask(segment, camera)[0]
    return float(np.linalg.norm(found.base_px - joined(pieces).base_px))


def _covered(low: float, high: float, size: int) -> slice:
    """The pixels of a side whose centres lie between two shares of it, the middle's at least."""
    middle = min(size - 1, int((low + high) / 2.0 * size))
    first = min(middle, max(0, int(np.ceil(low * size - 0.5))))
    return slice(first, max(middle, int(np.floor(high * size - 0.5))) + 1)


def _mean(values: Sequence[float]) -> float:
    finite = [value for value in values if np.isfinite(value)]
    return float(np.mean(finite)) if finite else _NAN


def _median(values: Sequence[float]) -> float:
    finite = [value for value in values if np.isfinite(value)]
    return float(np.median(finite)) if finite else _NAN
