"""What a located target must also be before it is believed: no cloud, no bird, nothing on the lens. The tracks ask.

A filter of static points cannot tell: on a straight flight whatever moves evenly looks like a point that stands
elsewhere (bearings alone never show more), and on an orbit dirt on the lens looks like a point at the orbit's centre.
"""

import numpy as np

from distloc.filter.ground import Ground
from distloc.filter.particles import Cloud
from distloc.geometry.camera import Camera
from distloc.sights.sights import Ray
from distloc.tracks.expected import expected_pixels
from distloc.types import Extent, FloatArray

LEAST_EXTENT_M = 4.0  # of the longer side, its sigma added twice: a bird is smaller, a fire's smoke larger
MOST_ABOVE_M = 300.0  # the foot over the ground where that is known, else over the camera: a cloud
_STILL_SHARE = 0.2  # of the movement that a point on the ground would have shown
_MOVED_PX = 4.0  # one standard deviation, in units of a sight's: less movement tells nothing
_LEAST_SIGHTINGS = 8


def is_too_small(extent: Extent) -> bool:
    """Whether width and height are both those of something smaller than any smoke."""
    longest_m = max(extent.width_m + 2.0 * extent.width_sigma_m, extent.height_m + 2.0 * extent.height_sigma_m)
    return 0.0 < longest_m < LEAST_EXTENT_M


def foot_of(ray: Ray, cloud: Cloud) -> FloatArray:
    """Where the foot (3,) of a segment is, as it is seen now: how high what is cut reaches is not known."""
    camera_enu_m, foot_enu_m = ray.pose.position_enu_m, cloud.mean_enu_m.copy()
    foot_enu_m[2] = camera_enu_m[2] + ray.foot_tangent * float(np.hypot(*(foot_enu_m - camera_enu_m)[:2]))
    return foot_enu_m


def is_in_the_sky(foot_enu_m: FloatArray, highest_m: float, ground: Ground) -> bool:
    """Whether a segment's foot (3,) hangs in the air; `highest_m` is how high the camera has been while it was seen."""
    (ground_m,), (is_known,) = ground.heights_m(foot_enu_m[:1], foot_enu_m[1:2])
    under_m = float(ground_m) if is_known else highest_m
    return float(foot_enu_m[2]) - under_m > MOST_ABOVE_M


def is_on_the_lens(seen_px: FloatArray, expected_px: FloatArray, sigma_px: float) -> bool:
    """Whether what was seen at pixels (2, N) stayed where it was in the image while a point on the ground moved.

    `expected_px` (2, N) is where the target's position was in the same frames, `sigma_px` one standard deviation of
    a sighting, pose and all.
    """
    if seen_px.shape[1] < _LEAST_SIGHTINGS:
        return False
    seen, expected = (float(np.sqrt(np.var(pixels, axis=1).sum())) for pixels in (seen_px, expected_px))
    return expected > _MOVED_PX * sigma_px and seen < _STILL_SHARE * expected


def stays_on_the_lens(rays: list[Ray], cloud: Cloud, camera: Camera, sigma_px: float) -> bool:
    """The same of a track's last rays, by where its cloud was expected in each image; not where it is behind."""
    expected_px = expected_pixels(cloud, camera, [ray.pose for ray in rays])
    is_ahead = np.isfinite(expected_px).all(axis=0)
    seen_px = np.array([ray.detection.centre_px for ray in rays]).T
    return is_on_the_lens(seen_px[:, is_ahead], expected_px[:, is_ahead], sigma_px)
