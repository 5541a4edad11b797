"""Periodic noise that the ground, the sky and what stands there are textured with."""

from collections.abc import Callable
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.floating[Any]]
TILE = 256


def noise_tile(rng: np.random.Generator, smooth_cells: float = 0.9) -> Floats:
    """Periodic smooth noise (TILE + 1, TILE + 1) of unit variance, its first row and column repeated at its end."""
    noise = np.tile(rng.normal(size=(TILE, TILE)), (3, 3))
    smooth = cv2.GaussianBlur(noise, (0, 0), smooth_cells)[TILE : 2 * TILE, TILE : 2 * TILE]
    return periodic(smooth / smooth.std())


def periodic(values: Floats) -> Floats:
    """A square table (S, S, ...) with its first row and column repeated at its end."""
    edge = ((0, 1), (0, 1), *([(0, 0)] * (values.ndim - 2)))
    return np.asarray(np.pad(values, edge, mode="wrap"), dtype=np.float32)


def sampled(tile: Floats, x: Floats, y: Floats) -> Floats:
    """A tile at cells x, y (R, C), bilinear and periodic."""
    period = np.float32(TILE)
    x, y = x - period * np.floor(x / period), y - period * np.floor(y / period)
    if x.size == 0:  # no sky in view
        return np.zeros_like(x)
    return np.asarray(cv2.remap(tile, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE))


def of_lists(function: Callable[[Floats, Floats], Floats], x: Floats, y: Floats) -> Floats:
    """What a function of tables (R, C) gives for lists (N,)."""
    rows = max(1, -(-x.size // TILE))
    padded = np.zeros((2, rows * TILE), np.float32)
    padded[0, : x.size], padded[1, : x.size] = x, y
    given = function(padded[0].reshape(rows, TILE), padded[1].reshape(rows, TILE))
    return np.asarray(given.reshape(-1)[: x.size])


def smoothstep(x: Floats) -> Floats:
    """0 below 0, 1 above 1, level at both ends."""
    x = np.clip(x, 0.0, 1.0)
    return np.asarray(x * x * (3.0 - 2.0 * x))
