"""Whether a segment is a target that this platform sees for the first time; the assignment asks.

A target that one camera saw once may be anywhere along a ray. From the side that ray is long, and the less sure the
attitudes are, the wider: a density of false segments that is right for what is known well then refuses every segment.
So where a platform never saw a target, a segment is compared with what the target's own spread in the picture makes
likely, and taken where there is no choice: two segments that may be one target, or two targets that may be one segment,
wait until they are better known.
"""

import numpy as np
from numpy.typing import NDArray

from distloc.filter.bank import Bank
from distloc.filter.particles import Places
from distloc.geometry.camera import Camera
from distloc.types import BoolArray, CameraPose, FloatArray

_SAMPLE = 1024  # particles
_SHARE = 0.01  # of the mean density in the picture: a normal error of three standard deviations
_LEAST_IN_IMAGE = 0.01  # of the particles
_UNIFORM = 12.0  # squared width of a uniform distribution of variance 1


def least_log_density(bank: Bank, places: Places, pose: CameraPose, camera: Camera) -> FloatArray:
    """Logarithms (k,), by tangent squared, of what a segment's density is at least if it is that of a target.

    Infinite where hardly any of its particles is in the picture.
    """
    x, weights = bank.particles.sampled(places, _SAMPLE, rows=3)
    offsets_m = x + (bank.particles.origin_enu_m[places] - pose.position_enu_m).astype(np.float32)[:, :, None]
    seen = pose.R_cam_from_enu.astype(np.float32) @ offsets_m
    tangents = (seen[:, :2] / np.maximum(seen[:, 2:], np.float32(1.0))).astype(np.float64)
    sigma_rad = bank.seen_sigma_rad(places, pose.position_enu_m)
    low = -np.array([camera.cx / camera.fx, camera.cy / camera.fy])
    size = np.array([camera.width / camera.fx, camera.height / camera.fy])
    reach = (2.0 * sigma_rad)[:, None, None]
    is_inside = (tangents >= low[:, None] - reach) & (tangents <= (low + size)[:, None] + reach)
    inside = weights * (is_inside.all(axis=1) & (seen[:, 2] > 1.0))
    share = inside.sum(axis=1, dtype=np.float64)
    inside = inside[:, None] / np.maximum(share, 1e-9)[:, None, None]
    centred = tangents - (tangents * inside).sum(axis=2, keepdims=True)
    covariance = (centred * inside) @ centred.swapaxes(1, 2) + np.square(sigma_rad)[:, None, None] * np.eye(2)
    area = np.minimum(_UNIFORM * np.sqrt(np.linalg.det(covariance)), size.prod())
    return np.where(share >= _LEAST_IN_IMAGE, np.log(_SHARE * np.maximum(share, 1e-9) / area), np.inf)


def without_choice(is_likely: BoolArray, by_track: NDArray[np.intp], by_ray: NDArray[np.intp]) -> BoolArray:
    """Which of the likely pairs (p,) of tracks and rays share neither with another likely one."""
    tracks = np.bincount(by_track[is_likely], minlength=int(by_track.max()) + 1)
    rays = np.bincount(by_ray[is_likely], minlength=int(by_ray.max()) + 1)
    return np.asarray(is_likely & (tracks[by_track] == 1) & (rays[by_ray] == 1))
