"""Folders of images with masks, boxes or neither, as the segmentation study reads them."""

import csv
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from distloc.study.segmentation import Truth, truth_from_boxes, truth_from_mask
from distloc.types import FloatArray
from service.common.files import IMAGE_SUFFIXES, MOST_PIXELS, FileRefusedError, read_picture
from service.common.masks import FAINT, MaskFolder, misnamed, strays

_BOX = ("cx", "cy", "w", "h")
_FALSE_ALARM = "false_alarm"  # in a box's kind: there is no smoke


class ImageFolderError(Exception):
    """A folder cannot be used: one line that names it and what is wrong."""


@dataclass(frozen=True, slots=True)
class ImageFolder:
    """Images by name, and where their truth is: `masks`, else boxes (N, 4) by stem, else nowhere."""

    name: str
    images: tuple[Path, ...]
    masks: MaskFolder | None
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


def tell_strays(folders: Sequence[ImageFolder], say: Callable[[str], None]) -> None:
    """A line for each folder in which masks or boxes are of no image: their names may be wrong."""
    for folder in folders:
        stems = {path.stem for path in folder.images}
        named = [path.name for path in strays(folder.masks.folder, stems)] if folder.masks else []
        named += [stem for stem in folder.boxes if stem not in stems]
        if named:
            what = "masks" if folder.masks else "images of boxes.csv"
            say(f"{folder.name}: {len(named)} {what} are of no image in the folder: {min(named)} ...")


def labelled_images(folder: ImageFolder, say: Callable[[str], None]) -> Iterator[tuple[Path, LabelledImage | None]]:
    """Each image in turn; None, and a line told, where it or its truth cannot be read."""
    for path in folder.images:
        try:
            yield path, _labelled(folder, path)
        except FileRefusedError as error:
            say(f"{error}; left out")
            yield path, None


def _folder(path: Path, name: str) -> ImageFolder:
    if not path.is_dir():
        raise ImageFolderError(f"{path}: no such folder")
    inside = path / "images"
    source = inside if inside.is_dir() else path
    images = tuple(sorted(one for one in source.iterdir() if one.suffix.lower() in IMAGE_SUFFIXES and one.is_file()))
    if not images:
        raise ImageFolderError(f"{source}: no images (NAME.png, .jpg, .bmp or .tif)")
    masks = path / "masks"
    if masks.is_dir():
        if fault := misnamed(masks, [one.name for one in images]):
            raise ImageFolderError(fault)
        return ImageFolder(name, images, MaskFolder(masks, MOST_PIXELS), {})
    boxes = _boxes(path / "boxes.csv")
    stems = {one.stem for one in images}
    if boxes and stems.isdisjoint(boxes):
        raise ImageFolderError(
            f"{path / 'boxes.csv'}: none of its {len(boxes)} images ({min(boxes)!r} ...) is in the folder: the image "
            f"{images[0].name} is named {images[0].stem!r}"
        )
    return ImageFolder(name, images, None, boxes)


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
    """The image and its truth, turned upright alike; FileRefusedError where either cannot be used."""
    picture = read_picture(path)
    height, width = picture.image.shape[:2]
    if folder.masks is None:
        boxes = folder.boxes.get(path.stem, np.zeros((0, 4)))
        return LabelledImage(path, picture.image, truth_from_boxes(boxes, width, height))
    if not folder.masks.has(path.name):
        return LabelledImage(path, picture.image, None)
    smoke = folder.masks.smoke(path.name, picture.orientation, lambda mask: mask.shape == (height, width))
    if smoke.is_faint:
        raise FileRefusedError(f"{folder.masks.path_of(path.name)}: {FAINT}")
    return LabelledImage(path, picture.image, truth_from_mask(smoke.region))
