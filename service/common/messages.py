"""What the service's stages hand each other."""

from dataclasses import dataclass

import msgspec
import numpy as np
from numpy.typing import NDArray

from distloc.advice.advise import Advice
from distloc.types import CameraPose, FloatArray, TargetEstimate


@dataclass(frozen=True, slots=True)
class Frame:
    """One camera frame: BGR (H, W, 3) uint8, or None where only a recorded mask exists under `name`.

    `stamp_ns` is the middle of the exposure on the host's clock: CLOCK_MONOTONIC live, the log's clock in a replay.
    `orientation` is the EXIF one of its file, by which the image has been turned upright; 1 is upright as it was.
    """

    stamp_ns: int
    name: str
    image: NDArray[np.uint8] | None
    orientation: int = 1


class MavFrame(msgspec.Struct, frozen=True, gc=False):  # thousands in one read of junk: a dataclass costs 1 us each
    """One whole MAVLink frame whose length, id and CRC are right, not yet decoded.

    One of an id that we don't know has no CRC that can be checked: not `is_known`, and no sign of life.
    """

    raw: bytes
    version: int  # 1 or 2
    system: int
    component: int
    sequence: int
    message_id: int
    is_known: bool = True


@dataclass(frozen=True, slots=True)
class Geodetic:
    """A place: degrees, and metres above mean sea level."""

    lat_deg: float
    lon_deg: float
    alt_msl_m: float


@dataclass(frozen=True, slots=True)
class LocatedTarget:
    """A target's estimate with its place on the map and the times that a report needs."""

    estimate: TargetEstimate
    place: Geodetic
    ellipsoidal_height_m: float | None
    epoch: int
    sequence: int
    time_utc_s: float
    time_source: str  # "gps" (the autopilot's SYSTEM_TIME) or "host"
    first_seen_utc_s: float
    last_seen_utc_s: float
    degraded: tuple[str, ...]
    plume_place: Geodetic | None = None  # of the middle of its smoke, where that is known apart
    advice: Advice | None = None  # where to fly next, if that would make it surer


@dataclass(frozen=True, slots=True)
class VehicleState:
    """The camera's pose and where it looks, for the map."""

    time_utc_s: float
    time_source: str
    place: Geodetic
    heading_deg: float
    pose: CameraPose
    footprint: tuple[tuple[float, float], ...]  # (lon, lat) corners of what it sees of flat ground; empty if none
    image_centre: Geodetic | None = None  # where the image's centre meets that ground; None: unknown, or beyond
    ellipsoidal_height_m: float | None = None
    velocity_enu_mps: FloatArray | None = None  # (3,), the newest
    fov_rad: tuple[float, float] | None = None  # horizontal and vertical
    R_ned_from_body: FloatArray | None = None  # (3, 3) of the craft; None: unknown
