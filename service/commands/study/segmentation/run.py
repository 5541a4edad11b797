"""`study segmentation`: any segmenter on folders of images: print the table, write CSV, JSON and contact sheets."""

import re
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import msgspec
import numpy as np
from numpy.typing import NDArray

from distloc.geometry.camera import Camera
from distloc.study.segmentation import ImageScore, Summary, rank, score_image, summarised
from distloc.types import RejectReason
from service.commands.progress import count_progress
from service.commands.study.files import prepared, rounded, write_csv, write_json
from service.commands.study.images import LabelledImage, image_folders, labelled_images, tell_strays
from service.commands.study.segmentation.by_fire import by_fire, fire_of
from service.commands.study.segmentation.overlay import sheet, tile
from service.commands.study.segmentation.table import by_fire_text, by_folder_text
from service.common.files import write_whole
from service.common.messages import Frame
from service.config.load import load_config
from service.config.sections import ConfigError, SegmenterConfig
from service.publish.overlay import encoded_png
from service.segmenters.model_file import SUFFIXES
from service.segmenters.segment import Mask, Segmenter, make_segmenter, shipped_model

_PAGE = 40  # images on a contact sheet
_DIGITS = {"found_share": 4, "iou_mean": 4, "precision": 4, "recall": 4}
_SHEET_NAME = re.compile(r"contact_sheet(_\d+)?\.png")


@dataclass(frozen=True, slots=True)
class _Row:
    """One image as it came out; without a score it could not be read. The tile is a PNG file's bytes."""

    folder: str
    image: str
    width: int = 0
    height: int = 0
    score: ImageScore | None = None
    duration_ms: float = float("nan")
    tile_png: bytes = b""


def run_segmentation(
    paths: Sequence[Path],
    segmenter: str,
    threshold: float | None,
    out: Path,
    say: Callable[[str], None],
    config: Path | None = None,
) -> None:
    """segmentation.json, segmentation.csv and contact_sheet.png (or _1.png and on) in `out`.

    Raises ImageFolderError for a folder without images, ConfigError for a segmenter that cannot be had.
    """
    folders = image_folders(paths)
    segmenters = _Segmenters(segmenter_config(segmenter, threshold, config))
    prepared(out)
    tell_strays(folders, say)
    rows: list[_Row] = []
    with count_progress("segmentation", sum(len(folder.images) for folder in folders)) as on_done:
        for folder in folders:
            for path, labelled in labelled_images(folder, say):
                unread = _Row(folder.name, path.name)
                rows.append(unread if labelled is None else _evaluated(folder.name, labelled, segmenters))
                on_done(len(rows))
    all_rows = _summary("all", rows)
    by_folder = [_summary(one.name, [row for row in rows if row.folder == one.name]) for one in folders]
    fires = by_fire([(fire_of(row.image), row.score) for row in rows if row.score is not None])
    content = {"segmenter": segmenters.name or segmenter} | all_rows | {"folders": by_folder} | fires
    content.pop("folder")
    write_json(out / "segmentation.json", content)
    write_csv(out / "segmentation.csv", [_csv_row(row) for row in rows])
    say(by_folder_text([*by_folder, all_rows], segmenters.name or segmenter))
    if fires:
        say(f"\n{by_fire_text(fires)}\n")
    sheets = _write_sheets(out, rows)
    say(f"wrote {out}/" + ", ".join(["segmentation.json", "segmentation.csv", *sheets]))


class _Segmenters:
    """One segmenter for each size of image, warmed up: its first frame costs what later ones don't."""

    def __init__(self, config: SegmenterConfig) -> None:
        self.name = ""
        self._config = config
        self._made: dict[tuple[int, int], tuple[Camera, Segmenter]] = {}

    def of_size(self, frame: Frame, width: int, height: int) -> tuple[Camera, Segmenter]:
        """The camera and its segmenter; a new one has seen the frame once."""
        if (width, height) not in self._made:
            camera = Camera(width, height, width, width, (width - 1) / 2.0, (height - 1) / 2.0)
            segmenter = make_segmenter(self._config, camera)
            segmenter.segment(frame, None)
            self.name = segmenter.name
            self._made[width, height] = camera, segmenter
        return self._made[width, height]


def segmenter_config(segmenter: str, threshold: float | None, config: Path | None = None) -> SegmenterConfig:
    """What --segmenter, --threshold and --config ask for; ConfigError, naming the option, for what is none of them.

    Of the config's [segmenter] a model takes all but its kind, file and sum.
    """
    settings: dict[str, Any] = {}
    if threshold is not None:
        if not 0.0 < threshold < 1.0:
            raise ConfigError(f"--threshold is {threshold}: it must be above 0 and below 1")
        settings["threshold"] = threshold
    base = SegmenterConfig() if config is None else load_config(config).segmenter
    if segmenter == "onnx" or Path(segmenter).suffix.lower() in SUFFIXES:
        model = str(shipped_model()) if segmenter == "onnx" else segmenter
        return msgspec.structs.replace(base, kind="onnx", model=model, sha256="", **settings)
    if segmenter in ("classical", "sobel"):
        return msgspec.structs.replace(base, kind=segmenter, **settings)
    raise ConfigError(f"--segmenter is {segmenter!r}: it must be onnx, classical, sobel or a model's file, NAME.onnx")


