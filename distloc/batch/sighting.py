"""One line of sight to a target, as a table of them has it; `locate` takes them."""

import math
from dataclasses import dataclass

import numpy as np

from distloc.geometry.camera import Camera
from distloc.types import FloatArray, PoseErrors

# A MEMS autopilot with GNSS and a compass near motors: what `[pose_errors]` calls "consumer".
CONSUMER_ERRORS = PoseErrors(
    heading_bias_rad=math.radians(2.0),
    tilt_bias_rad=math.radians(0.5),
    attitude_white_rad=math.radians(0.1),
    position_m=1.0,
    bias_time_constant_s=120.0,
    bias_turn_rad=math.radians(115.0),
)

MOST_SMOKE_M = 20_000.0  # from its fire; more is another fire's


@dataclass(frozen=True, slots=True)
class Sighting:
    """A target seen from a place in a direction.

    The camera is at `lat_deg`, `lon_deg`, `height_m`; all sightings' heights have one datum, which the answer's has
    then, too. `direction_enu` (3,) is a unit vector in the camera's own east, north and up. `sigma_rad` is one standard
    deviation of how well the target was marked, across and upright. `platform` names who carries the camera: each has
    an attitude error of its own, of `errors`, or of those that `locate` is told. One that never moves is taken as a
    fixed mount whose error stays. `stamp_s` is None where no time is known, `target` where nobody said which it is.
    `heading_rad` is the craft's, clockwise from north; the direction's azimuth stands in. `heading_white_rad` is how
    far the heading jumps from picture to picture; None: found out. `smoke_offset_m` is how far what was marked
    may be from the target at least, one standard deviation on each level axis: smoke from its fire; 0 where the target
    itself was marked.
    """

    lat_deg: float
    lon_deg: float
    height_m: float
    direction_enu: FloatArray
    sigma_rad: tuple[float, float] = (0.0, 0.0)
    platform: str = ""
    stamp_s: float | None = None
    target: str | None = None
    errors: PoseErrors | None = None
    heading_rad: float | None = None
    heading_white_rad: float | None = None
    smoke_offset_m: float = 0.0

    def __post_init__(self) -> None:
        if not (abs(self.lat_deg) <= 90.0 and abs(self.lon_deg) <= 180.0 and abs(self.height_m) <= 50_000.0):
            raise ValueError(
                "a camera must be at |lat| <= 90, |lon| <= 180 degrees and within 50 km of the sea's level, "
                f"got {self.lat_deg}, {self.lon_deg}, {self.height_m}"
            )
        length = float(np.linalg.norm(self.direction_enu))
        if not abs(length - 1.0) < 1e-6:
            raise ValueError(f"direction_enu must be a unit vector (3,), got {self.direction_enu}")
        told = (*self.sigma_rad, self.heading_white_rad or 0.0)
        if not all(0.0 <= sigma < math.pi for sigma in told):
            raise ValueError(f"sigmas must be 0 to pi radians, got {told}")
        if not 0.0 <= self.smoke_offset_m <= MOST_SMOKE_M:
            raise ValueError(f"smoke_offset_m must be 0 to {MOST_SMOKE_M:g} metres, got {self.smoke_offset_m}")
        if not np.isfinite([self.stamp_s or 0.0, self.heading_rad or 0.0]).all():
            raise ValueError(f"stamp_s and heading_rad must be finite, got {self.stamp_s}, {self.heading_rad}")

    @property
    def azimuth_rad(self) -> float:
        """Clockwise from true north, 0 to 2 pi."""
        return math.atan2(self.direction_enu[0], self.direction_enu[1]) % (2.0 * math.pi)

    @property
    def elevation_rad(self) -> float:
        """Over the horizontal."""
        return math.asin(min(max(float(self.direction_enu[2]), -1.0), 1.0))


def direction_from_azimuth(azimuth_rad: float, elevation_rad: float) -> FloatArray:
    """Unit vector (3,), east, north, up, of an azimuth clockwise from true north and an elevation."""
    level = math.cos(elevation_rad)
    return np.array([level * math.sin(azimuth_rad), level * math.cos(azimuth_rad), math.sin(elevation_rad)])


def direction_from_pixel(camera: Camera, R_cam_from_enu: FloatArray, u_px: float, v_px: float) -> FloatArray:
    """Unit vector (3,), east, north, up, through a pixel of a camera that is turned so."""
    ray_cam = camera.rays(np.array([[u_px], [v_px]]))[:, 0]
    direction = R_cam_from_enu.T @ ray_cam
    return np.asarray(direction / np.linalg.norm(direction))
