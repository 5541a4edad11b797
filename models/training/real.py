"""Real frames as backgrounds to train on: those with smoke and its mask or box, and those without."""

import csv
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from distloc.study.segmentation import Truth
from frames import EITHER, NOT_SMOKE, SMOKE, Background
from service.commands.study.images import LabelledImage, image_folders, labelled_images

_WIDTH = 640  # wider ones are shrunk to it
_WHITE = 235  # as bright as an overcast sky: in a box nobody can say whether it is smoke


@dataclass(frozen=True, slots=True)
class RealFrame:
    """An image and its truth as the scores take them, and the same as a background where it may be fitted to."""

    labelled: LabelledImage
    background: Background | None

    @property
    def folder(self) -> str:
        """The name of the set that it is of."""
        return self.labelled.path.parent.parent.name

    @property
    def stem(self) -> str:
        """Its own name."""
        return self.labelled.path.stem


def real_frames(folders: Sequence[Path], is_fitted: bool) -> list[RealFrame]:
    """Every image of folders laid out as `distloc study segmentation` reads them."""
    frames = []
    for folder, path in zip(image_folders(folders), folders, strict=True):
        lines = _horizons(path / "label.csv")
        for _, one in labelled_images(folder, print):
            if one is not None:
                background = _background(one, lines.get(one.path.name)) if is_fitted else None
                frames.append(RealFrame(one, background))
    return frames


def _background(one: LabelledImage, line: tuple[float, float] | None) -> Background:
    height, width = one.image.shape[:2]
    label = np.full((height, width), NOT_SMOKE, np.uint8) if one.truth is None else _label(one.image, one.truth)
    scale = min(1.0, _WIDTH / width)
    size = (round(width * scale), round(height * scale))
    image = cv2.resize(one.image, size, interpolation=cv2.INTER_AREA)
    label = cv2.resize(label, size, interpolation=cv2.INTER_NEAREST)
    if line is None:  # distant smoke stands on the horizon; without any it may be anywhere on the upper half
        rows = np.flatnonzero((label == SMOKE).any(axis=1))
        row = float(rows.max()) if rows.size and one.truth is not None and one.truth.is_mask else 0.35 * size[1]
        line = (row / size[1], row / size[1])
    horizon = (line[0] * size[1], line[1] * size[1])
    band = image[max(0, int(min(horizon)) - 12) : max(1, int(min(horizon)))]
    haze = band.reshape(-1, 3).mean(axis=0) if band.size else np.full(3, 210.0)
    return Background(image, label, np.zeros(label.shape, np.uint8), horizon, haze.astype(np.float32))


def _label(image: NDArray[np.uint8], truth: Truth) -> NDArray[np.uint8]:
    """A mask's edge is nobody's; in a box what is bright and grey is smoke, the rest nobody's."""
    region = truth.region.astype(np.uint8)
    if truth.is_mask:
        edge = cv2.dilate(region, np.ones((5, 5), np.uint8))
        return np.where(region > 0, SMOKE, np.where(edge > 0, EITHER, NOT_SMOKE)).astype(np.uint8)
    darkest = cv2.GaussianBlur(image.min(axis=2), (0, 0), image.shape[1] / 300.0)
    level, _ = cv2.threshold(darkest[truth.region].reshape(1, -1), 0, 255, cv2.THRESH_OTSU)
    is_smoke = truth.region & (darkest > level + 10.0) & (darkest < _WHITE)
    return np.where(is_smoke, SMOKE, np.where(truth.region, EITHER, NOT_SMOKE)).astype(np.uint8)


def _horizons(path: Path) -> dict[str, tuple[float, float]]:
    """The horizon's row at the left and the right edge as shares of the height, by file, where they are known."""
    if not path.is_file():
        return {}
    with path.open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    return {row["filename"]: (float(row["offset"]), float(row["offset"]) + float(row["slope"])) for row in rows}
