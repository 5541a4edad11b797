"""A static point from the directions in which it was seen: the paper's multi-view triangulation, plain and robust.

The study calls both; they know no noise of the poses and give no uncertainty.
"""

from collections.abc import Sequence

import numpy as np

from distloc.geometry.camera import Camera
from distloc.types import BoolArray, CameraPose, FloatArray, RejectReason

_MIN_PARALLAX_PX = 0.5  # under half a pixel between the views, a segment's centre says nothing about the range
_LEAST_GATE_PX = 2.0  # the paper's gate; pixels are whole
_LEAST_SIGNIFICANCE = 3.0  # standard deviations from a point at infinity: with fewer the range is not known


def triangulate_dlt(camera: Camera, poses: Sequence[CameraPose], pixels: FloatArray) -> FloatArray | RejectReason:
    """The point (3,) in ENU that a direct linear transform finds for `pixels` (2, N), one for each of N poses.

    The paper's two rows y3 (M1 x) - y1 (M3 x) = 0 and y2 (M3 x) - y3 (M2 x) = 0 for each view, least squares by SVD.
    Conditioned: undistorted rays in place of pixels, rows of unit length, points about the cameras' mean in units of
    their spread (Hartley and Zisserman, 4.4); in these units the algebraic error is near the angular one, and noisy
    rays do not pull the point towards the cameras. Returns ONE_VIEW, NO_BASELINE or BEHIND_CAMERA where the geometry
    does not give a point.
    """
    views = _Views(camera, poses, pixels)
    if views.count < 2:
        return RejectReason.ONE_VIEW
    if not views.has_baseline:
        return RejectReason.NO_BASELINE
    return views.point(np.ones(views.count, dtype=np.bool_))


def triangulate_ransac(
    camera: Camera,
    poses: Sequence[CameraPose],
    pixels: FloatArray,
    *,
    rng: np.random.Generator,
    gate_px: float | None = None,
    max_samples: int = 256,
) -> tuple[FloatArray | RejectReason, BoolArray]:
    """The point (3,) that most views agree on, and which of `pixels` (2, N) are its inliers (N,).

    Samples of two views; a reprojection error under `gate_px` (the paper's is 2) is an inlier, 80 % of inliers end the
    search, and the point is fitted again to the inliers by DLT. Where `gate_px` is None the gate follows from the
    noise: that set of inliers is taken which clutter, uniform over the image, would least likely give by chance
    (Moisan and Stival 2004), from the samples first and then from the fitted point until it stays the same. A frame
    may give several pixels with the same pose. Returns a reason and no inliers where there is no point: those of
    `triangulate_dlt`, NO_BASELINE also where the point is within three sigmas of one at infinity, and ALL_OUTLIERS.
    """
    if max_samples < 1 or (gate_px is not None and not gate_px > 0.0):
        raise ValueError(f"max_samples must be >= 1 and gate_px > 0 or None, got {max_samples} and {gate_px}")
    views = _Views(camera, poses, pixels)
    none = np.zeros(views.count, dtype=np.bool_)
    if views.count < 2:
        return RejectReason.ONE_VIEW, none
    if not views.has_baseline:
        return RejectReason.NO_BASELINE, none
    pairs = _pairs(views.count, max_samples, rng)
    errors_px = views.reprojection_errors_px(views.solve(pairs))
    if gate_px is None:
        point, inliers = _settled(views, errors_px)
    else:
        inliers = _consensus(errors_px, gate_px)
        point = views.point(inliers) if inliers.sum() >= min(3, views.count) else RejectReason.ALL_OUTLIERS
    if not isinstance(point, RejectReason) and views.range_significance(point, inliers) < _LEAST_SIGNIFICANCE:
        point = RejectReason.NO_BASELINE
    return (point, none) if isinstance(point, RejectReason) else (point, inliers)


def _pairs(count: int, max_samples: int, rng: np.random.Generator) -> np.ndarray[tuple[int, int], np.dtype[np.intp]]:
    """Pairs of unlike indices (S, 2): all of them where they are few."""
    if count * (count - 1) // 2 <= max_samples:
        return np.stack(np.triu_indices(count, 1), axis=1)
    first = rng.integers(0, count, max_samples)
    second = (first + rng.integers(1, count, max_samples)) % count
    return np.stack([first, second], axis=1)


