"""Claims of drones about a place, for the tests of the fusion."""

import numpy as np

from distloc.batch.fusion.claims import Claim
from distloc.types import FloatArray


def spd(rng: np.random.Generator) -> FloatArray:
    """A covariance (2, 2)."""
    A = rng.normal(size=(2, 2))
    return A @ A.T + 0.3 * np.eye(2)


def claim(
    name: str,
    at: tuple[float, float] = (0.0, 0.0),
    bearing_deg: float = 0.0,
    sizes_m: tuple[float, float] = (60.0, 20.0),
    range_m: float = 2_000.0,
    age_s: float = 0.0,
    span_s: float = 0.0,
) -> Claim:
    """Of `VEHICLE/TARGET`; standard deviations along and across the line of sight."""
    turn = np.radians(bearing_deg)
    along = np.array([np.sin(turn), np.cos(turn)])
    across = np.array([along[1], -along[0]])
    covariance = np.outer(along, along) * sizes_m[0] ** 2 + np.outer(across, across) * sizes_m[1] ** 2
    return Claim(name, name.partition("/")[0], np.array(at), covariance, np.eye(2), float(turn), range_m, age_s, span_s)
