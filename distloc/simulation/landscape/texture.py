"""Periodic noise that the ground, the sky and what stands there are textured with."""

from collections.abc import Callable

import cv2
import numpy as np
from numpy.typing import NDArray

from distloc.types import FloatArray

Float32 = NDArray[np.float32]
TILE = 256


def noise_tile(rng: np.random.Generator, smooth_cells: float = 0.9) -> Float32:
    """Periodic smooth noise (TILE + 1, TILE + 1) of unit variance, its first row and column repeated at its end."""
    noise = np.tile(rng.normal(size=(TILE, TILE)), (3, 3))
    smooth = cv2.GaussianBlur(noise, (0, 0), smooth_cells)[TILE : 2 * TILE + 1, TILE : 2 * TILE + 1]
    return np.asarray(smooth / smooth.std(), dtype=np.float32)


def sampled(tile: Float32, x: Float32, y: Float32) -> Float32:
    """A tile at cells x, y (R, C), bilinear and periodic."""
    period = np.float32(TILE)
    x, y = x - period * np.floor(x / period), y - period * np.floor(y / period)
    return np.asarray(cv2.remap(tile, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE))


def of_lists(function: Callable[[Float32, Float32], Float32], x: FloatArray, y: FloatArray) -> Float32:
    """What a function of tables (R, C) gives for lists (N,)."""
    rows = -(-x.size // TILE)
    padded = np.zeros((2, rows * TILE), np.float32)
    padded[0, : x.size], padded[1, : x.size] = x, y
    given = function(padded[0].reshape(rows, TILE), padded[1].reshape(rows, TILE))
    return np.asarray(given.reshape(-1)[: x.size])


def smoothstep(x: NDArray[np.floating]) -> NDArray[np.floating]:
    """0 below 0, 1 above 1, level at both ends."""
    x = np.clip(x, 0.0, 1.0)
    return np.asarray(x * x * (3.0 - 2.0 * x))
