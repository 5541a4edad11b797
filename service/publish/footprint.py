"""What the camera sees of flat ground at home's altitude: a polygon, and the place of the image's centre."""

import math
from dataclasses import dataclass

import numpy as np

from distloc.geometry.camera import Camera
from distloc.geometry.earth import EARTH_RADIUS_M, REFRACTION
from distloc.geometry.geodesy import LocalFrame
from distloc.types import CameraPose, FloatArray
from service.common.messages import Geodetic

_SEEN_RADIUS_M = EARTH_RADIUS_M / (1.0 - REFRACTION)  # of the earth over which light would run straight
_FARTHEST_M = 30_000.0  # as far as targets are looked for
_LOWEST_M = 1.0  # lower above the ground there is nothing to look down on
_STEPS_AN_EDGE = 32  # in which the ground's end is looked for
_FAR_POINTS = 7  # of the ground's end, from side to side


@dataclass(frozen=True, slots=True)
class SeenGround:
    """`corners` are (lon, lat) in degrees, clockwise or not; empty where no ground is seen. `centre` is the image's."""

    corners: tuple[tuple[float, float], ...] = ()
    centre: Geodetic | None = None


class Footprint:
    """Knows one camera's rays. Ground further than 30 km, or than the horizon of a sphere, is cut off."""

    def __init__(self, camera: Camera) -> None:
        right, bottom = camera.width - 1.0, camera.height - 1.0
        corners = np.array([[0.0, right, right, 0.0], [bottom, bottom, 0.0, 0.0]])
        share = np.arange(_STEPS_AN_EDGE) / _STEPS_AN_EDGE
        edges = [
            corners[:, [one]] + share * (corners[:, [(one + 1) % 4]] - corners[:, [one]]) for one in range(4)
        ]  # each from its corner up to before the next
        self._border_cam = camera.rays(np.hstack(edges))
        self._centre_cam = camera.rays(np.array([[right / 2.0], [bottom / 2.0]]))

    def seen(self, pose: CameraPose, frame_enu: LocalFrame, ground_alt_msl_m: float | None) -> SeenGround:
        """From a pose in `frame_enu`, whose heights are above mean sea level; nothing where the ground's is unknown."""
        if ground_alt_msl_m is None:
            return SeenGround()
        ground_up_m = ground_alt_msl_m - frame_enu.origin[2]
        height_m = float(pose.position_enu_m[2]) - ground_up_m
        if not height_m >= _LOWEST_M:
            return SeenGround()
        far_m = min(_FARTHEST_M, math.sqrt(2.0 * _SEEN_RADIUS_M * height_m))

        end = height_m / far_m + far_m / (2.0 * _SEEN_RADIUS_M)  # a tangent: how steeply the ground's end is looked at

        def place(ray_enu: FloatArray) -> Geodetic:
            across, down = float(np.hypot(ray_enu[0], ray_enu[1])), max(-float(ray_enu[2]), 1e-12)
            # the ground falls away with the square of the distance, s * across: the nearer root of s in
            # s * down - (s * across)^2 / 2R = height
            root = math.sqrt(max(down**2 - 2.0 * height_m * across**2 / _SEEN_RADIUS_M, 0.0))
            share = min(2.0 * height_m / (down + root), far_m / max(across, 1e-12))
            east_m, north_m = pose.position_enu_m[:2] + share * ray_enu[:2]
            lat_deg, lon_deg, _ = frame_enu.geodetic_from_enu(np.array([east_m, north_m, ground_up_m]))
            return Geodetic(lat_deg, lon_deg, ground_alt_msl_m)

        R_enu_from_cam = pose.R_cam_from_enu.T
        places = [place(ray) for ray in _ground_rays(R_enu_from_cam @ self._border_cam, end)]
        centre_enu = (R_enu_from_cam @ self._centre_cam)[:, 0]
        is_seen = _below_end(centre_enu[:, None], end)[0] > 0.0
        corners = tuple((round(one.lon_deg, 8), round(one.lat_deg, 8)) for one in places)
        return SeenGround(corners if len(corners) > 2 else (), place(centre_enu) if is_seen else None)


def _below_end(rays_enu: FloatArray, slope: float) -> FloatArray:
    """How far (N,) rays (3, N) point below those that meet the ground's end; negative above it."""
    return np.asarray(-rays_enu[2] - slope * np.hypot(rays_enu[0], rays_enu[1]))


def _ground_rays(border_enu: FloatArray, slope: float) -> list[FloatArray]:
    """The border's corners that see the ground, and where it crosses the ground's end, with that end between them."""
    below = _below_end(border_enu, slope)
    sees = [bool(one > 0.0) for one in below]
    count = border_enu.shape[1]
    out: list[FloatArray] = []
    left: FloatArray | None = None
    start = next((i for i in range(count) if sees[i] and not sees[i - 1]), 0)  # where the ground is entered
    for i in (*range(start, count), *range(start)):
        before = i - 1
        if sees[i] is not sees[before]:
            share = below[before] / (below[before] - below[i])
            crossing = border_enu[:, before] + share * (border_enu[:, i] - border_enu[:, before])
            if sees[i] and left is not None:
                out += _between(left, crossing)
            left = None if sees[i] else crossing
            out.append(crossing)
        if sees[i] and i % _STEPS_AN_EDGE == 0:
            out.append(border_enu[:, i])
    return out + (_between(left, out[0]) if left is not None else [])


def _between(start_enu: FloatArray, end_enu: FloatArray) -> list[FloatArray]:
    """Rays towards the ground's end, from one azimuth to the other by the short way, without the two."""
    start_rad, end_rad = (math.atan2(ray[1], ray[0]) for ray in (start_enu, end_enu))
    turn_rad = (end_rad - start_rad + math.pi) % (2.0 * math.pi) - math.pi
    angles_rad = start_rad + turn_rad * np.linspace(0.0, 1.0, _FAR_POINTS)[1:-1]
    return [np.array([math.cos(angle_rad), math.sin(angle_rad), 0.0]) for angle_rad in angles_rad]
