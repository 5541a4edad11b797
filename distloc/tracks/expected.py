"""Where targets are expected in an image, and how surely; the tracks and their tracker ask."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from distloc.filter.bank import Bank
from distloc.filter.particles import SPREAD, Places
from distloc.geometry.camera import Camera
from distloc.geometry.rotations import crossed
from distloc.sights.sights import Ray
from distloc.snapshot import Float32Array
from distloc.types import BoolArray, CameraPose, FloatArray

_REACH_SIGMAS = 6.0
VIEW_MARGIN = 0.02  # of the image's size: so near the border it may be out of view


@dataclass(frozen=True, slots=True)
class InView:
    """k targets from a pose: range and its sigma, depth along the camera's axis, and pixel (k, 2); NaN behind it."""

    range_m: FloatArray
    range_sigma_m: FloatArray
    depth_m: FloatArray
    pixel: FloatArray


def in_view(bank: Bank, places: NDArray[np.intp], camera: Camera, pose: CameraPose) -> InView:
    """Of the clouds at these places, the attitude's bias in the pixels."""
    clouds = bank.particles.clouds
    offsets_enu_m = clouds.mean_enu_m[places] - pose.position_enu_m
    range_m = np.linalg.norm(offsets_enu_m, axis=1)
    along = (offsets_enu_m / np.maximum(range_m, 1.0)[:, None])[:, None]
    variance_m2 = (along @ clouds.covariance_enu_m2[places] @ along.swapaxes(1, 2))[:, 0, 0]
    pixels = reported_pixels(offsets_enu_m, clouds.bias_rad[places], pose.R_cam_from_enu, camera)
    depth_m = offsets_enu_m @ pose.R_cam_from_enu[2]
    return InView(range_m, np.sqrt(np.maximum(variance_m2, 0.0)), depth_m, pixels)


def reported_pixels(
    offsets_enu_m: FloatArray, bias_rad: FloatArray, R_cam_from_enu: FloatArray, camera: Camera
) -> FloatArray:
    """Where points (..., 3) off cameras appear (..., 2), by reported turns (..., 3, 3) that err by a bias (..., 3)."""
    turned = offsets_enu_m + crossed(bias_rad, offsets_enu_m)
    points = (R_cam_from_enu @ turned[..., None])[..., 0]
    pixels, _ = camera.project(points.reshape(-1, 3).T)
    return np.asarray(pixels.T.reshape(*points.shape[:-1], 2))


def may_be(bank: Bank, places: Places, pose: CameraPose, rays: list[Ray], sigma_rad: FloatArray) -> BoolArray:
    """Whether each of k targets can be what each of d rays shows (k, d): what cannot be need not be weighed.

    By how far the particles reach, each with its own bias, in tangents about the camera's axis. `sigma_rad` (k, d) is
    one standard deviation of a ray as the target's, its frame's own errors in.
    """
    x, _ = bank.particles.sampled(places, SPREAD)
    offsets_m = x[:, :3] + (bank.particles.origin_enu_m[places] - pose.position_enu_m).astype(np.float32)[:, :, None]
    bias = x[:, 3:6] * bank.particles.scale[places, :3, None].astype(np.float32)
    seen = pose.R_cam_from_enu.astype(np.float32) @ (offsets_m + _cross(bias, offsets_m))
    is_ahead = seen[:, 2] > 1.0
    tangents = seen[:, :2] / np.maximum(seen[:, 2], np.float32(1.0))[:, None]
    low = np.where(is_ahead[:, None], tangents, np.float32(np.inf)).min(axis=2)[:, None]
    high = np.where(is_ahead[:, None], tangents, np.float32(-np.inf)).max(axis=2)[:, None]
    along = pose.R_cam_from_enu @ np.array([ray.axes[2] for ray in rays]).T
    measured = (along[:2] / np.maximum(along[2], 1e-3)).T  # (d, 2)
    all_rad = np.hypot(sigma_rad, bank.seen_sigma_rad(places, pose.position_enu_m)[:, None])
    slack = _REACH_SIGMAS * all_rad * (1.0 + np.square(measured).sum(axis=1))
    is_reached = (measured >= low - slack[:, :, None]) & (measured <= high + slack[:, :, None])
    return np.asarray(is_reached.all(axis=2))


def _cross(a: Float32Array, b: Float32Array) -> Float32Array:
    """Cross products (k, 3, n)."""
    out = np.empty_like(b)
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        out[:, i] = a[:, j] * b[:, k] - a[:, k] * b[:, j]
    return out


def is_well_inside(pixel: FloatArray, camera: Camera) -> bool:
    """Whether a pixel (2,) is in the image and not at its very border."""
    size = np.array([camera.width, camera.height])
    return bool(((pixel >= VIEW_MARGIN * size) & (pixel <= (1.0 - VIEW_MARGIN) * size)).all())


def is_within(pixel: FloatArray, centre_px: FloatArray, size_px: FloatArray) -> bool:
    """Whether a pixel (2,) is in a box of a size (2,) about a centre (2,)."""
    return bool((np.abs(pixel - centre_px) <= size_px / 2.0).all())
