"""What is fused and what comes out: a drone's word on one target, a tower's bearing, a fire that several tell of."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from distloc.types import FloatArray


@dataclass(frozen=True, slots=True)
class Claim:
    """A vehicle's latest report of one of its targets, in metres east and north of a common origin.

    `covariance_m2` (2, 2) is of the whole error of `position_en_m` (2,); `shared_m2` (2, 2) is the part of it that
    other vehicles may have in common with it: GNSS, and the terrain where that gives the range. `bearing_rad`,
    clockwise from north, and `range_m` lead from the vehicle to the place. `name` is the report's own and unique.
    """

    name: str
    vehicle: str
    position_en_m: FloatArray
    covariance_m2: FloatArray
    shared_m2: FloatArray
    bearing_rad: float
    range_m: float

    def __post_init__(self) -> None:
        told = (*self.position_en_m, *self.covariance_m2.flat, *self.shared_m2.flat, self.bearing_rad, self.range_m)
        if not np.isfinite(told).all() or np.linalg.eigvalsh(self.covariance_m2 - self.shared_m2)[0] <= 0.0:
            raise ValueError(
                f"{self.name}: a claim must be finite, and its covariance larger than what is shared of it"
            )

    @property
    def vehicle_en_m(self) -> FloatArray:
        """Where it was seen from (2,)."""
        towards = np.array([math.sin(self.bearing_rad), math.cos(self.bearing_rad)])
        return np.asarray(self.position_en_m - self.range_m * towards)


@dataclass(frozen=True, slots=True)
class Bearing:
    """One direction in which a tower sees smoke.

    `azimuth_rad` is clockwise from north, `sigma_rad` its own error; all bearings of one `tower` have one error of the
    mount in common, of `bias_rad`. Beyond `reach_m` it sees nothing.
    """

    name: str
    tower: str
    position_en_m: FloatArray
    azimuth_rad: float
    sigma_rad: float
    bias_rad: float
    reach_m: float = 40_000.0

    def __post_init__(self) -> None:
        told = (*self.position_en_m, self.azimuth_rad, self.sigma_rad, self.bias_rad, self.reach_m)
        if not np.isfinite(told).all() or min(self.sigma_rad, self.bias_rad, self.reach_m) <= 0.0:
            raise ValueError(f"{self.name}: a bearing must be finite, and its sigmas and reach over 0")


@dataclass(frozen=True, slots=True)
class Outvoted:
    """A claim that the others contradict: how far off their place, and in how many of its own standard deviations."""

    name: str
    away_m: float
    sigmas: float


@dataclass(frozen=True, slots=True)
class FusedFire:
    """One fire: what tells of it, where (2,) with covariance (2, 2), and what does not count for the place.

    `used` are names of claims, one a vehicle; `undecided` may as well be of another fire; `bearings` are names of
    towers' bearings. `larger` is by how much the covariance is larger than as told, as claims scatter
    (`place.doubted`).
    """

    used: tuple[str, ...]
    position_en_m: FloatArray
    covariance_m2: FloatArray
    larger: float = 1.0
    undecided: tuple[str, ...] = ()
    outvoted: tuple[Outvoted, ...] = ()
    bearings: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class TowerBias:
    """What a tower's azimuths are off by: reported minus true, one standard deviation, from how many fires."""

    tower: str
    bias_rad: float
    sigma_rad: float
    fires: int


@dataclass(frozen=True, slots=True)
class Picture:
    """All fires, in the order of the names of what tells of them, and the towers' errors."""

    fires: Sequence[FusedFire]
    towers: Sequence[TowerBias] = field(default=())
