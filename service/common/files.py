"""Whole files: written under their final name only once complete, images read or refused."""

import contextlib
import errno
import os
import stat
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

import cv2
import numpy as np
from numpy.typing import NDArray

from service.common.image_header import UPRIGHT, fault_of, orientation_of, turned
from service.common.image_size import TIFF, size_from_header

# What is taken for an image by its name; those that cannot be read are then told or counted, not passed over.
IMAGE_SUFFIXES = frozenset(
    {".jpg", ".jpeg", ".png", ".bmp", ".tif", ".tiff", ".gif", ".webp", ".heic", ".heif", ".avif", ".jp2", ".dng"}
)
MOST_IMAGE_BYTES = 100_000_000
MOST_PIXELS = 160_000_000  # of the largest cameras; as BGR 480 MB


def write_whole(path: Path, data: bytes, is_durable: bool = False) -> None:
    """Write beside the final name, then rename; durable: whole after a power failure too, at the disk's own speed."""
    with whole_file(path) as file:
        file.write(data)
        if is_durable:
            file.flush()
            os.fsync(file.fileno())
    if is_durable:
        sync_folder(path.parent)


def sync_folder(folder: Path) -> None:
    """The names of the files in it are on the disk, too; OSError."""
    handle = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


@contextlib.contextmanager
def whole_file(path: Path) -> Iterator[BinaryIO]:
    """A file that is renamed to `path` once it was written without an error; OSError where there can be none."""
    if path.is_dir():
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(path))
    part = path.with_name(path.name + ".part")
    part.unlink(missing_ok=True)  # it may be a link that leads elsewhere
    with part.open("xb") as file:
        yield file
    os.replace(part, path)


class FileRefusedError(Exception):
    """A file that is not read: one line that names it and says why."""


def check_file(path: Path, within: Path | None = None, most_bytes: int | None = None) -> None:
    """Raise FileRefusedError for what is no regular file, is too large, or lies, links followed, outside `within`.

    A pipe or a device would be read for ever.
    """
    try:
        found = path.stat()
        is_outside = within is not None and not path.resolve().is_relative_to(within.resolve())
    except (OSError, RuntimeError, ValueError) as error:  # a ring of links; a name with a zero byte
        raise FileRefusedError(f"{path}: cannot be read: {getattr(error, 'strerror', None) or error}") from error
    if is_outside:
        raise FileRefusedError(f"{path}: leads out of {within}: copy the file there")
    if not stat.S_ISREG(found.st_mode):
        raise FileRefusedError(f"{path}: is no regular file")
    if most_bytes is not None and found.st_size > most_bytes:
        raise FileRefusedError(f"{path}: has {found.st_size} bytes, more than {most_bytes}")


class NoImageError(FileRefusedError):
    """A file that holds no picture that can be used."""


class TooLargeError(FileRefusedError):
    """An image of more pixels than may be decoded; `size_px` is its width and height."""

    def __init__(self, message: str, size_px: tuple[int, int]) -> None:
        super().__init__(message)
        self.size_px = size_px


@dataclass(frozen=True, slots=True)
class Picture:
    """An image (H, W), (H, W, 3) BGR or, unchanged, (H, W, 4), turned upright by the EXIF `orientation` of its file."""

    image: NDArray[np.uint8]
    orientation: int = UPRIGHT


def read_image(path: Path, within: Path | None = None, most_pixels: int = MOST_PIXELS) -> NDArray[np.uint8] | None:
    """An image file as BGR (H, W, 3), None where it is refused; see `read_picture`."""
    try:
        return read_picture(path, within, most_pixels).image
    except FileRefusedError:
        return None


def read_picture(
    path: Path, within: Path | None = None, most_pixels: int = MOST_PIXELS, how: int = cv2.IMREAD_COLOR
) -> Picture:
    """An image file, upright, of 8 bits; `how` is OpenCV's IMREAD_COLOR, GRAYSCALE or UNCHANGED.

    Of 16 bits the upper half counts; those that hold no more than 8 keep their values. Raises FileRefusedError, in one
    line, for what `check_file` refuses and for what is no single whole picture; TooLargeError, by its header alone, for
    more than `most_pixels`.
    """
    check_file(path, within, MOST_IMAGE_BYTES)
    try:
        data = path.read_bytes()
    except OSError as error:
        raise FileRefusedError(f"{path}: cannot be read: {error.strerror}") from error
    size_px = size_from_header(data)
    if size_px is None:
        raise NoImageError(f"{path}: is {'no PNG, JPEG, BMP or TIFF' if data else 'empty'}")
    if size_px[0] * size_px[1] > most_pixels:
        raise TooLargeError(f"{path}: is {size_px[0]} x {size_px[1]} pixels, more than {most_pixels}", size_px)
    if fault := fault_of(data):
        raise NoImageError(f"{path}: {fault}")
    image = _decoded(data, how)
    if image is None:
        raise NoImageError(f"{path}: cannot be decoded: save it anew, as PNG or JPEG of 8 bits")
    if how != cv2.IMREAD_UNCHANGED and _wastes_bits(image):
        raise NoImageError(f"{path}: has 16 bits and uses the lower ones alone: save it with 8")
    return Picture(_of_8_bits(image), orientation_of(data))


def _decoded(data: bytes, how: int) -> NDArray[Any] | None:
    """Upright; None for what OpenCV cannot decode to 8 or 16 bits. It turns a TIFF itself, whatever it is told."""
    flags = how if how == cv2.IMREAD_UNCHANGED else how | cv2.IMREAD_ANYDEPTH | cv2.IMREAD_IGNORE_ORIENTATION
    try:
        image = cv2.imdecode(np.frombuffer(data, dtype=np.uint8), flags)
    except cv2.error:
        return None
    if image is None or image.dtype not in (np.uint8, np.uint16):
        return None
    return image if data[:4] in TIFF else turned(image, orientation_of(data))


def _wastes_bits(image: NDArray[Any]) -> bool:
    """Whether 16 bits hold 9 to 14, as of a sensor: by their upper half they would be all but black."""
    return image.dtype == np.uint16 and 256 <= int(image.max()) < 1 << 14


def _of_8_bits(image: NDArray[Any]) -> NDArray[np.uint8]:
    """16 bits that hold no more than 8 keep their values, others lose the lower half."""
    if image.dtype == np.uint16:
        return (image if image.max() < 256 else image >> 8).astype(np.uint8)
    return np.asarray(image, dtype=np.uint8)
