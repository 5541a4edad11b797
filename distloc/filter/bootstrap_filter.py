"""The paper's bootstrap particle filter, as ALGORITHMS and the paper's section "Particle Filter" give it.

Its spread is not a calibrated uncertainty: it takes the poses as exact. Called by the localizer.
"""

import cv2
import numpy as np
from numpy.typing import NDArray

from distloc.filter.resample import systematic_indices
from distloc.geometry.camera import Camera
from distloc.sights.detections import checked_mask, detections_from_mask
from distloc.types import CameraPose, FloatArray, MaskArray

# exp(-27.5^2) is 0 in float64: beyond this many pixels from a positive pixel a weight is exactly none.
_REACH_PX = 28


class BootstrapFilter:
    """N particles of one static target; `particles_enu_m` is (3, N), all equally likely after a step.

    `step` starts it at the first mask with a segment. `misses` counts updates in a row in which no particle matched the
    mask's positive pixels; who owns the filter dismisses it.
    """

    def __init__(
        self,
        camera: Camera,
        n_particles: int,
        particle_sigma_m: float,
        rng: np.random.Generator,
        range_m: tuple[float, float] = (50.0, 30_000.0),
    ) -> None:
        if n_particles < 1 or particle_sigma_m < 0 or not 0 < range_m[0] < range_m[1]:
            raise ValueError(
                "n_particles must be >= 1, particle_sigma_m >= 0 and range_m rising above 0, "
                f"got {n_particles}, {particle_sigma_m}, {range_m}"
            )
        self.particles_enu_m: FloatArray = np.zeros((3, n_particles))
        self.misses = 0
        self.is_started = False
        self._camera = camera
        self._sigma_m = particle_sigma_m
        self._rng = rng
        self._range_m = range_m
        self._noise = np.empty((3, n_particles))

    def step(self, pose: CameraPose, mask: MaskArray) -> bool | None:
        """Predict, and update where the mask is positive; True if it matched, None if there was nothing to match."""
        if not self.is_started:
            detections = detections_from_mask(mask, self._camera)
            if not detections:
                return None
            self.start(pose, detections[0].centre_px)
        self.predict()
        return self.update(pose, mask)

    def start(self, pose: CameraPose, pixel: FloatArray) -> None:
        """Spread the particles uniformly along the ray through a pixel (2,)."""
        ray_enu = pose.R_cam_from_enu.T @ self._camera.rays(np.asarray(pixel).reshape(2, 1))[:, 0]
        distances_m = self._rng.uniform(*self._range_m, size=self.particles_enu_m.shape[1])
        np.multiply(ray_enu[:, None], distances_m, out=self.particles_enu_m)
        self.particles_enu_m += pose.position_enu_m[:, None]
        self.is_started, self.misses = True, 0

    def predict(self) -> None:
        """Add independent Gaussian noise of sigma_p on each axis."""
        self._rng.standard_normal(out=self._noise)
        self._noise *= self._sigma_m
        self.particles_enu_m += self._noise

    def update(self, pose: CameraPose, mask: MaskArray) -> bool | None:
        """Weigh by exp(-min d^2) and resample; None for an empty mask, False where every particle's weight is none."""
        pixels, scale = checked_mask(mask, self._camera)
        box = cv2.boundingRect(pixels)
        if box[2] == 0:
            return None
        weights = self._weights(pose, pixels, scale, box)
        if not weights.sum() > 0:
            self.misses += 1
            return False
        self.misses = 0
        np.copyto(self.particles_enu_m, self.particles_enu_m[:, systematic_indices(weights, self._rng.random())])
        return True

    def _weights(
        self, pose: CameraPose, mask: NDArray[np.uint8], scale: int, box: tuple[int, int, int, int] | cv2.typing.Rect
    ) -> FloatArray:
        """exp(-min d^2) (N,), d in the camera's pixels to the nearest positive pixel's centre."""
        points_cam_m = pose.R_cam_from_enu @ (self.particles_enu_m - pose.position_enu_m[:, None])
        projected, visible = self._camera.project(points_cam_m)
        offset = (scale - 1) / 2.0
        u, v = (projected - offset) / scale
        left, top, right, bottom = _reachable(box, u[visible], v[visible], -(-_REACH_PX // scale) + 1, mask.shape)
        weights = np.zeros(projected.shape[1])
        if left >= right or top >= bottom or not mask[top:bottom, left:right].any():
            return weights
        crop = mask[top:bottom, left:right]
        nearest_u, nearest_v = _nearest_positive(crop)
        u, v = u - left, v - top
        near = visible & (u > -1) & (u < crop.shape[1]) & (v > -1) & (v < crop.shape[0])
        u, v = u[near], v[near]
        squared_px2 = np.full(u.shape, np.inf)
        for column, row in ((np.floor, np.floor), (np.floor, np.ceil), (np.ceil, np.floor), (np.ceil, np.ceil)):
            # the positive pixel nearest to a point is (but for the chamfer transform's ties) that of a pixel around it
            j = np.clip(column(u), 0, crop.shape[1] - 1).astype(np.intp)
            i = np.clip(row(v), 0, crop.shape[0] - 1).astype(np.intp)
            np.minimum(squared_px2, (u - nearest_u[i, j]) ** 2 + (v - nearest_v[i, j]) ** 2, out=squared_px2)
        weights[near] = np.exp(-squared_px2 * scale**2)
        return weights


def _reachable(
    box: tuple[int, int, int, int] | cv2.typing.Rect, u: FloatArray, v: FloatArray, reach: int, shape: tuple[int, ...]
) -> tuple[int, int, int, int]:
    """Left, top, right and bottom of where positive pixels can lie within reach of a particle, in the mask."""
    if u.size == 0:
        return 0, 0, 0, 0
    x, y, width, height = box
    left, right = max(0, x - reach, int(u.min()) - reach), min(shape[1], x + width + reach, int(u.max()) + reach + 1)
    top, bottom = max(0, y - reach, int(v.min()) - reach), min(shape[0], y + height + reach, int(v.max()) + reach + 1)
    return left, top, right, bottom


def _nearest_positive(crop: NDArray[np.uint8]) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """For each pixel (h, w), column and row of the nearest positive pixel."""
    rows, columns = np.nonzero(crop)
    inverse = np.where(crop > 0, np.uint8(0), np.uint8(255))
    _, labels = cv2.distanceTransformWithLabels(inverse, cv2.DIST_L2, cv2.DIST_MASK_5, labelType=cv2.DIST_LABEL_PIXEL)
    column_of_label = np.zeros(rows.size + 1, dtype=np.int32)
    row_of_label = np.zeros(rows.size + 1, dtype=np.int32)
    own = labels[rows, columns]
    column_of_label[own], row_of_label[own] = columns, rows
    return column_of_label[labels], row_of_label[labels]
