"""Where a cloud of particles says that a target is: on the map, and from the camera that looks. The tracks tell it."""

from dataclasses import dataclass
from typing import Self

import numpy as np

from distloc.filter.particles import Particles
from distloc.filter.uncertainty import LEVEL, NORMAL95, TAILS, blurred, weighted_ellipse, weighted_quantile
from distloc.types import Ellipse, FloatArray


@dataclass(frozen=True, slots=True)
class Place:
    """The 95 % ellipse about the mean, how far over or under it 95 % lie; range and bearing from the camera.

    `range95_m` are the 2.5 and 97.5 % quantiles; `bearing_rad` is clockwise from north.
    """

    ellipse95: Ellipse
    vertical95_m: float
    range_m: float
    range95_m: tuple[float, float]
    bearing_rad: float

    @classmethod
    def of(cls, particles: Particles, camera_enu_m: FloatArray, also_m2: FloatArray) -> Self:
        """Seen from a camera at (3,); `also_m2` (2, 2) is the covariance of what the cloud lacks on the map."""
        cloud = particles.cloud
        points_enu_m, weights = particles.weighted_positions()
        centred_m = points_enu_m - cloud.mean_enu_m[:, None]
        offset_enu_m = cloud.mean_enu_m - camera_enu_m
        ranges_m = np.linalg.norm(points_enu_m - camera_enu_m[:, None], axis=0)
        low_m, high_m = (weighted_quantile(ranges_m, weights, share) for share in TAILS)
        range_m = float(np.linalg.norm(offset_enu_m))
        ellipse = weighted_ellipse(centred_m[:2], weights, cloud.covariance_enu_m2[:2, :2], LEVEL)
        along = offset_enu_m[:2] / max(range_m, 1.0)
        also_m = NORMAL95 * np.sqrt(max(float(along @ also_m2 @ along), 0.0))
        nearer_m, farther_m = (float(np.hypot(side_m, also_m)) for side_m in (range_m - low_m, high_m - range_m))
        return cls(
            ellipse95=blurred(ellipse, also_m2),
            vertical95_m=weighted_quantile(np.abs(centred_m[2]), weights, LEVEL),
            range_m=range_m,
            range95_m=(max(range_m - nearer_m, 0.0), range_m + farther_m),
            bearing_rad=float(np.arctan2(offset_enu_m[0], offset_enu_m[1]) % (2 * np.pi)),
        )
