"""What a camera does to a scene: glare, exposure, colours or none, dark corners, blur, noise, JPEG, a line of text."""

import cv2
import numpy as np
from numpy.typing import NDArray

_MONOCHROME_SHARE = 0.15
_TEXT = "0123456789:/-.#ABCDEFGHIJKLMNOPQRSTUVWXYZ    "


def as_taken(rng: np.random.Generator, scene: NDArray[np.float32]) -> NDArray[np.uint8]:
    """A scene (H, W, 3) of levels as some camera would have it, BGR; it hides nothing but its own dark corners."""
    image = _with_glare(rng, scene) if rng.random() < 0.15 else scene
    image = image * rng.uniform(0.75, 1.25) + rng.normal(0.0, 6.0)
    image *= 1.0 + rng.normal(0.0, 0.05, 3).astype(np.float32)
    grey = image.mean(axis=2, keepdims=True)
    image = grey + (image - grey) * (0.0 if rng.random() < _MONOCHROME_SHARE else rng.uniform(0.4, 1.5))
    image = 255.0 * np.clip(image / 255.0, 0.0, 1.0) ** rng.uniform(0.7, 1.4)
    if rng.random() < 0.4:
        image = image * _corners(rng, *image.shape[:2])[..., None]
    if rng.random() < 0.5:
        image = cv2.GaussianBlur(image.astype(np.float32), (0, 0), rng.uniform(0.3, 1.3))
    elif rng.random() < 0.4:  # a camera that sharpens
        image = image + rng.uniform(0.2, 1.0) * (image - cv2.GaussianBlur(image.astype(np.float32), (0, 0), 1.2))
    image = image + rng.standard_normal(image.shape, np.float32) * np.float32(rng.uniform(0.0, 3.5))
    taken = np.clip(image, 0.0, 255.0).astype(np.uint8)
    if rng.random() < 0.1:
        _write_line(rng, taken)
    if rng.random() < 0.8:
        _, data = cv2.imencode(".jpg", taken, [cv2.IMWRITE_JPEG_QUALITY, int(rng.uniform(30, 96))])
        taken = cv2.imdecode(data, cv2.IMREAD_COLOR)
    return taken


def _with_glare(rng: np.random.Generator, scene: NDArray[np.float32]) -> NDArray[np.float32]:
    """The sun in the picture or just outside: its light lies over everything, smoke too."""
    height, width = scene.shape[:2]
    x, y = rng.uniform(-0.2, 1.2) * width, rng.uniform(-0.3, 0.4) * height
    distance = _distance(height, width, x, y) / height
    glow = np.exp(-distance / rng.uniform(0.05, 0.5)) * rng.uniform(60.0, 260.0)
    return np.asarray(scene + glow[..., None] * np.array([0.92, 0.97, 1.0], np.float32), np.float32)


def _corners(rng: np.random.Generator, height: int, width: int) -> NDArray[np.float32]:
    """How much light gets to each pixel (H, W): less towards the corners, none outside a fish-eye's circle."""
    x, y = (0.5 + rng.normal(0.0, 0.15)) * width, (0.5 + rng.normal(0.0, 0.15)) * height
    distance = _distance(height, width, x, y) / np.float32(0.5 * np.hypot(width, height))
    light = 1.0 - rng.uniform(0.0, 0.45) * distance**2
    if rng.random() < 0.5:
        edge = rng.uniform(0.75, 1.1)
        light = light * np.clip((edge - distance) / rng.uniform(0.01, 0.12), 0.0, 1.0)
    return np.clip(light, 0.0, 1.0).astype(np.float32)


def _distance(height: int, width: int, x: float, y: float) -> NDArray[np.float32]:
    """From (x, y) in pixels (H, W)."""
    across = np.arange(width, dtype=np.float32)[None, :] - np.float32(x)
    down = np.arange(height, dtype=np.float32)[:, None] - np.float32(y)
    return np.sqrt(across * across + down * down)


def _write_line(rng: np.random.Generator, image: NDArray[np.uint8]) -> None:
    """A date, a name, numbers along the top or the bottom edge, in place."""
    text = "".join(_TEXT[i] for i in rng.integers(len(_TEXT), size=int(rng.integers(10, 60))))
    scale = rng.uniform(0.25, 0.45)
    y = int(12 * scale / 0.3) if rng.random() < 0.7 else image.shape[0] - 3
    colour = [int(c) for c in rng.integers(120, 256, 3)]
    cv2.putText(image, text, (2, y), cv2.FONT_HERSHEY_SIMPLEX, scale, colour, 1, cv2.LINE_AA)
