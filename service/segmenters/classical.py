"""Smoke from colour alone, without a trained model; the fallback where no model is given.

Smoke is a grey veil lit by the sun and the sky. Over land it raises the darkest colour (the dark channel of He, Sun and
Tang 2009) and hides the dark gaps in the land's texture; before the bright sky at the horizon it is darker than that
sky. So a place is compared with what lies to both sides of it at the same elevation.
"""

import cv2
import numpy as np
from numpy.typing import NDArray

from distloc.geometry.camera import Camera
from distloc.types import CameraPose, RejectReason
from service.common.messages import Frame
from service.segmenters.horizon_by_eye import HorizonFinder
from service.segmenters.level_view import ALL_LAND, HorizonLine, LevelView, level_view

_MAX_WIDTH = 640
# lengths are shares of the frame's width, contrasts are levels of 255
_TEXTURE = 0.01  # a bright thing narrower than this belongs to the land
_BAND_UP, _BAND_DOWN = 0.12, 0.2  # where distant smoke can be
_MAX_WIDTH_OF_PLUME = 0.3  # of a distant one; haze, fields and ranges of hills are wider
_MIN_CONTRAST = 8.0  # what JPEG and noise leave visible
_CONTRAST_FACTOR = 5.5  # over the mean at the elevation, which is the land's own texture
_MAX_DARKNESS = 0.5  # of the way from the sky to the land; trees and near hills are darker
_MIN_AREA = 0.018**2
_MIN_SLENDERNESS = 0.35  # height over width; fields and lakes lie flat
_MIN_RISE = 0.5  # how high a plume stands over how high the camera does: its height over its base's depth
_MIN_DEPTH_OF_BRIGHT = 0.01  # of the base below the horizon; clouds end above
_CROSSING = 0.03  # between a plume's bright foot and its dark top it is as bright as what is behind it
_MAX_RISE_OF_DARK = 0.05  # of the base above the horizon, where hills may hide it; birds are higher
_DENSE_CONTRAST = 60.0  # levels above the land: smoke that hides it
_MIN_DENSE_AREA = 0.01  # of the frame
_MIN_DENSE_HEIGHT = 0.05  # lakes, roads and the haze below the horizon are flatter


