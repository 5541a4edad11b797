"""Training frames: a landscape or a real background, smoke laid over it, and what a camera does to both."""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from lens import as_taken
from plumes import FILLED, LEAST_PX, MOST_PX, SIDE, PlumeCanvas

CROP_W, CROP_H = 352, 224
NOT_SMOKE, SMOKE, EITHER = 0, 1, 2  # a label; EITHER is too faint for anyone to say, and is not learnt
_SMOKY_SHARE = 0.75  # of the frames get smoke
_ON_LAND_SHARE = 0.4
_LEAST_OPACITY, _CLEAR_OPACITY = 0.04, 0.12
_BLACK, _WHITE = 10, 252  # beyond these a camera shows nothing
_LEAST_CHANGE = 6.0  # levels of 255 that smoke must change what is behind it


@dataclass(frozen=True, slots=True)
class Background:
    """An image (H, W, 3) uint8 BGR, its labels (H, W) uint8, and what tells where smoke can stand.

    `rank` (H, W) is how near each pixel is, 0 the sky; zero all over where nobody knows. `horizon` is the row at the
    left and the right edge. `haze_bgr` (3,) is what distance fades to.
    """

    image: NDArray[np.uint8]
    label: NDArray[np.uint8]
    rank: NDArray[np.uint8]
    horizon: tuple[float, float]
    haze_bgr: NDArray[np.float32]


def draw_frame(
    rng: np.random.Generator, background: Background, plumes: Sequence[PlumeCanvas]
) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
    """An image (CROP_H, CROP_W, 3) uint8 BGR and its labels (CROP_H, CROP_W)."""
    view = _crop(rng, background)
    image, label = view.image.astype(np.float32), view.label.copy()
    has_smoke = bool((label == SMOKE).any())
    if rng.random() < (0.3 if has_smoke else _SMOKY_SHARE):
        for _ in range(1 + int(rng.random() < 0.4)):
            _lay_smoke(rng, image, label, view, plumes[rng.integers(len(plumes))])
    taken = as_taken(rng, image)
    is_blind = (taken.max(axis=2) < _BLACK) | (taken.min(axis=2) > _WHITE)
    label[is_blind & (label == SMOKE)] = EITHER
    return taken, label


def _crop(rng: np.random.Generator, one: Background) -> Background:
    """A part of it at another scale, mirrored half of the time."""
    height, width = one.rank.shape
    scale = float(np.exp(rng.uniform(np.log(0.7), np.log(1.5))))
    scale = max(scale, CROP_W / width, CROP_H / height)
    w, h = CROP_W / scale, CROP_H / scale
    x, y = rng.uniform() * max(width - w, 0.0), rng.uniform() * max(height - h, 0.0)
    smoke = np.argwhere(one.label == SMOKE)
    if smoke.size and rng.random() < 0.8:  # with the real smoke in it
        row, column = smoke[rng.integers(len(smoke))]
        x = float(np.clip(column - rng.uniform(0.0, 1.0) * w, 0.0, max(width - w, 0.0)))
        y = float(np.clip(row - rng.uniform(0.0, 1.0) * h, 0.0, max(height - h, 0.0)))
    warp = np.array([[1.0 / scale, 0.0, x], [0.0, 1.0 / scale, y]])
    is_mirrored = rng.random() < 0.5
    if is_mirrored:
        warp[0] = [-1.0 / scale, 0.0, x + w - 1.0]

    def taken(plane: NDArray[np.uint8], how: int) -> NDArray[np.uint8]:
        flags = how | cv2.WARP_INVERSE_MAP
        return cv2.warpAffine(plane, warp, (CROP_W, CROP_H), flags=flags, borderMode=cv2.BORDER_REFLECT)

    def row_at(column: float) -> float:
        at = (warp[0, 0] * column + warp[0, 2]) / width
        return (one.horizon[0] * (1.0 - at) + one.horizon[1] * at - y) * scale

    image = one.image if scale >= 1.0 else cv2.GaussianBlur(one.image, (0, 0), 0.4 / scale)
    return Background(
        taken(image, cv2.INTER_LINEAR),
        taken(one.label, cv2.INTER_NEAREST),
        taken(one.rank, cv2.INTER_NEAREST),
        (row_at(0.0), row_at(float(CROP_W))),
        one.haze_bgr,
    )