def _consensus(errors_px: FloatArray, gate_px: float) -> BoolArray:
    """Inliers (N,) of the first sample with at least 80 % of them, else of the one with the most."""
    inliers = errors_px < gate_px
    counts = inliers.sum(axis=1)
    enough = np.flatnonzero(counts >= 0.8 * errors_px.shape[1])
    return np.asarray(inliers[enough[0] if enough.size else int(np.argmax(counts))])


def _settled(views: "_Views", errors_px: FloatArray) -> tuple[FloatArray | RejectReason, BoolArray]:
    """The point and its inliers (N,) once the gate and the fit agree, from the errors (S, N) of the samples."""
    inliers = np.zeros(views.count, dtype=np.bool_)
    point: FloatArray | RejectReason = RejectReason.ALL_OUTLIERS
    for _ in range(10):
        before, inliers = inliers, _least_by_chance(errors_px, views.area_px2)
        if np.array_equal(before, inliers):
            break
        point = views.point(inliers)
        if isinstance(point, RejectReason):
            break
        errors_px = views.reprojection_errors_px(point[None])
    return point, inliers


def _least_by_chance(errors_px: FloatArray, area_px2: float) -> BoolArray:
    """The inliers (N,) of errors (S, N) with the least expected number of equally good sets in clutter.

    Log of (n - 2) C(n, k) C(k, 2) alpha^(k - 2), with alpha the share of the image within the k-th least error (Moisan,
    Moulon and Monasse 2012, equation 5). All False where even the best is expected by chance.
    """
    n = errors_px.shape[1]
    ordered = np.maximum(np.sort(errors_px, axis=1), _LEAST_GATE_PX)
    if n == 2:
        return np.asarray(np.isfinite(errors_px[0]))
    k = np.arange(3, n + 1)
    log_factorial = np.concatenate([[0.0], np.cumsum(np.log(np.arange(1.0, n + 1.0)))])
    chosen = log_factorial[n] - log_factorial[k] - log_factorial[n - k] + np.log((n - 2.0) * k * (k - 1.0) / 2.0)
    share = np.minimum(np.pi * np.square(ordered[:, 2:]) / area_px2, 1.0)
    chance = chosen + (k - 2) * np.log(share)
    sample, best = np.unravel_index(int(np.argmin(chance)), chance.shape)
    if not chance[sample, best] < 0.0:
        return np.zeros(n, dtype=np.bool_)
    return np.asarray(errors_px[sample] <= ordered[sample, best + 2])


