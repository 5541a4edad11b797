"""Smoke as opacity and brightness on a canvas: columns, leaning and sheared plumes, puffs and veils."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from landscapes import fractal

SIDE = 192
FILLED = 0.66  # of a canvas' side, by the plume
LEAST_PX, MOST_PX = 14.0, 300.0  # how large plumes are drawn


@dataclass(frozen=True, slots=True)
class PlumeCanvas:
    """Opacity and brightness (SIDE, SIDE), 0 to 1, of a plume whose foot is at `foot` (x, y) on the canvas.

    `most_px` is how large it may be drawn.
    """

    opacity: NDArray[np.float32]
    shade: NDArray[np.float32]
    foot: tuple[float, float]
    most_px: float = MOST_PX


def draw_plume(rng: np.random.Generator) -> PlumeCanvas:
    """One plume of any shape; its foot is low on the canvas, it leans left or right."""
    count = 160
    share = np.sort(rng.uniform(0.0, 1.0, count)) ** rng.uniform(0.6, 1.3)
    lean = rng.normal(0.0, 0.9)
    power = rng.uniform(0.7, 2.6)  # bends over: the wind grows with height, or the plume slows
    rise = rng.uniform(0.25, 1.0) if rng.random() < 0.8 else rng.uniform(0.08, 0.25)
    x = lean * share**power
    y = -rise * share ** rng.uniform(0.6, 1.3)
    spread = rng.uniform(0.01, 0.06) + rng.uniform(0.05, 0.32) * share ** rng.uniform(0.5, 1.2)
    x += rng.normal(0.0, 0.5, count) * spread
    y += rng.normal(0.0, 0.35, count) * spread
    radius = spread * rng.uniform(0.35, 0.9, count)
    fade = np.exp(-share * rng.uniform(0.0, 2.5)) * np.clip((1.0 - share) / 0.15, 0.0, 1.0) ** 0.5
    extent = max(np.ptp(x) + 0.2, np.ptp(y) + 0.15)
    scale = FILLED * SIDE / extent
    left, top = (x - radius).min(), (y - radius).min()
    px, py = (x - left) * scale + 0.17 * SIDE, (y - top) * scale + 0.17 * SIDE
    foot = ((0.0 - left) * scale + 0.17 * SIDE, (0.0 - top) * scale + 0.17 * SIDE)
    depth, light = np.zeros((SIDE, SIDE), np.float32), np.zeros((SIDE, SIDE), np.float32)
    for u, v, r, weight in zip(px, py, np.maximum(radius * scale, 0.8), fade, strict=True):
        u0, u1 = max(0, int(u - 2.2 * r)), min(SIDE, int(u + 2.2 * r) + 2)
        v0, v1 = max(0, int(v - 2.2 * r)), min(SIDE, int(v + 2.2 * r) + 2)
        if u1 <= u0 or v1 <= v0:
            continue
        dx = (np.arange(u0, u1, dtype=np.float32) - u) / r
        dy = (np.arange(v0, v1, dtype=np.float32) - v) / r
        puff = np.float32(weight) * np.exp(-np.square(dx)[None, :] - np.square(dy)[:, None])
        depth[v0:v1, u0:u1] += puff
        light[v0:v1, u0:u1] += puff * np.clip(-0.4 * dy[:, None] - 0.25 * dx[None, :], -1.0, 1.0)
    turbulence = fractal(rng, (SIDE, SIDE), rng.uniform(5.0, 14.0), 5, 0.6)
    warp = rng.uniform(1.0, 6.0)
    columns, rows = np.meshgrid(np.arange(SIDE, dtype=np.float32), np.arange(SIDE, dtype=np.float32))
    shift = [warp * fractal(rng, (SIDE, SIDE), 8.0, 4) for _ in range(2)]
    depth, light = (cv2.remap(one, columns + shift[0], rows + shift[1], cv2.INTER_LINEAR) for one in (depth, light))
    depth *= np.exp(rng.uniform(0.1, 0.8) * turbulence)
    opacity = (1.0 - np.exp(-depth * rng.uniform(0.5, 3.0))) * _window()
    shade = 0.85 + rng.uniform(0.05, 0.3) * light / np.maximum(depth, 0.3) + rng.uniform(0.0, 0.08) * turbulence
    return PlumeCanvas(opacity.astype(np.float32), np.clip(shade, 0.4, 1.15).astype(np.float32), foot)


def _window() -> NDArray[np.float32]:
    """One inside, falling to zero at the canvas' edge (SIDE, SIDE)."""
    edge = np.clip(np.minimum(np.arange(SIDE), np.arange(SIDE)[::-1]) / 14.0, 0.0, 1.0).astype(np.float32)
    return edge[:, None] * edge[None, :]
