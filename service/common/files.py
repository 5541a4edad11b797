"""Whole files: written under their final name only once complete, images read or refused."""

import os
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray


def write_whole(path: Path, data: bytes, is_durable: bool = False) -> None:
    """Write beside the final name, then rename; durable: whole after a power failure too, at the disk's own speed."""
    part = path.with_name(path.name + ".part")
    part.unlink(missing_ok=True)  # it may be a link that leads elsewhere
    with part.open("xb") as file:
        file.write(data)
        if is_durable:
            file.flush()
            os.fsync(file.fileno())
    os.replace(part, path)


def read_image(path: Path) -> NDArray[np.uint8] | None:
    """An image file as BGR (H, W, 3), None where it cannot be read or decoded."""
    try:
        data = np.fromfile(path, dtype=np.uint8)
        image = cv2.imdecode(data, cv2.IMREAD_COLOR) if data.size else None
    except (OSError, cv2.error):
        return None
    return None if image is None else np.asarray(image, dtype=np.uint8)
