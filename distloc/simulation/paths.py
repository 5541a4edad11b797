"""Flight paths of a simulated vehicle; the simulated autopilot and the scenarios ask them for the truth at a time."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from distloc.types import FloatArray

_GRAVITY_MPS2 = 9.80665


@dataclass(frozen=True, slots=True)
class VehicleTruth:
    """The vehicle's true state: position, velocity (3,) in ENU; attitude as intrinsic yaw, pitch, roll (NED, body)."""

    position_enu_m: FloatArray
    velocity_enu_mps: FloatArray
    yaw_rad: float
    pitch_rad: float
    roll_rad: float


class FlightPath(Protocol):
    """Anything that knows where the vehicle is at a time."""

    def state(self, t_s: float) -> VehicleTruth:
        """The truth `t_s` after the start."""
        ...


class Wobble:
    """A small attitude motion: three sines an axis with amplitudes that add up to about `amplitude_rad`.

    The periods, 1.5 to 12 s, are those of a multirotor in light wind; the same seed gives the same motion.
    """

    def __init__(self, amplitude_rad: float, seed: int) -> None:
        rng = np.random.default_rng(seed)
        self._omega = 2.0 * np.pi / rng.uniform(1.5, 12.0, (3, 3))
        self._phase = rng.uniform(0.0, 2.0 * np.pi, (3, 3))
        shares = rng.uniform(0.3, 1.0, (3, 3))
        self._amplitude = amplitude_rad * shares / shares.sum(axis=1, keepdims=True)

    def at(self, t_s: float) -> FloatArray:
        """Yaw, pitch and roll (3,) in radians to add at a time."""
        return np.asarray((self._amplitude * np.sin(self._omega * t_s + self._phase)).sum(axis=1))


@dataclass(frozen=True, slots=True)
class Straight:
    """A line flown at constant speed; a speed of 0 hovers. `course_rad` is clockwise from north."""

    start_enu_m: FloatArray
    course_rad: float
    speed_mps: float
    heading_rad: float
    wobble: Wobble

    def state(self, t_s: float) -> VehicleTruth:
        """The truth `t_s` after the start."""
        velocity = self.speed_mps * np.array([np.sin(self.course_rad), np.cos(self.course_rad), 0.0])
        yaw, pitch, roll = np.array([self.heading_rad, 0.0, 0.0]) + self.wobble.at(t_s)
        return VehicleTruth(self.start_enu_m + t_s * velocity, velocity, _wrapped(yaw), float(pitch), float(roll))


@dataclass(frozen=True, slots=True)
class Arc:
    """A circle about a centre, whose z is the height flown, from an azimuth as seen from the centre.

    A positive speed flies clockwise. The nose points at the centre, or along the course where `faces_centre` is False.
    """

    centre_enu_m: FloatArray
    radius_m: float
    start_azimuth_rad: float
    speed_mps: float
    faces_centre: bool
    wobble: Wobble

    def state(self, t_s: float) -> VehicleTruth:
        """The truth `t_s` after the start."""
        azimuth = self.start_azimuth_rad + t_s * self.speed_mps / self.radius_m
        outwards = np.array([np.sin(azimuth), np.cos(azimuth), 0.0])
        along = np.array([np.cos(azimuth), -np.sin(azimuth), 0.0])
        heading = azimuth + np.pi if self.faces_centre else azimuth + np.copysign(np.pi / 2, self.speed_mps)
        bank = np.arctan(self.speed_mps * abs(self.speed_mps) / (self.radius_m * _GRAVITY_MPS2))
        turn = np.array([0.0, -abs(bank), 0.0]) if self.faces_centre else np.array([0.0, 0.0, bank])
        yaw, pitch, roll = np.array([heading, 0.0, 0.0]) + turn + self.wobble.at(t_s)
        position = self.centre_enu_m + self.radius_m * outwards
        return VehicleTruth(position, self.speed_mps * along, _wrapped(yaw), float(pitch), float(roll))


@dataclass(frozen=True, slots=True)
class Legs:
    """Straight legs between corners (3, K) at constant speed; before the first and after the last they go on."""

    corners_enu_m: FloatArray
    lengths_m: FloatArray
    speed_mps: float
    heading_rad: float
    wobble: Wobble

    def state(self, t_s: float) -> VehicleTruth:
        """The truth `t_s` after the start."""
        ends_m = np.cumsum(self.lengths_m)
        flown_m = t_s * self.speed_mps
        leg = min(int(np.searchsorted(ends_m, flown_m, side="right")), self.lengths_m.size - 1)
        along = (self.corners_enu_m[:, leg + 1] - self.corners_enu_m[:, leg]) / self.lengths_m[leg]
        position = self.corners_enu_m[:, leg] + (flown_m - ends_m[leg] + self.lengths_m[leg]) * along
        yaw, pitch, roll = np.array([self.heading_rad, 0.0, 0.0]) + self.wobble.at(t_s)
        return VehicleTruth(position, self.speed_mps * along, _wrapped(yaw), float(pitch), float(roll))


def straight(
    start_enu_m: FloatArray,
    course_rad: float,
    speed_mps: float,
    heading_rad: float | None = None,
    wobble_rad: float = 0.01,
    seed: int = 0,
) -> FlightPath:
    """A straight flight; `heading_rad` is where the nose points if not along the course."""
    heading = course_rad if heading_rad is None else heading_rad
    return Straight(_vector(start_enu_m), course_rad, speed_mps, heading, Wobble(wobble_rad, seed))


def arc(
    centre_enu_m: FloatArray,
    radius_m: float,
    start_azimuth_rad: float,
    speed_mps: float,
    faces_centre: bool = True,
    wobble_rad: float = 0.01,
    seed: int = 0,
) -> FlightPath:
    """A flight on a circle; raises ValueError for a radius that is not above 0."""
    if not radius_m > 0.0:
        raise ValueError(f"radius_m must be > 0, got {radius_m}")
    wobble = Wobble(wobble_rad, seed)
    return Arc(_vector(centre_enu_m), radius_m, start_azimuth_rad, speed_mps, faces_centre, wobble)


def legs(
    corners_enu_m: FloatArray, speed_mps: float, heading_rad: float, wobble_rad: float = 0.01, seed: int = 0
) -> FlightPath:
    """A flight from corner to corner (3, K), at least two and none twice in a row, the nose held at a heading."""
    corners = np.array(corners_enu_m, dtype=np.float64)
    if corners.ndim != 2 or corners.shape[0] != 3 or corners.shape[1] < 2 or not np.isfinite(corners).all():
        raise ValueError(f"corners must be finite and (3, K) with K >= 2, got {corners.shape}")
    lengths_m = np.linalg.norm(np.diff(corners, axis=1), axis=0)
    if not (speed_mps > 0.0 and (lengths_m > 0.0).all()):
        raise ValueError(f"speed_mps and every leg must be > 0, got {speed_mps} and {lengths_m}")
    return Legs(corners, lengths_m, speed_mps, heading_rad, Wobble(wobble_rad, seed))


def _vector(value: FloatArray) -> FloatArray:
    vector = np.array(value, dtype=np.float64)
    if vector.shape != (3,) or not np.isfinite(vector).all():
        raise ValueError(f"a place must be 3 finite numbers, got {value}")
    return vector


def _wrapped(angle_rad: float) -> float:
    return float((angle_rad + np.pi) % (2.0 * np.pi) - np.pi)
