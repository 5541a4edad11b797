"""What a located target must also be before it is believed: no cloud, no bird, nothing on the lens. The tracks ask.

A filter of static points cannot tell: on a straight flight whatever moves evenly looks like a point that stands
elsewhere (bearings alone never show more), and on an orbit dirt on the lens looks like a point at the orbit's centre.
"""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from distloc.filter.ground import Ground
from distloc.filter.moments import Clouds
from distloc.geometry.camera import Camera
from distloc.sights.sights import Ray
from distloc.tracks.expected import reported_pixels
from distloc.tracks.memory import Memory
from distloc.types import BoolArray, Extent, FloatArray

LEAST_EXTENT_M = 4.0  # of the longer side, its sigma added twice: a bird is smaller, a fire's smoke larger
MOST_ABOVE_M = 300.0  # the foot over the ground where that is known, else over the camera: a cloud
_STILL_SHARE = 0.2  # of the movement that a point on the ground would have shown
_MOVED_PX = 4.0  # one standard deviation, in units of a sight's: less movement tells nothing
_LEAST_SIGHTINGS = 8


def is_too_small(extent: Extent) -> bool:
    """Whether width and height are both those of something smaller than any smoke."""
    longest_m = max(extent.width_m + 2.0 * extent.width_sigma_m, extent.height_m + 2.0 * extent.height_sigma_m)
    return 0.0 < longest_m < LEAST_EXTENT_M


def feet_of(rays: Sequence[Ray], mean_enu_m: FloatArray) -> FloatArray:
    """Where the feet (k, 3) of one frame's segments of targets at (k, 3) are: of what is cut no height is known."""
    camera_enu_m = rays[0].pose.position_enu_m
    away_m = np.linalg.norm((mean_enu_m - camera_enu_m)[:, :2], axis=1)
    up_m = camera_enu_m[2] + np.array([one.foot_tangent for one in rays]) * away_m
    return np.column_stack([mean_enu_m[:, :2], up_m])


def are_in_the_sky(feet_enu_m: FloatArray, highest_m: FloatArray, ground: Ground) -> BoolArray:
    """Whether segments' feet (k, 3) hang in the air; `highest_m` (k,) is how high the camera was by then."""
    ground_m, is_known = ground.heights_m(feet_enu_m[:, 0], feet_enu_m[:, 1])
    return np.asarray(feet_enu_m[:, 2] - np.where(is_known, ground_m, highest_m) > MOST_ABOVE_M)


def are_on_the_lens(seen_px: FloatArray, expected_px: FloatArray, sigma_px: float) -> BoolArray:
    """Whether what was seen at pixels (k, m, 2) stayed where it was in the image while a point on the ground moved.

    `expected_px` (k, m, 2) is where the target's position was in the same frames, either NaN where it is not known;
    `sigma_px` one standard deviation of a sighting, pose and all.
    """
    is_known = np.asarray(np.isfinite(seen_px + expected_px).all(axis=2))
    seen, expected = (_spread(np.where(is_known[:, :, None], one, 0.0), is_known) for one in (seen_px, expected_px))
    is_moved = (expected > _MOVED_PX * sigma_px) & (seen < _STILL_SHARE * expected)
    return np.asarray(is_moved & (is_known.sum(axis=1) >= _LEAST_SIGHTINGS))


def stay_on_the_lens(
    memories: Sequence[Memory], clouds: Clouds, places: NDArray[np.intp], camera: Camera, sigma_px: float
) -> BoolArray:
    """The same of k tracks' last sightings, by where the clouds at these places were expected in each image."""
    cameras_enu_m = np.array([one.cameras_enu_m for one in memories])
    R_cam_from_enu = np.array([one.R_cam_from_enu for one in memories])
    offsets_enu_m = clouds.mean_enu_m[places, None] - cameras_enu_m
    expected_px = reported_pixels(offsets_enu_m, clouds.bias_rad[places, None], R_cam_from_enu, camera)
    seen_px, number = np.array([one.seen_by_last_px() for one in memories]), cameras_enu_m.shape[1]
    oldest = np.array([[one.oldest] for one in memories])
    order = np.arange(len(memories))[:, None], (np.arange(number) + oldest) % number
    is_shaken = are_shaken(seen_px[order], R_cam_from_enu[order], camera, sigma_px)
    return are_on_the_lens(seen_px, expected_px, sigma_px) | is_shaken


def are_shaken(seen_px: FloatArray, R_cam_from_enu: FloatArray, camera: Camera, sigma_px: float) -> BoolArray:
    """Whether what was seen at pixels (k, m, 2), in the order of time, shakes with the camera, turned by (k, m, 3, 3).

    Where a place on the ground is seen its pixel shakes and its direction does not, also where a gimbal follows it; of
    dirt on the lens it is the other way round, also on a circle about what it seems to be. By second differences, which
    take out what moves evenly.
    """
    is_seen: BoolArray = np.asarray(np.isfinite(seen_px).all(axis=2))
    rays = camera.rays(np.where(is_seen[:, :, None], seen_px, 0.0).reshape(-1, 2).T).T.reshape(*is_seen.shape, 3)
    along = (R_cam_from_enu.swapaxes(2, 3) @ rays[..., None])[..., 0]
    is_known = is_seen[:, 2:] & is_seen[:, 1:-1] & is_seen[:, :-2]
    in_image, in_world = (_roughness(one, is_known) for one in (np.nan_to_num(seen_px), camera.fx * along))
    is_moved = (in_world > _MOVED_PX * math.sqrt(6.0) * sigma_px) & (in_image < _STILL_SHARE * in_world)
    return np.asarray(is_moved & (is_known.sum(axis=1) >= _LEAST_SIGHTINGS - 2))


def _roughness(values: FloatArray, is_known: BoolArray) -> FloatArray:
    """The root of the mean square (k,) of the known second differences of values (k, m, d)."""
    off = (values[:, 2:] - 2.0 * values[:, 1:-1] + values[:, :-2]) * is_known[:, :, None]
    return np.asarray(np.sqrt(np.square(off).sum(axis=(1, 2)) / np.maximum(is_known.sum(axis=1), 1)))


def _spread(pixels: FloatArray, is_known: BoolArray) -> FloatArray:
    """One standard deviation (k,) of the known pixels (k, m, 2), about both axes; the others are 0."""
    number = np.maximum(is_known.sum(axis=1), 1)[:, None]
    off = (pixels - pixels.sum(axis=1, keepdims=True) / number[:, :, None]) * is_known[:, :, None]
    return np.asarray(np.sqrt((np.square(off).sum(axis=1) / number).sum(axis=1)))
