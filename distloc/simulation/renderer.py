"""Draws what a camera would see of sky, ground and smoke plumes; the demo and the tests use it."""

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from distloc.geometry.camera import Camera
from distloc.simulation.plume import Plume, PlumePainter
from distloc.types import CameraPose

__all__ = ["HAZE_BGR", "HAZE_RANGE_M", "Plume", "Renderer"]

HAZE_BGR = np.array([222.0, 212.0, 200.0])
_ZENITH_BGR = np.array([205.0, 150.0, 95.0])
_FOREST_BGR = np.array([42.0, 66.0, 50.0])
_FIELD_BGR = np.array([66.0, 104.0, 96.0])
HAZE_RANGE_M = 6_500.0
_MASK_ALPHA = 0.35
_CELLS_M = (2.0, 6.0, 25.0, 150.0, 700.0)  # the sizes of the ground's patches, from tree crowns to stands and fields
_TILE = 256


class Renderer:
    """A camera in a made-up landscape: the ground plane at `ground_height_m`, haze, and plumes.

    The landscape is fixed to the earth and is drawn from `rng` once, so frames depend on the pose alone.
    """

    def __init__(
        self, camera: Camera, plumes: Sequence[Plume], rng: np.random.Generator, ground_height_m: float = 0.0
    ) -> None:
        self._camera = camera
        self._ground_height_m = ground_height_m
        self._painters = [PlumePainter(plume, rng) for plume in plumes]
        self._textures = [_tile(rng) for _ in _CELLS_M]
        self._grain = rng.normal(0.0, 1.6, (camera.height, camera.width, 1)).astype(np.float32)
        # the background is drawn at half size: it is hazy, and four times fewer rays are four times faster
        self._size = ((camera.width + 1) // 2, (camera.height + 1) // 2)
        u = (np.arange(self._size[0]) + 0.5) * camera.width / self._size[0] - 0.5
        v = (np.arange(self._size[1]) + 0.5) * camera.height / self._size[1] - 0.5
        grid = np.stack(np.meshgrid(u, v)).reshape(2, -1)
        self._rays = np.ascontiguousarray(camera.rays(grid), dtype=np.float32)
        self._sky = _sky_table()

    def render(self, pose: CameraPose) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
        """The image (H, W, 3) BGR at a pose, and the smoke's mask (H, W), 255 where the plumes hide over a third."""
        background = self._background(pose)
        size = (self._camera.width, self._camera.height)
        picture = cv2.resize(background, size, interpolation=cv2.INTER_LINEAR) + self._grain
        image = np.clip(picture, 0.0, 255.0).astype(np.uint8)
        alpha = np.zeros((self._camera.height, self._camera.width), np.float32)
        for painter in self._painters:
            painter.paint(self._camera, pose, HAZE_BGR, HAZE_RANGE_M, image, alpha)
        return image, np.where(alpha > _MASK_ALPHA, 255, 0).astype(np.uint8)

    def _background(self, pose: CameraPose) -> NDArray[np.float32]:
        rays = pose.R_cam_from_enu.T.astype(np.float32) @ self._rays
        index = np.clip((rays[2] + 0.25) * 1000.0, 0.0, len(self._sky) - 1.0).astype(np.int32)
        picture = self._sky[index]
        height_m = float(pose.position_enu_m[2]) - self._ground_height_m
        ground = np.flatnonzero(rays[2] < -1e-4)
        if height_m > 0.1 and ground.size:
            picture[ground] = self._ground(rays[:, ground], height_m, pose)
        return np.asarray(picture.reshape(self._size[1], self._size[0], 3))

    def _ground(self, rays: NDArray[np.float32], height_m: float, pose: CameraPose) -> NDArray[np.float32]:
        """Colours (N, 3) where rays (3, N), all downwards, meet the ground."""
        range_m = np.minimum(height_m / -rays[2], 60_000.0).astype(np.float32)
        east = np.float32(pose.position_enu_m[0]) + range_m * rays[0]
        north = np.float32(pose.position_enu_m[1]) + range_m * rays[1]
        # the length of ground that one pixel covers, geometric mean of along and across the view
        covered_m = 2.0 * range_m / self._camera.fx * np.sqrt(range_m / height_m)
        kind = np.zeros_like(range_m)
        light = np.ones_like(range_m)
        for cell_m, texture in zip(_CELLS_M, self._textures, strict=True):
            seen = np.clip(1.6 - covered_m / cell_m, 0.0, 1.0)
            noise = _sampled(texture, east / cell_m, north / cell_m) * seen
            if cell_m > 100.0:
                kind += noise
            else:
                light += np.float32(0.16) * noise
        field = np.clip(kind * 1.2 - 0.9, 0.0, 1.0)[:, None]
        colour = (_FOREST_BGR.astype(np.float32) * (1.0 - field) + _FIELD_BGR.astype(np.float32) * field) * light[
            :, None
        ]
        clear = np.exp(-range_m / np.float32(HAZE_RANGE_M))[:, None]
        return np.asarray(colour * clear + HAZE_BGR.astype(np.float32) * 0.93 * (1.0 - clear), dtype=np.float32)


def _sampled(texture: NDArray[np.float32], x: NDArray[np.float32], y: NDArray[np.float32]) -> NDArray[np.float32]:
    """A periodic texture (S, S) at cells (N,), bilinear."""
    period = np.float32(_TILE)
    x, y = x - period * np.floor(x / period), y - period * np.floor(y / period)
    rows = -(-x.size // _TILE)
    padded = np.zeros((2, rows * _TILE), np.float32)
    padded[0, : x.size], padded[1, : x.size] = x, y
    picked = cv2.remap(
        texture,
        padded[0].reshape(rows, _TILE),
        padded[1].reshape(rows, _TILE),
        cv2.INTER_LINEAR,
        borderMode=cv2.BORDER_WRAP,
    )
    return np.asarray(picked.reshape(-1)[: x.size], dtype=np.float32)


def _tile(rng: np.random.Generator) -> NDArray[np.float32]:
    """Periodic smooth noise (S, S) of unit variance, one bump a cell or two."""
    noise = np.tile(rng.normal(size=(_TILE, _TILE)), (3, 3))
    smooth = cv2.GaussianBlur(noise, (0, 0), 0.9)[_TILE : 2 * _TILE, _TILE : 2 * _TILE]
    return np.asarray(smooth / smooth.std(), dtype=np.float32)


def _sky_table() -> NDArray[np.float32]:
    """The sky's colour (N, 3) by sine of elevation from -0.25 in steps of 0.001."""
    sine = np.arange(1251) / 1000.0 - 0.25
    blue = (1.0 - np.exp(-np.clip(sine, 0.0, 1.0) / 0.22))[:, None]
    return np.asarray(HAZE_BGR * (1.0 - blue) + _ZENITH_BGR * blue, dtype=np.float32)
