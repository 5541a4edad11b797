"""Flights past a target with the camera on it: the study's geometries, as true camera poses at the filter's steps."""

from dataclasses import dataclass
from typing import Literal, Protocol, get_args

import numpy as np

from distloc.geometry.rotations import R_cam_from_enu, heading_rad, matrix_from_euler
from distloc.simulation.paths import FlightPath, arc, legs, straight
from distloc.types import CameraPose, FloatArray

Geometry = Literal["perpendicular", "oblique", "head-on", "orbit", "hover", "lawnmower"]
GEOMETRIES: tuple[Geometry, ...] = get_args(Geometry)
SPEED_MPS = 10.0


class Flown(Protocol):
    """Anything that knows the camera's true pose at a time, and when its frames are taken."""

    @property
    def stamps_s(self) -> FloatArray:
        """(N,)."""

    def pose_at(self, stamp_s: float) -> CameraPose:
        """The camera's true pose."""
        ...


@dataclass(frozen=True, slots=True)
class Flight:
    """A path, how the camera looks from the vehicle (yaw, pitch, roll), and the stamps (N,) of its frames."""

    path: FlightPath
    stamps_s: FloatArray
    mount_rad: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def pose_at(self, stamp_s: float) -> CameraPose:
        """The camera's true pose."""
        truth = self.path.state(stamp_s)
        R_ned_from_body = matrix_from_euler(truth.yaw_rad, truth.pitch_rad, truth.roll_rad)
        R = R_cam_from_enu(R_ned_from_body, matrix_from_euler(*self.mount_rad))
        return CameraPose(stamp_s, truth.position_enu_m, R, heading_rad=heading_rad(R_ned_from_body))


def paper_flight(step_m: float = 10.0) -> Flight:
    """The paper's: (0, 0, 0) to (1000, 0, 0) m in the camera's axes at constant orientation, a frame every T_s."""
    path = straight(np.zeros(3), np.pi / 2, SPEED_MPS, heading_rad=0.0, wobble_rad=0.0)
    return Flight(path, _stamps(1000.0, step_m))


def flight_past(
    geometry: Geometry,
    target_enu_m: FloatArray,
    range_m: float,
    length_m: float,
    step_m: float = 10.0,
    height_m: float = 0.0,
    wobble_rad: float = 0.0,
    seed: int = 0,
    speed_mps: float = SPEED_MPS,
) -> Flight:
    """A flight of `length_m` at `height_m` past a target (3,), from `range_m` south of it on the map.

    perpendicular: east, the target abeam half-way. oblique: north-east, 45 degrees off the line of sight. head-on:
    straight at it. orbit: around it, looking inwards. hover: nowhere, for as long as the others fly. lawnmower: four
    legs across the line of sight, each a twentieth of the flight nearer, the first from half a leg west. The nose is
    held at the target as seen from half-way; the camera is pitched at it from the start's range. ValueError for another
    name or sizes that are not above 0.
    """
    if geometry not in GEOMETRIES:
        raise ValueError(f"a geometry is one of {', '.join(GEOMETRIES)}, got {geometry!r}")
    if not range_m > 0.0:
        raise ValueError(f"range_m must be > 0, got {range_m}")
    if not speed_mps > 0.0:
        raise ValueError(f"speed_mps must be > 0, got {speed_mps}")
    stamps_s = _stamps(length_m, step_m, speed_mps)
    start = np.array([target_enu_m[0], target_enu_m[1] - range_m, height_m])
    path = _path(geometry, start, np.asarray(target_enu_m), range_m, length_m, wobble_rad, seed, speed_mps)
    pitch_rad = float(np.arctan2(target_enu_m[2] - height_m, range_m))
    return Flight(path, stamps_s, (0.0, pitch_rad, 0.0))


def _path(
    geometry: Geometry,
    start: FloatArray,
    target: FloatArray,
    range_m: float,
    length_m: float,
    wobble_rad: float,
    seed: int,
    speed_mps: float,
) -> FlightPath:
    north = np.array([0.0, 1.0, 0.0])
    east = np.array([1.0, 0.0, 0.0])
    match geometry:
        case "orbit":
            centre = np.array([target[0], target[1], start[2]])
            return arc(centre, range_m, np.pi, speed_mps, wobble_rad=wobble_rad, seed=seed)
        case "hover":
            return straight(start, 0.0, 0.0, 0.0, wobble_rad, seed)
        case "head-on":
            return straight(start, 0.0, speed_mps, 0.0, wobble_rad, seed)
        case "oblique":
            middle = start + length_m / 2.0 * (north + east) / np.sqrt(2.0)
            heading = float(np.arctan2(*(target - middle)[:2]))
            return straight(start, np.pi / 4, speed_mps, heading, wobble_rad, seed)
        case "lawnmower":
            nearer_m, across_m = 0.05 * length_m, 0.2125 * length_m
            sides = np.array([-1.0, 1.0, 1.0, -1.0, -1.0, 1.0, 1.0, -1.0]) / 2.0
            ahead = np.repeat(np.arange(4), 2) * nearer_m
            corners = start[:, None] + east[:, None] * sides * across_m + north[:, None] * ahead
            return legs(corners, speed_mps, 0.0, wobble_rad, seed)
        case _:
            return straight(start - east * length_m / 2.0, np.pi / 2, speed_mps, 0.0, wobble_rad, seed)


def _stamps(length_m: float, step_m: float, speed_mps: float = SPEED_MPS) -> FloatArray:
    if not (length_m > 0.0 and step_m > 0.0):
        raise ValueError(f"length_m and step_m must be > 0, got {length_m} and {step_m}")
    return np.arange(0.0, length_m + 0.5 * step_m, step_m) / speed_mps
