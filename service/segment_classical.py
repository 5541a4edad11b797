"""Smoke from colour alone, without a trained model: what differs from its own elevation's background.

A fallback where no model is given. Below the horizon smoke is brighter and greyer than the land, above it greyer than
the sky; it stands on the ground, so a segment must reach below the horizon.
"""

import cv2
import numpy as np
from numpy.typing import NDArray

from distloc.camera import Camera
from distloc.types import CameraPose, RejectReason
from service.messages import Frame

_MAX_WIDTH = 640
_BAND_LOW_RAD, _BAND_HIGH_RAD = np.radians(-12.0), np.radians(8.0)
_BIN_RAD = np.radians(0.25)
_HORIZON_RAD = np.radians(0.3)  # the pose's error: a segment must reach below the horizon less this
_MIN_AREA_SHARE = 0.0003
_MAX_WIDTH_SHARE = 0.6  # a wider segment is a bank of haze or a cloud
_MIN_CONTRAST = 10.0  # levels of 255 in brightness or greyness, however quiet the background
_MAD_FACTOR = 3.5
_WEAK_LEVEL = 0.5  # of the thresholds above: what hangs together with strong pixels
_HAZE_RAD = np.radians(1.5)
_LEAST_HORIZON = 0.6  # of the columns must agree on the line between sky and land
_NO_HORIZON_RAD = np.radians(-3.0)  # stands for every pixel where no horizon can be seen: all land, one background


class ClassicalSegmenter:
    """Works at a whole fraction of the camera's size; its masks have that size."""

    def __init__(self, camera: Camera, flood_share: float) -> None:
        self.name = "classical"
        self._camera = camera
        self._flood_share = flood_share
        self._divisor = _divisor(camera.width, camera.height)
        width, height = camera.width // self._divisor, camera.height // self._divisor
        self._size = (width, height)
        offset = 0.5 * (self._divisor - 1)
        u, v = (np.arange(side, dtype=np.float64) * self._divisor + offset for side in (width, height))
        grid = np.stack(np.meshgrid(u, v)).reshape(2, -1)
        self._rays = camera.rays(grid).astype(np.float32)

    def segment(self, frame: Frame, pose: CameraPose | None) -> NDArray[np.uint8] | RejectReason:
        """The smoke in a frame; BAD_FRAME without an image, SEGMENTATION_FLOODED where too much looks like smoke."""
        if frame.image is None or frame.image.ndim != 3 or frame.image.shape[2] != 3 or frame.image.size == 0:
            return RejectReason.BAD_FRAME
        small = np.asarray(cv2.resize(frame.image, self._size, interpolation=cv2.INTER_AREA), dtype=np.uint8)
        elevation = _elevation_by_eye(small, self._camera.fy / self._divisor) if pose is None else self._elevation(pose)
        smoke, seeds = _candidates(np.asarray(cv2.GaussianBlur(small, (0, 0), 1.0), dtype=np.uint8), elevation)
        if is_flooded(smoke, self._flood_share):
            return RejectReason.SEGMENTATION_FLOODED
        return _coherent(smoke, seeds, elevation)

    def _elevation(self, pose: CameraPose) -> NDArray[np.float32]:
        sine = pose.R_cam_from_enu[:, 2].astype(np.float32) @ self._rays
        return np.asarray(np.arcsin(np.clip(sine, -1.0, 1.0)), dtype=np.float32).reshape(self._size[1], self._size[0])


def is_flooded(mask: NDArray[np.uint8], flood_share: float) -> bool:
    """Whether more than a share of the mask is set: then the segmenter has failed, whatever there is to see."""
    return bool(cv2.countNonZero(mask) > flood_share * mask.size)


def _candidates(
    image: NDArray[np.uint8], elevation: NDArray[np.float32]
) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
    """Pixels (h, w), 0 or 255, in the band about the horizon that stand out as smoke does: weakly, and strongly."""
    pixels = image.astype(np.float32)
    light = pixels.mean(axis=2)
    colour = pixels.max(axis=2) - pixels.min(axis=2)
    inside = (elevation > _BAND_LOW_RAD) & (elevation < _BAND_HIGH_RAD)
    bins = np.floor((elevation - _BAND_LOW_RAD) / _BIN_RAD).astype(np.int32)
    light_z, light_d = _deviation(light, bins, inside)
    colour_z, colour_d = _deviation(colour, bins, inside)
    near = elevation > -_HAZE_RAD  # so near the horizon the land is as bright as smoke, but not quite as grey

    def standing_out(level: float) -> NDArray[np.uint8]:
        least = level * _MIN_CONTRAST
        bright = (light_z > level) & (light_d > least) & (colour_d < 0.25 * light_d) & (colour < 60.0)
        greyer = (colour_z < -level) & (colour_d < -0.5 * least)
        darker = (light_z < -level) & (light_d < -least) & (colour < 70.0) & (light > 70.0)
        smoke = inside & np.where(elevation < 0.0, bright | (near & greyer & (light > 110.0)), greyer | darker)
        return np.where(smoke, 255, 0).astype(np.uint8)

    return standing_out(_WEAK_LEVEL), standing_out(1.0)


