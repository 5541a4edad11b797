"""Whole files: written under their final name only once complete, images read or refused."""

import contextlib
import errno
import os
import stat
from collections.abc import Iterator
from pathlib import Path
from typing import Any, BinaryIO

import cv2
import numpy as np
from numpy.typing import NDArray

from service.common.image_size import size_from_header

MOST_IMAGE_BYTES = 100_000_000
MOST_PIXELS = 160_000_000  # of the largest cameras; as BGR 480 MB


def write_whole(path: Path, data: bytes, is_durable: bool = False) -> None:
    """Write beside the final name, then rename; durable: whole after a power failure too, at the disk's own speed."""
    with whole_file(path) as file:
        file.write(data)
        if is_durable:
            file.flush()
            os.fsync(file.fileno())


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


def read_image(path: Path, within: Path | None = None, most_pixels: int = MOST_PIXELS) -> NDArray[np.uint8] | None:
    """An image file as BGR (H, W, 3), None where it cannot be read or decoded or is refused; see `decoded`."""
    try:
        return decoded(path, cv2.IMREAD_COLOR, within, most_pixels)
    except FileRefusedError:
        return None


def decoded(
    path: Path, flags: int, within: Path | None = None, most_pixels: int = MOST_PIXELS
) -> NDArray[np.uint8] | None:
    """An image file by OpenCV's flags, None where it is none.

    Raises FileRefusedError for what `check_file` refuses and, by its header, for more than `most_pixels`.
    """
    check_file(path, within, MOST_IMAGE_BYTES)
    try:
        data = np.fromfile(path, dtype=np.uint8)
        size = size_from_header(data.tobytes())
        if size is None:
            return None
        if size[0] * size[1] > most_pixels:
            raise FileRefusedError(f"{path}: is {size[0]} x {size[1]} pixels, more than {most_pixels}")
        image = cv2.imdecode(data, flags)
    except (OSError, cv2.error):
        return None
    return None if image is None else _of_8_bits(image)


def _of_8_bits(image: NDArray[Any]) -> NDArray[np.uint8] | None:
    """With IMREAD_ANYDEPTH: 16 bits that hold no more than 8 keep their values, others lose the lower half."""
    if image.dtype == np.uint16:
        return (image if image.max() < 256 else image >> 8).astype(np.uint8)
    return image if image.dtype == np.uint8 else None
