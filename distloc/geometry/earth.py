"""The earth's size, and how light bends over it: a standard atmosphere's refraction."""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

EARTH_RADIUS_M = 6_371_008.8  # IUGG's mean; WGS84's radii of curvature are within 0.6 % of it: 0.4 m at 30 km
REFRACTION = 0.13  # Gauss' coefficient: a level line of sight is bent with so much of the earth's curvature
LIFT_RAD_PER_M = REFRACTION / (2.0 * EARTH_RADIUS_M)  # by which what is seen stands higher than it is


def lift_m(distance_m: ArrayLike) -> NDArray[np.floating[Any]]:
    """How much higher than it is a thing at a distance looks: 4 m at 20 km, 37 m at 60 km."""
    return np.asarray(LIFT_RAD_PER_M * np.square(np.asarray(distance_m)))