def _lay_smoke(
    rng: np.random.Generator,
    image: NDArray[np.float32],
    label: NDArray[np.uint8],
    view: Background,
    plume: PlumeCanvas,
) -> None:
    """One plume over the image and into the labels, in place; where it cannot be seen nothing is learnt."""
    size = float(np.exp(rng.uniform(np.log(LEAST_PX), np.log(max(plume.most_px, LEAST_PX)))))
    near = np.clip(size / MOST_PX, 0.0, 1.0)
    x = rng.uniform(-0.08, 1.08) * CROP_W  # the frame's edge cuts some
    horizon = view.horizon[0] + (view.horizon[1] - view.horizon[0]) * x / CROP_W
    below = abs(rng.normal(0.0, 0.12 + 0.7 * near)) * size + rng.uniform(0.0, 6.0)
    if rng.random() < _ON_LAND_SHARE:  # all of it before the land, as who looks down on a fire has it
        below += rng.exponential(0.8 * size)
    y = horizon + below if rng.random() < 0.85 else rng.uniform(horizon, max(horizon, 0.0) + CROP_H)
    y = float(np.clip(y, 4.0, CROP_H + 0.3 * size))
    tilt = float(np.degrees(np.arctan2(view.horizon[1] - view.horizon[0], CROP_W))) + rng.normal(0.0, 6.0)
    scale = size / (FILLED * SIDE)
    warp = cv2.getRotationMatrix2D(plume.foot, -tilt, scale)
    if rng.random() < 0.5:
        warp = warp @ np.array([[-1.0, 0.0, 2.0 * plume.foot[0]], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    warp[:, 2] += np.array([x, y]) - plume.foot
    flags = cv2.INTER_AREA if scale < 0.5 else cv2.INTER_LINEAR
    blur = 0.35 / scale if scale < 0.7 else 0.0
    opacity, shade = (
        cv2.warpAffine(cv2.GaussianBlur(one, (0, 0), blur) if blur else one, warp, (CROP_W, CROP_H), flags=flags)
        for one in (plume.opacity, plume.shade)
    )
    opacity *= np.exp(rng.uniform(np.log(0.45), 0.0)) if rng.random() < 0.8 else rng.uniform(0.15, 0.45)
    foot = view.rank[int(np.clip(y, 0, CROP_H - 1)), int(np.clip(x, 0, CROP_W - 1))]
    opacity *= view.rank <= max(foot, 1)  # nearer ridges and trees hide it
    tone = (rng.uniform(150.0, 250.0) if rng.random() < 0.8 else rng.uniform(90.0, 150.0)) * (
        1.0 + rng.normal(0.0, 0.03, 3)
    )
    tone += np.array([-1.0, 0.0, 1.0]) * rng.normal(0.0, 6.0)
    haze = rng.uniform(0.0, 0.6) * (1.0 - near)
    colour = shade[..., None] * (tone * (1.0 - haze)).astype(np.float32) + np.float32(haze) * view.haze_bgr
    change = opacity[..., None] * (colour - image)
    image += change
    seen = cv2.GaussianBlur(np.abs(change).mean(axis=2), (0, 0), 1.5) > _LEAST_CHANGE
    clear = ((opacity > _CLEAR_OPACITY) & seen).astype(np.uint8)
    whole = cv2.morphologyEx(clear, cv2.MORPH_CLOSE, np.ones((7, 7), np.uint8)) > 0
    label[(opacity > _LEAST_OPACITY) & (label == NOT_SMOKE)] = EITHER
    label[whole & (opacity > _LEAST_OPACITY)] = SMOKE
