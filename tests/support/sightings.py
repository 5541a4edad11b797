"""Sightings of a known place by platforms whose attitudes err, by geometry of their own."""

import math
from dataclasses import replace

import numpy as np

from distloc.batch.sighting import Sighting
from distloc.geometry.geodesy import LocalFrame
from distloc.geometry.rotations import matrix_from_rotation_vector
from distloc.types import FloatArray, PoseErrors
from tests.support.towers import CAMERA as TOWER_CAMERA
from tests.support.towers import FIRE_ENU_M, FOR_GOOD_S, PIXEL_PX, WHITE_RAD, Towers

FRAME = LocalFrame(47.0, 8.0, 500.0)
EARTH_RADIUS_M = 6_371_008.8


def seen(camera_enu_m: FloatArray, place_enu_m: FloatArray, off_rad: FloatArray, **told: object) -> Sighting:
    """What a camera reports of a place, its attitude off by a turn (3,) about its own east, north and up."""
    place = FRAME.geodetic_from_enu(camera_enu_m)
    R_own_from_frame, _ = LocalFrame(*place).from_other(FRAME)
    offset_m = R_own_from_frame @ (place_enu_m - camera_enu_m)
    range_m = float(np.linalg.norm(offset_m))
    offset_m[2] += 0.13 * range_m**2 / (2.0 * EARTH_RADIUS_M)  # the air bends light down
    direction = matrix_from_rotation_vector(off_rad) @ (offset_m / np.linalg.norm(offset_m))
    return Sighting(*place, direction / np.linalg.norm(direction), **told)  # type: ignore[arg-type]


def tower_errors(tilt_deg: float = 0.5, heading_deg: float = 3.0) -> PoseErrors:
    return PoseErrors(math.radians(heading_deg), math.radians(tilt_deg), WHITE_RAD, 1.0, FOR_GOOD_S)


def of_towers(towers: Towers, rng: np.random.Generator, looks: int = 5) -> list[Sighting]:
    """Each tower's sightings of the fire, in turn."""
    pixel_rad = PIXEL_PX / TOWER_CAMERA.fx
    sightings = []
    for look in range(looks):
        for tower, place in enumerate(towers.places_enu_m):
            off_rad = towers.biases_rad[tower] + math.hypot(WHITE_RAD, pixel_rad) * rng.standard_normal(3)
            one = seen(place, FIRE_ENU_M, off_rad, platform=f"tower{tower}", stamp_s=60.0 * look + 2.0 * tower)
            sightings.append(replace(one, errors=towers.errors, sigma_rad=(pixel_rad, pixel_rad)))
    return sightings


def stills(
    rng: np.random.Generator, count: int, white_deg: float = 0.8, bias_deg: float = 1.8, shown_m: float = 0.3
) -> list[Sighting]:
    """Of a craft that goes part of a way round the place at the origin, 50 to 100 m away.

    Its compass errs by a sinusoid of the heading, as iron in the craft makes it, and anew in each picture.
    """
    azimuths = rng.uniform(0.0, 2.0 * np.pi) + np.sort(rng.uniform(0.0, rng.uniform(1.0, 6.28), count))
    range_m, elevation = rng.uniform(50.0, 100.0), np.radians(rng.uniform(20.0, 60.0))
    steady, sine, cosine = rng.standard_normal(3) * np.radians(bias_deg) / np.sqrt([2.0, 2.0, 2.0])
    tilt_rad = rng.standard_normal(2) * np.radians(0.5)
    sightings = []
    for i, azimuth in enumerate(azimuths.tolist()):
        flat = math.cos(elevation)
        away = np.array([flat * math.sin(azimuth), flat * math.cos(azimuth), math.sin(elevation)])
        camera = (range_m + rng.uniform(-5.0, 5.0)) * away
        heading_rad = steady + sine * math.sin(azimuth) + cosine * math.cos(azimuth)
        off_rad = np.append(tilt_rad, heading_rad) + np.radians(0.1) * rng.standard_normal(3)
        off_rad[2] += np.radians(white_deg) * rng.standard_normal()
        one = seen(camera, np.zeros(3), off_rad, platform="craft", stamp_s=10.0 * i, sigma_rad=(1e-3, 1e-3))
        lat, lon, height = FRAME.geodetic_from_enu(camera + shown_m * rng.standard_normal(3))
        sightings.append(replace(one, lat_deg=lat, lon_deg=lon, height_m=height))
    return sightings


def survey(rng: np.random.Generator, views: int) -> tuple[list[Sighting], FloatArray]:
    """Stills of 20 points on the ground by a craft that goes part of a way round them, and the points (20, 3).

    A picture shows those that its view of 24 degrees holds, four in five of them; the compass errs as in `stills`.
    """
    points = np.stack([*rng.uniform(-40.0, 40.0, (2, 20)), rng.uniform(-1.0, 1.0, 20)], axis=1)
    shift_m = 0.3 * rng.standard_normal(3)
    steady, sine, cosine = rng.standard_normal(3) * np.radians(1.8) / math.sqrt(2.0)
    tilt_rad = rng.standard_normal(2) * np.radians(0.5)
    start, span = rng.uniform(0.0, 2.0 * np.pi), rng.uniform(2.0, 2.0 * np.pi)
    sightings = []
    for i in range(views):
        azimuth, range_m = start + span * i / views, rng.uniform(60.0, 90.0)
        camera = range_m * np.array([0.85 * math.sin(azimuth), 0.85 * math.cos(azimuth), 0.5])
        yaw = math.atan2(*(rng.uniform(-25.0, 25.0, 2) - camera[:2]))
        heading_rad = steady + sine * math.sin(yaw) + cosine * math.cos(yaw) + np.radians(0.8) * rng.standard_normal()
        off_rad = np.append(tilt_rad, heading_rad) + np.radians(0.1) * rng.standard_normal(3)
        reported = FRAME.geodetic_from_enu(camera + shift_m + 0.3 * rng.standard_normal(3))
        for number, point in enumerate(points):
            beside = (math.atan2(*(point - camera)[:2]) - yaw + math.pi) % (2.0 * math.pi) - math.pi
            if abs(beside) > math.radians(12.0) or rng.random() > 0.8:
                continue
            one = seen(camera, point, off_rad + 1e-3 * rng.standard_normal(3), platform="craft", stamp_s=10.0 * i)
            lat, lon, height = reported
            one = replace(one, lat_deg=lat, lon_deg=lon, height_m=height, heading_rad=yaw % (2.0 * math.pi))
            sightings.append(replace(one, target=str(number), sigma_rad=(1e-3, 1e-3)))
    return sightings, points