def _deviation(
    feature: NDArray[np.float32], bins: NDArray[np.int32], inside: NDArray[np.bool_]
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """A feature less its elevation's median: over `_MAD_FACTOR` robust deviations, and in levels; 0 outside."""
    z, difference = np.zeros_like(feature), np.zeros_like(feature)
    places = np.flatnonzero(inside)
    if places.size == 0:
        return z, difference
    order = places[np.argsort(bins.ravel()[places], kind="stable")]
    ends = np.flatnonzero(np.diff(bins.ravel()[order])) + 1
    for group in np.split(order, ends):
        values = feature.ravel()[group]
        median = np.median(values)
        spread = 1.4826 * np.median(np.abs(values - median))
        difference.ravel()[group] = values - median
        z.ravel()[group] = (values - median) / (_MAD_FACTOR * max(float(spread), 1.0))
    return z, difference


def _coherent(smoke: NDArray[np.uint8], seeds: NDArray[np.uint8], elevation: NDArray[np.float32]) -> NDArray[np.uint8]:
    """The segments (h, w) with strong pixels enough that are no band across the frame and stand on the ground."""
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (3, 3))
    joined = cv2.morphologyEx(cv2.morphologyEx(smoke, cv2.MORPH_OPEN, kernel), cv2.MORPH_CLOSE, kernel, iterations=2)
    count, labels, stats, _ = cv2.connectedComponentsWithStats(joined, connectivity=8)
    mask = np.zeros_like(smoke)
    for label in range(1, count):
        x, y, width, height, area = stats[label]
        box = (slice(y, y + height), slice(x, x + width))
        part = labels[box] == label
        strong = int(np.count_nonzero(part & (seeds[box] > 0)))
        is_large = strong >= max(12.0, _MIN_AREA_SHARE * smoke.size) and strong > 0.25 * area
        is_plume = width <= _MAX_WIDTH_SHARE * smoke.shape[1] and height >= 0.4 * width and area > 0.35 * width * height
        if is_large and is_plume and float(elevation[box][part].min()) < -_HORIZON_RAD:
            mask[box][part] = 255
    return mask


def _elevation_by_eye(image: NDArray[np.uint8], fy_px: float) -> NDArray[np.float32]:
    """Elevations (h, w) from the line between a bright sky and a darker land; one for all where there is none."""
    height, width = image.shape[:2]
    blue = cv2.GaussianBlur(image[..., 0], (0, 0), 2.0).astype(np.float32)
    step = max(2, height // 60)
    drop = np.zeros((height, width), np.float32)
    drop[step:-step] = blue[: -2 * step] - blue[2 * step :]
    u = np.arange(width, dtype=np.float64)
    v = drop.argmax(axis=0).astype(np.float64)
    kept = drop.max(axis=0) > 15.0
    line, near = np.array([0.0, float(np.median(v))]), kept
    for tolerance in (height / 4, height / 8, height / 16, height / 30):
        near = kept & (np.abs(v - np.polyval(line, u)) < tolerance)
        if near.sum() < _LEAST_HORIZON * width:
            return np.full((height, width), _NO_HORIZON_RAD, np.float32)
        line = np.polyfit(u, v, 1, w=near.astype(np.float64))
    rows = np.arange(height, dtype=np.float64)[:, None] - np.polyval(line, u)[None, :]
    return np.arctan(-rows / fy_px).astype(np.float32)


def _divisor(width: int, height: int) -> int:
    """The smallest whole number that divides both sizes and leaves at most `_MAX_WIDTH` columns; 1 if none does."""
    found = (
        k for k in range(1, min(width, height) // 8 + 1) if width % k == 0 == height % k and width // k <= _MAX_WIDTH
    )
    return next(found, 1)
