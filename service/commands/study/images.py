"""Folders of images with masks, boxes or neither, as the segmentation study reads them."""

import csv
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from distloc.study.segmentation import Truth, truth_from_boxes, truth_from_mask
from distloc.types import FloatArray
from service.common.files import read_image

_SUFFIXES = {".jpg", ".jpeg", ".png", ".bmp", ".tif", ".tiff"}
_BOX = ("cx", "cy", "w", "h")
_FALSE_ALARM = "false_alarm"  # in a box's kind: there is no smoke


class ImageFolderError(Exception):
    """A folder cannot be used: one line that names it and what is wrong."""


class _ImageError(Exception):
    """One image, or its truth, cannot be read: what and why."""


@dataclass(frozen=True, slots=True)
class ImageFolder:
    """Images by name, and where their truth is: `masks`, else boxes (N, 4) by stem, else nowhere."""

    name: str
    images: tuple[Path, ...]
    masks: Path | None
    boxes: Mapping[str, FloatArray]


@dataclass(frozen=True, slots=True)
class LabelledImage:
    """BGR (H, W, 3) and where its smoke is; without truth it has none."""

    path: Path
    image: NDArray[np.uint8]
    truth: Truth | None


def image_folders(paths: Sequence[Path]) -> list[ImageFolder]:
    """The folders, named by their last part where that is unlike; raises ImageFolderError for one without images."""
    names = [path.resolve().name for path in paths]
    is_clear = len(set(names)) == len(names)
    return [_folder(path, name if is_clear else str(path)) for path, name in zip(paths, names, strict=True)]


def labelled_images(folder: ImageFolder, say: Callable[[str], None]) -> Iterator[tuple[Path, LabelledImage | None]]:
    """Each image in turn; None, and a line told, where it or its truth cannot be read."""
    for path in folder.images:
        try:
            yield path, _labelled(folder, path)
        except _ImageError as error:
            say(f"{error}: left out")
            yield path, None


def _folder(path: Path, name: str) -> ImageFolder:
    if not path.is_dir():
        raise ImageFolderError(f"{path}: no such folder")
    inside = path / "images"
    source = inside if inside.is_dir() else path
    images = tuple(sorted(one for one in source.iterdir() if one.suffix.lower() in _SUFFIXES and one.is_file()))
    if not images:
        raise ImageFolderError(f"{source}: no images ({', '.join(sorted(_SUFFIXES))})")
    if (path / "masks").is_dir():
        return ImageFolder(name, images, path / "masks", {})
    return ImageFolder(name, images, None, _boxes(path / "boxes.csv"))


def _boxes(path: Path) -> dict[str, FloatArray]:
    """Boxes (N, 4) of smoke by the image's stem; raises ImageFolderError for a row that is none."""
    if not path.is_file():
        return {}
    found: dict[str, list[list[float]]] = {}
    try:
        with path.open(newline="", encoding="utf-8") as file:
            for number, row in enumerate(csv.DictReader(file), start=2):
                if _FALSE_ALARM not in _cell(row, "kind", path, number):
                    box = [float(_cell(row, key, path, number)) for key in _BOX]
                    truth_from_boxes(np.array([box]), 1, 1)  # refuses what is no box
                    found.setdefault(_cell(row, "image", path, number), []).append(box)
    except (OSError, ValueError, csv.Error) as error:  # UnicodeDecodeError is a ValueError
        raise ImageFolderError(f"{path}: cannot be read: {error}") from error
    return {stem: np.array(boxes) for stem, boxes in found.items()}


def _cell(row: Mapping[str, str | None], key: str, path: Path, number: int) -> str:
    text = row.get(key)
    if text is None:
        raise ImageFolderError(f"{path}: line {number} has no {key}")
    return text


def _labelled(folder: ImageFolder, path: Path) -> LabelledImage:
    image = read_image(path)
    if image is None:
        raise _ImageError(f"{path}: cannot be read")
    height, width = image.shape[:2]
    if folder.masks is None:
        boxes = folder.boxes.get(path.stem, np.zeros((0, 4)))
        return LabelledImage(path, image, truth_from_boxes(boxes, width, height))
    smoke = _mask(folder.masks / f"{path.stem}.png")
    if smoke is not None and smoke.shape != (height, width):
        raise _ImageError(f"{path}: the image is {width} x {height}, its mask {smoke.shape[1]} x {smoke.shape[0]}")
    return LabelledImage(path, image, None if smoke is None else truth_from_mask(smoke))


def _mask(path: Path) -> NDArray[np.bool_] | None:
    """The pixels (H, W) above 0, of any depth or palette; None where there is no file."""
    if not path.is_file():
        return None
    try:
        data = np.fromfile(path, dtype=np.uint8)
        mask = cv2.imdecode(data, cv2.IMREAD_COLOR | cv2.IMREAD_ANYDEPTH) if data.size else None
    except (OSError, cv2.error):
        mask = None
    if mask is None:
        raise _ImageError(f"{path}: cannot be read")
    return np.asarray(mask.max(axis=2) > 0)