def _evaluated(folder: str, labelled: LabelledImage, segmenters: _Segmenters) -> _Row:
    height, width = labelled.image.shape[:2]
    frame = Frame(0, labelled.path.name, labelled.image)
    camera, segmenter = segmenters.of_size(frame, width, height)
    started_s = time.perf_counter()
    mask = segmenter.segment(frame, None)
    duration_ms = 1000.0 * (time.perf_counter() - started_s)
    score = score_image(mask, labelled.truth, camera)
    return _Row(
        folder, labelled.path.name, width, height, score, duration_ms, encoded_png(_tile(labelled, mask, score))
    )


def _tile(labelled: LabelledImage, mask: Mask | RejectReason, score: ImageScore) -> NDArray[np.uint8]:
    return tile(
        labelled.image,
        None if labelled.truth is None else labelled.truth.region,
        None if isinstance(mask, RejectReason) else mask,
        labelled.path.stem,
        _verdict(score),
    )


def _verdict(score: ImageScore) -> str:
    """What became of an image, in one line."""
    parts = [str(score.rejected)] if score.rejected else []
    if score.is_smoke:
        parts.append("found" if score.is_found else "missed")
        parts += [f"IoU {score.iou:.2f}"] if np.isfinite(score.iou) else []
        parts += [f"{score.centroid_error_px:.0f} px off"] if score.is_found else []
    else:
        parts.append("no smoke")
    parts.append(f"{score.false_segments} false")
    return ", ".join(parts)


def _write_sheets(out: Path, rows: Sequence[_Row]) -> list[str]:
    """The names of the sheets written, from the best image to the worst; an earlier run's go."""
    for old in out.iterdir():
        if _SHEET_NAME.fullmatch(old.name):
            old.unlink()
    scored = [(rank(row.score), row.tile_png) for row in rows if row.score is not None]
    tiles = [png for _, png in sorted(scored, key=lambda one: one[0])]
    pages = [tiles[start : start + _PAGE] for start in range(0, len(tiles), _PAGE)]
    names = [f"contact_sheet_{number}.png" for number in range(1, len(pages) + 1)]
    names = ["contact_sheet.png"] if len(pages) == 1 else names
    for name, page in zip(names, pages, strict=True):
        decoded = [cv2.imdecode(np.frombuffer(png, np.uint8), cv2.IMREAD_COLOR) for png in page]
        write_whole(out / name, encoded_png(sheet([np.asarray(one, np.uint8) for one in decoded])))
    return names


def _summary(folder: str, rows: Sequence[_Row]) -> dict[str, Any]:
    scored = [(row.score, row.duration_ms) for row in rows if row.score is not None]
    found: Summary = summarised([score for score, _ in scored], [duration_ms for _, duration_ms in scored])
    means = {
        name: rounded(getattr(found, name), _DIGITS.get(name, 3))
        for name in (
            *("found_share", "iou_mean", "precision", "recall", "centroid_error_px_median", "base_error_px_median"),
            *("false_per_smoke_image", "false_per_negative", "ms_median"),
        )
    }
    counts = {"smoke_images": found.smoke_images, "negative_images": found.negative_images}
    return {"folder": folder} | counts | means | {"rejected": found.rejected, "unreadable": len(rows) - len(scored)}


def _csv_row(row: _Row) -> dict[str, Any]:
    score = row.score
    names = {"folder": row.folder, "image": row.image, "width": row.width or None, "height": row.height or None}
    if score is None:
        empty = ("found", "iou", "precision", "recall", "centroid_error_px", "base_error_px", "false_segments", "ms")
        return names | {"kind": "unreadable"} | dict.fromkeys(empty) | {"rejected": None, "fire": None}
    return names | {
        "kind": "smoke" if score.is_smoke else "negative",
        "found": int(score.is_found) if score.is_smoke else None,
        "iou": rounded(score.iou, 4),
        "precision": rounded(score.precision, 4),
        "recall": rounded(score.recall, 4),
        "centroid_error_px": rounded(score.centroid_error_px, 2),
        "base_error_px": rounded(score.base_error_px, 2),
        "false_segments": score.false_segments,
        "ms": rounded(row.duration_ms, 3),
        "rejected": score.rejected,
        "fire": fire_of(row.image) or None,
    }
