"""Small pieces of images, found again under affine warps: what keeps a corner the same corner as it ages.

Inverse compositional (Baker and Matthews 2004), on brightness freed of its mean and contrast, all patches at once.
"""

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from distloc.snapshot import Float32Array
from distloc.types import BoolArray, FloatArray

SIDE = 17  # pixels
_ITERATIONS = 6
_SETTLED_PX = 0.01
_LEAST_CONTRAST = 2.0  # grey levels
_AXIS = np.arange(SIDE, dtype=np.float64) - SIDE // 2
_X, _Y = (axis.reshape(-1) for axis in np.meshgrid(_AXIS, _AXIS))


class Patches:
    """A pool of `most` patches."""

    def __init__(self, most: int) -> None:
        self._values = np.zeros((most, SIDE * SIDE), np.float32)
        self._update = np.zeros((most, 6, SIDE * SIDE), np.float32)  # of the warp, by the difference
        self.warp = np.zeros((most, 2, 2))
        self.is_good = np.zeros(most, dtype=np.bool_)

    def take(self, slots: NDArray[np.intp], grey: NDArray[np.uint8], pixels: FloatArray) -> None:
        """Remember what is about pixels (2, n); `is_good` where it can be found again."""
        identity = np.broadcast_to(np.eye(2), (slots.size, 2, 2))
        raw = _sampled(grey, pixels, identity, SIDE + 2).astype(np.float64).reshape(-1, SIDE + 2, SIDE + 2)
        inner = raw[:, 1:-1, 1:-1].reshape(slots.size, -1)
        values, contrast = _normalised(inner)
        dx = (raw[:, 1:-1, 2:] - raw[:, 1:-1, :-2]).reshape(slots.size, -1) / 2.0 / contrast[:, None]
        dy = (raw[:, 2:, 1:-1] - raw[:, :-2, 1:-1]).reshape(slots.size, -1) / 2.0 / contrast[:, None]
        J = np.stack([dx * _X, dx * _Y, dy * _X, dy * _Y, dx, dy], axis=1)
        J -= J.mean(axis=2, keepdims=True)
        H = J @ J.transpose(0, 2, 1)
        scale = np.sqrt(np.maximum(np.einsum("nii->ni", H), 1e-12))
        whitened = H / scale[:, :, None] / scale[:, None] + 1e-6 * np.eye(6)
        self._update[slots] = np.linalg.solve(whitened, J / scale[:, :, None]) / scale[:, :, None]
        self._values[slots] = values
        self.warp[slots] = np.eye(2)
        self.is_good[slots] = contrast > _LEAST_CONTRAST

    def find(
        self, slots: NDArray[np.intp], grey: NDArray[np.uint8], near_px: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Where they are, near pixels (2, n): pixels (2, n) and the correlation (n,) there; the warps are kept."""
        at, warp, update, known = near_px.copy(), self.warp[slots], self._update[slots], self._values[slots]
        for _ in range(_ITERATIONS):
            values, _ = _normalised(_sampled(grey, at, warp, SIDE))
            step = (update @ (values - known)[:, :, None])[:, :, 0].astype(np.float64)
            turn = step[:, :4].reshape(-1, 2, 2)
            inverse = _inverse(np.eye(2) + np.clip(turn, -0.3, 0.3))
            shift = np.clip(step[:, 4:], -2.0, 2.0)
            warp = warp @ inverse
            at -= np.einsum("nij,nj->in", warp, shift)
            if np.abs(shift).max(initial=0.0) < _SETTLED_PX:
                break
        values, _ = _normalised(_sampled(grey, at, warp, SIDE))
        self.warp[slots] = warp
        return at, np.einsum("ni,ni->n", values, known).astype(np.float64) / (SIDE * SIDE)


def is_sane(warp: FloatArray) -> BoolArray:
    """Which warps (n, 2, 2) are what another view of the same place makes."""
    singular = np.linalg.svd(warp, compute_uv=False)
    return np.asarray((singular[:, 0] < 2.5) & (singular[:, 1] > 0.4))


def _sampled(grey: NDArray[np.uint8], pixels: FloatArray, warp: FloatArray, side: int) -> Float32Array:
    """Grey levels (n, side^2) about pixels (2, n) through warps (n, 2, 2)."""
    axis = np.arange(side, dtype=np.float64) - side // 2
    grid = np.ones((3, side * side), np.float32)
    grid[0], grid[1] = (one.reshape(-1) for one in np.meshgrid(axis, axis))
    to_image = np.concatenate([warp, pixels.T[:, :, None]], axis=2).astype(np.float32)
    u, v = to_image[:, 0] @ grid, to_image[:, 1] @ grid
    return cv2.remap(grey, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE).astype(np.float32)


def _normalised(values: NDArray[Any]) -> tuple[NDArray[Any], NDArray[Any]]:
    """Of mean 0 and standard deviation 1 (n, m), and what that was (n,)."""
    centred = values - values.mean(axis=1, keepdims=True)
    contrast = np.maximum(np.sqrt(np.square(centred).mean(axis=1)), 1e-3)
    return centred / contrast[:, None], contrast


def _inverse(A: FloatArray) -> FloatArray:
    """Of matrices (n, 2, 2)."""
    turned = np.empty_like(A)
    turned[:, 0, 0], turned[:, 0, 1], turned[:, 1, 0], turned[:, 1, 1] = (
        A[:, 1, 1],
        -A[:, 0, 1],
        -A[:, 1, 0],
        A[:, 0, 0],
    )
    return turned / (A[:, 0, 0] * A[:, 1, 1] - A[:, 0, 1] * A[:, 1, 0])[:, None, None]
