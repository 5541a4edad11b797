"""What a mask's file says is smoke: one rule for the recorded segmenter, the studies and whoever trains on masks.

A mask is NAME.png beside the image NAME. Above 127 of 255 is smoke, by the largest of a pixel's colours; where no mask
of the folder has anything above 1, as masks of classes have, 1 is.
"""

import os
from collections.abc import Callable, Container, Iterable
from dataclasses import dataclass
from itertools import islice
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from service.common.files import FileRefusedError, NoImageError, Picture, read_picture
from service.common.image_header import UPRIGHT, turned

FAINT = "no pixel above 127 though some above 0: smoke is 255, or 1 where no mask of the folder has more"
_HALF = 127
_LOOKED_AT = 64  # for whether they are of 0 and 255 or of 0 and 1
_MOST_MASKS = 1_000_000

Values = NDArray[np.uint8]
Fits = Callable[[Values], bool]


@dataclass(frozen=True, slots=True)
class Smoke:
    """Where a mask says that smoke is (h, w); `is_faint`: it has pixels above 0, and none that is smoke."""

    region: NDArray[np.bool_]
    is_faint: bool


class MaskFolder:
    """The masks of a folder, of no more than `most_pixels` each."""

    def __init__(self, folder: Path, most_pixels: int) -> None:
        self.folder = folder
        self._most_pixels = most_pixels
        self._is_0_and_1 = self._are_0_and_1()

    def path_of(self, name: str) -> Path:
        """Where the mask of an image or frame lies, if there is one."""
        return self.folder / f"{Path(name).stem}.png"

    def has(self, name: str) -> bool:
        """Whether there is a mask for an image or frame, that can be read or not."""
        return os.path.lexists(self.path_of(name))

    def smoke(self, name: str, orientation: int, fits: Fits) -> Smoke:
        """The smoke in an image that was turned upright by its EXIF `orientation`, and that the mask must fit.

        Raises FileRefusedError, in one line, for a mask that cannot be used.
        """
        path = self.path_of(name)
        values = _laid(path, _values(path, self._most_pixels), orientation, fits)
        most = int(values.max())
        region = values > (0 if self._is_0_and_1 and most == 1 else _HALF)
        return Smoke(region, bool(most) and not region.any())

    def _are_0_and_1(self) -> bool:
        """Whether, of masks spread over the folder, those that are not empty have nothing above 1."""
        paths = _masks(self.folder)
        has_ones = False
        for path in paths[:: max(1, len(paths) // _LOOKED_AT)]:
            try:
                most = int(_values(path, self._most_pixels).image.max())
            except FileRefusedError:
                continue
            if most > 1:
                return False
            has_ones = has_ones or most == 1
        return has_ones


def misnamed(folder: Path, names: Iterable[str]) -> str:
    """Why the masks of a folder can belong to none of these images or frames; empty: one does, or there is neither."""
    stems = {Path(name).stem for name in names}
    paths = [path for path in islice(folder.iterdir(), _MOST_MASKS) if not path.name.startswith(".")]
    if not stems or len(strays(folder, stems)) < len(_masks(folder)):
        return ""
    if not paths:
        return f"{folder}: is empty: a mask is NAME.png for the image NAME; without the folder there are no masks"
    first, stem = min(paths).name, min(stems)
    return (
        f"{folder}: none of its {len(paths)} files ({first} ...) is the mask of an image: that of {stem} is {stem}.png"
    )


def strays(folder: Path, stems: Container[str]) -> list[Path]:
    """The masks of a folder that are of none of these images, named without their suffixes."""
    return [path for path in _masks(folder) if path.stem not in stems]


def _masks(folder: Path) -> list[Path]:
    return sorted(islice(folder.glob("*.png"), _MOST_MASKS))


def _values(path: Path, most_pixels: int) -> Picture:
    """The mask's values (h, w), the largest of the colours; what is transparent is 0."""
    picture = read_picture(path, path.parent, most_pixels, cv2.IMREAD_UNCHANGED)
    if picture.image.ndim == 2:
        return picture
    values = np.asarray(picture.image[..., :3].max(axis=2))
    if picture.image.shape[2] == 4:
        is_opaque = picture.image[..., 3] > _HALF
        if not values.any() and not is_opaque.all() and is_opaque.any():
            raise NoImageError(f"{path}: has nothing but transparency: save it in black and white")
        values = np.where(is_opaque, values, 0)
    return Picture(values, picture.orientation)


def _laid(path: Path, mask: Picture, orientation: int, fits: Fits) -> Values:
    """The mask as its image lies: one without an orientation of its own was drawn on the turned image or on the raw.

    Its size tells which; where it does not, and it makes a difference, it is refused.
    """
    ways = [mask.image]
    if orientation != UPRIGHT and mask.orientation == UPRIGHT:
        ways.append(turned(mask.image, orientation))
    fitting = [way for way in ways if fits(way)]
    if not fitting:
        height, width = mask.image.shape
        raise NoImageError(f"{path}: is {width} x {height} pixels, which does not fit its image")
    if len(fitting) > 1 and not np.array_equal(fitting[0], fitting[1]):
        raise NoImageError(
            f"{path}: its image is turned by EXIF ({orientation}), the mask's size fits before and after: save the "
            "image turned and without EXIF"
        )
    return fitting[0]
