"""Smoke cut from real frames, to be laid over others: its opacity and brightness told from what lies round it."""

import cv2
import numpy as np
from numpy.typing import NDArray

from frames import SMOKE, Background
from plumes import FILLED, SIDE, PlumeCanvas

_LEAST_SIDE, _LEAST_PIXELS = 6, 60
_LARGEST = 1.6  # times its own size, beyond which it is but a blur
_LEAST_OPACITY = 0.25  # within the mask: what looks like none has something as bright behind it
_DENSE = 0.8  # the quantile of change in smoke above which it hides what is behind it


def cut_out(one: Background) -> PlumeCanvas | None:
    """The largest piece of a frame's smoke; None where it is too small or cut by the frame's edge."""
    count, pieces, stats, _ = cv2.connectedComponentsWithStats((one.label == SMOKE).astype(np.uint8), connectivity=8)
    if count < 2:
        return None
    largest = 1 + int(np.argmax(np.asarray(stats)[1:, cv2.CC_STAT_AREA]))
    x, y, w, h, area = (int(value) for value in np.asarray(stats)[largest])
    height, width = one.label.shape
    if min(w, h) < _LEAST_SIDE or area < _LEAST_PIXELS or x < 2 or y < 2 or x + w > width - 2 or y + h > height - 2:
        return None
    scale = FILLED * SIDE / max(w, h)
    middle = np.array([x + w / 2.0, y + h / 2.0])
    warp = np.hstack([np.eye(2) * scale, (SIDE / 2.0 - middle * scale)[:, None]])

    def on_canvas(plane: NDArray[np.float32]) -> NDArray[np.float32]:
        flags = cv2.INTER_AREA if scale < 1.0 else cv2.INTER_LINEAR
        return cv2.warpAffine(plane, warp, (SIDE, SIDE), flags=flags, borderMode=cv2.BORDER_REPLICATE)

    region = (pieces == largest).astype(np.float32)
    image, smoke = on_canvas(one.image.astype(np.float32)), on_canvas(region)
    opacity, shade = _matte(image, np.clip(cv2.GaussianBlur(smoke, (0, 0), 2.0), 0.0, 1.0))
    rows, columns = np.nonzero(pieces == largest)
    foot = rows >= np.quantile(rows, 0.95)
    at = warp @ np.array([columns[foot].mean(), rows[foot].max(), 1.0])
    return PlumeCanvas(opacity, shade, (float(at[0]), float(at[1])), _LARGEST * max(w, h))


def _matte(image: NDArray[np.float32], smoke: NDArray[np.float32]) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Opacity and brightness (H, W): how far each pixel went from what is behind to the smoke's own colour."""
    hidden = cv2.dilate((smoke > 0.02).astype(np.uint8), np.ones((5, 5), np.uint8))
    behind = cv2.inpaint(np.clip(image, 0, 255).astype(np.uint8), hidden, 5.0, cv2.INPAINT_TELEA).astype(np.float32)
    behind = cv2.GaussianBlur(behind, (0, 0), 3.0)
    change = image - behind
    size = np.abs(change).sum(axis=2)
    dense = (smoke > 0.5) & (size >= np.quantile(size[smoke > 0.5], _DENSE))
    colour = image[dense].mean(axis=0)
    span = colour - behind
    opacity = (change * span).sum(axis=2) / np.maximum(np.square(span).sum(axis=2), 100.0)
    opacity = np.clip(opacity, _LEAST_OPACITY, 1.0) * smoke
    shade = np.where(opacity > 0.3, image.mean(axis=2) / max(float(colour.mean()), 1.0), 1.0)
    shade = cv2.GaussianBlur(shade.astype(np.float32), (0, 0), 1.0)
    return opacity.astype(np.float32), np.clip(shade, 0.4, 1.15).astype(np.float32)