class ClassicalSegmenter:
    """Works at a whole fraction of the camera's size; its masks have that size."""

    def __init__(self, camera: Camera, flood_share: float) -> None:
        self.name = "classical"
        self._flood_share = flood_share
        divisor = _divisor(camera.width, camera.height)
        self._size = (camera.width // divisor, camera.height // divisor)
        self._finder = HorizonFinder(*self._size)
        u, v = (np.linspace(0.0, side - 1.0, 24) for side in (camera.width, camera.height))
        grid = np.stack(np.meshgrid(u, v)).reshape(2, -1)
        self._rays = camera.rays(grid)
        centre = 0.5 * np.array([[camera.width - 1.0], [camera.height - 1.0]])
        self._places = np.vstack([(grid - centre) / camera.width, np.ones(grid.shape[1])])

    def segment(self, frame: Frame, pose: CameraPose | None) -> NDArray[np.uint8] | RejectReason:
        """The smoke in a frame; BAD_FRAME without an image, SEGMENTATION_FLOODED where too much looks like smoke."""
        if frame.image is None or frame.image.ndim != 3 or frame.image.shape[2] != 3 or frame.image.size == 0:
            return RejectReason.BAD_FRAME
        small = np.asarray(cv2.resize(frame.image, self._size, interpolation=cv2.INTER_AREA), dtype=np.uint8)
        veil = _veil(small)
        line = self._line(pose) if pose is not None else self._finder.find(veil) or ALL_LAND
        margin = round(0.5 * _MAX_WIDTH_OF_PLUME * self._size[0])
        view = level_view(veil, line, margin)
        foot = _dense(view) | _distant(view)
        mask = view.frame_from_view(_with_top(foot, level_view(_greyness(small), line, margin)))
        return RejectReason.SEGMENTATION_FLOODED if is_flooded(mask, self._flood_share) else mask

    def _line(self, pose: CameraPose) -> HorizonLine:
        """The line that fits the rays' elevations best near the horizon, as a lens may bend it."""
        elevation = np.arcsin(np.clip(pose.R_cam_from_enu[:, 2] @ self._rays, -1.0, 1.0))
        weight = np.exp(-0.5 * np.square(elevation / np.radians(5.0))) + 1e-3
        right, down, level = np.linalg.lstsq((self._places * weight).T, elevation * weight, rcond=None)[0]
        return HorizonLine(float(np.arctan2(right, -down)), float(level / max(np.hypot(right, down), 1e-3)))


def is_flooded(mask: NDArray[np.uint8], flood_share: float) -> bool:
    """Whether more than a share of the mask is set: then the segmenter has failed, whatever there is to see."""
    return bool(cv2.countNonZero(mask) > flood_share * mask.size)


def _veil(image: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """The darkest colour (h, w) without bright texture: how much grey light lies over a place."""
    blue, green, red = cv2.split(image)
    side = 2 * round(0.5 * _TEXTURE * image.shape[1]) + 1
    opened = cv2.morphologyEx(cv2.min(cv2.min(blue, green), red), cv2.MORPH_OPEN, np.ones((side, side), np.uint8))
    return np.asarray(cv2.GaussianBlur(opened, (0, 0), 0.25 * side), dtype=np.uint8)


def _greyness(image: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """255 less the difference of the brightest and the darkest colour (h, w)."""
    blue, green, red = cv2.split(image)
    spread = cv2.max(cv2.max(blue, green), red) - cv2.min(cv2.min(blue, green), red)
    return np.asarray(255 - cv2.GaussianBlur(spread, (0, 0), 0.002 * image.shape[1] + 0.5), dtype=np.uint8)


def _with_top(foot: NDArray[np.uint8], grey: LevelView) -> NDArray[np.uint8]:
    """What was found, and what is greyer than the sky to both sides of it and hangs together with it."""
    if not foot.any():
        return foot
    length = 2 * round(0.5 * _MAX_WIDTH_OF_PLUME * grey.unit) + 1
    found = _stands_out(_excess(grey.light, grey.is_inside, length), grey.is_inside)
    found[max(grey.horizon, 0) :] = False
    whole = cv2.morphologyEx((found | (foot > 0)).astype(np.uint8), cv2.MORPH_OPEN, np.ones((3, 3), np.uint8))
    _, labels = cv2.connectedComponents(whole, connectivity=8)
    held = np.unique(labels[foot > 0])
    return np.where(np.isin(labels, held[held > 0]), 255, foot).astype(np.uint8)


def _dense(view: LevelView) -> NDArray[np.uint8]:
    """Smoke so near that it hides the land, in the view: large, upright and far brighter than the land on the whole."""
    is_land = view.is_inside.copy()
    is_land[: max(view.horizon, 0)] = False
    if not is_land.any():
        return np.zeros_like(view.light)
    bright = is_land & (view.light > np.median(view.light[is_land]) + _DENSE_CONTRAST)
    column = np.ones((max(1, round(_MIN_DENSE_HEIGHT * view.unit)), 1), np.uint8)
    labels, stats = _segments(bright, column)
    return _union(labels, stats[:, cv2.CC_STAT_AREA] >= _MIN_DENSE_AREA * view.frame_size[0] * view.frame_size[1])


def _distant(view: LevelView) -> NDArray[np.uint8]:
    """Smoke about the horizon, in the view: brighter than the land to both sides of it, or darker than the sky."""
    mask = np.zeros_like(view.light)
    top = max(0, view.horizon - round(_BAND_UP * view.unit))
    rows = slice(top, view.horizon + round(_BAND_DOWN * view.unit))
    light, is_inside = view.light[rows], view.is_inside[rows]
    if rows.stop <= top or not is_inside.any():
        return mask
    sky = max(0, view.horizon - top)
    land = light[sky:][is_inside[sky:]]
    length = 2 * round(0.5 * _MAX_WIDTH_OF_PLUME * view.unit) + 1
    brighter, darker = _excess(light, is_inside, length), _excess(255 - light, is_inside, length)
    is_hazy = darker < _MAX_DARKNESS * (light + darker - (np.median(land) if land.size else 0.0))
    is_hazy[sky:] = False
    bright, dark = _stands_out(brighter, is_inside), _stands_out(darker, is_inside) & is_hazy
    mask[rows] = _plumes(bright, sky, view.unit, _MIN_DEPTH_OF_BRIGHT)
    mask[rows] |= _plumes(dark, sky, view.unit, -_MAX_RISE_OF_DARK)
    crossing = np.ones((2 * round(0.5 * _CROSSING * view.unit) + 1, 1), np.uint8)
    across = cv2.morphologyEx((bright | dark).astype(np.uint8), cv2.MORPH_CLOSE, crossing)
    mask[rows] |= _plumes(across > 0, sky, view.unit, _MIN_DEPTH_OF_BRIGHT)
    return np.asarray(cv2.morphologyEx(mask, cv2.MORPH_CLOSE, crossing))


def _excess(light: NDArray[np.uint8], is_inside: NDArray[np.bool_], length: int) -> NDArray[np.float32]:
    """Levels (h, w) above both sides within a length: the top-hat along each row.

    What lies outside the frame counts as bright, so that nothing stands out that is seen against one side only.
    """
    row = np.ones((1, length), np.uint8)
    seen = np.where(is_inside, light, 255).astype(np.uint8)
    eroded = cv2.erode(seen, row, borderType=cv2.BORDER_CONSTANT, borderValue=255)
    return np.where(is_inside, seen - cv2.dilate(eroded, row), 0).astype(np.float32)


def _stands_out(excess: NDArray[np.float32], is_inside: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Where the excess is more than visible and more than what is usual in its row."""
    mean = excess.sum(axis=1) / np.maximum(np.count_nonzero(is_inside, axis=1), 1)
    return np.asarray(excess > np.maximum(_MIN_CONTRAST, _CONTRAST_FACTOR * mean)[:, None])


def _plumes(found: NDArray[np.bool_], horizon: int, unit: int, min_depth: float) -> NDArray[np.uint8]:
    """The segments that stand up from at least `min_depth` below the horizon's row, and high for where they stand."""
    labels, stats = _segments(found, np.ones((3, 3), np.uint8))
    _, top, width, height, area = stats.T
    depth = top + height - horizon
    is_large = (area >= _MIN_AREA * unit**2) & (height >= _MIN_SLENDERNESS * width)
    return _union(labels, is_large & (top > 0) & (depth >= min_depth * unit) & (height >= _MIN_RISE * depth))


def _segments(found: NDArray[np.bool_], least: NDArray[np.uint8]) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """Labels (h, w) of what holds the least shape, and what OpenCV tells of each (N, 5); 0 is what is not found."""
    opened = cv2.morphologyEx(found.astype(np.uint8), cv2.MORPH_OPEN, least)
    _, labels, stats, _ = cv2.connectedComponentsWithStats(opened, connectivity=8)
    return np.asarray(labels, dtype=np.int32), np.asarray(stats, dtype=np.int32)


def _union(labels: NDArray[np.int32], is_kept: NDArray[np.bool_]) -> NDArray[np.uint8]:
    """A mask (h, w), 0 or 255, of the segments that are kept."""
    values = np.where(is_kept, 255, 0).astype(np.uint8)
    values[0] = 0
    return np.asarray(values[labels])


def _divisor(width: int, height: int) -> int:
    """The smallest whole number that divides both sizes and leaves at most `_MAX_WIDTH` columns; 1 if none does."""
    found = (
        k for k in range(1, min(width, height) // 8 + 1) if width % k == 0 == height % k and width // k <= _MAX_WIDTH
    )
    return next(found, 1)