class _Views:
    """The rows of the linear system, and what a candidate point looks like from every view."""

    def __init__(self, camera: Camera, poses: Sequence[CameraPose], pixels: FloatArray) -> None:
        pixels = np.asarray(pixels, dtype=np.float64)
        if pixels.shape != (2, len(poses)):
            raise ValueError(f"pixels must be (2, {len(poses)}), one for each pose, got {pixels.shape}")
        if not np.isfinite(pixels).all():
            raise ValueError(f"pixels must be finite, got {pixels[:, ~np.isfinite(pixels).all(axis=0)][:, 0]}")
        self.count, self.area_px2 = len(poses), float(camera.width * camera.height)
        self._camera, self._pixels = camera, pixels
        if self.count < 2:
            return
        self._positions_enu_m = np.stack([pose.position_enu_m for pose in poses])  # (N, 3)
        self._R_cam_from_enu = np.stack([pose.R_cam_from_enu for pose in poses])  # (N, 3, 3)
        self._origin_enu_m = self._positions_enu_m.mean(axis=0)
        spread_m = self._positions_enu_m - self._origin_enu_m
        self._scale_m = float(np.sqrt(np.square(spread_m).sum(axis=1).mean()))
        self.has_baseline = self._scale_m > 1e-6
        if not self.has_baseline:
            return
        self._rays = camera.rays(pixels).T
        x, y, z = self._rays.T
        M = self._R_cam_from_enu
        across = z[:, None] * M[:, 0] - x[:, None] * M[:, 2]
        upright = y[:, None] * M[:, 2] - z[:, None] * M[:, 1]
        normals = np.stack([across, upright], axis=1)  # (N, 2, 3)
        normals /= np.linalg.norm(normals, axis=2, keepdims=True)
        offsets = -np.einsum("nij,nj->ni", normals, spread_m / self._scale_m)
        self._rows = np.concatenate([normals, offsets[:, :, None]], axis=2)  # (N, 2, 4)

    def solve(self, samples: np.ndarray[tuple[int, int], np.dtype[np.intp]]) -> FloatArray:
        """A point (S, 3) for each sample (S, n) of views; not finite where a sample meets at infinity."""
        rows = self._rows[samples].reshape(samples.shape[0], -1, 4)
        x = np.linalg.svd(rows, full_matrices=False)[2][:, -1]
        weight = np.where(np.abs(x[:, 3:]) > 1e-12, x[:, 3:], np.nan)
        return np.asarray(self._origin_enu_m + self._scale_m * x[:, :3] / weight)

    def point(self, used: BoolArray) -> FloatArray | RejectReason:
        """The point (3,) of the views used (N,), or why there is none."""
        chosen = np.flatnonzero(used)
        if chosen.size < 2:
            return RejectReason.ALL_OUTLIERS
        point_enu_m = self.solve(chosen[None])[0]
        sizes = np.linalg.svd(self._rows[chosen].reshape(-1, 4), compute_uv=False)
        if not np.isfinite(point_enu_m).all() or sizes[2] < 1e-9 * sizes[0]:  # more than one point fits
            return RejectReason.NO_BASELINE
        if not (self._points_cam_m(point_enu_m[None])[0, chosen, 2] > 0.0).all():
            return RejectReason.BEHIND_CAMERA
        sight = point_enu_m - self._positions_enu_m[chosen]
        sight /= np.linalg.norm(sight, axis=1, keepdims=True)
        mean = sight.mean(axis=0) / np.linalg.norm(sight.mean(axis=0))
        parallax_rad = float(np.linalg.norm(np.cross(sight, mean), axis=1).max())
        return point_enu_m if parallax_rad * self._camera.fx >= _MIN_PARALLAX_PX else RejectReason.NO_BASELINE

    def reprojection_errors_px(self, points_enu_m: FloatArray) -> FloatArray:
        """Distance (S, N) of each point's (S, 3) projection from each view's pixel; infinite behind the camera."""
        points_cam_m = self._points_cam_m(points_enu_m)
        projected = self._camera.project(points_cam_m.reshape(-1, 3).T)[0].reshape(2, *points_cam_m.shape[:2])
        errors_px = np.hypot(*(projected - self._pixels[:, None, :]))
        return np.where(np.isfinite(errors_px), errors_px, np.inf)

    def range_significance(self, point_enu_m: FloatArray, used: BoolArray) -> float:
        """By how many standard deviations the inverse range differs from 0: how much worse is a point at infinity.

        The root of the likelihood ratio of both for Gaussian noise, whose sigma is that of the point's own errors, at
        least a pixel's rounding.
        """
        rays = np.einsum("nij,ni->nj", self._R_cam_from_enu[used], self._rays[used])
        sight = point_enu_m - self._positions_enu_m[used]
        sight /= np.linalg.norm(sight, axis=1, keepdims=True)
        mean = rays.mean(axis=0) / np.linalg.norm(rays.mean(axis=0))
        at_point, at_infinity = (
            float(np.square(np.cross(rays, towards) * self._camera.fx).sum()) for towards in (sight, mean)
        )
        variance_px2 = max(at_point / (2 * rays.shape[0] - 3), 1.0 / 12.0)
        return float(np.sqrt(max(at_infinity - at_point, 0.0) / variance_px2))

    def _points_cam_m(self, points_enu_m: FloatArray) -> FloatArray:
        """(S, N, 3)."""
        offsets_m = points_enu_m[:, None] - self._positions_enu_m[None]
        return np.asarray(np.einsum("nij,snj->sni", self._R_cam_from_enu, offsets_m))
