"""Where a line of sight meets the ground of a DEM, against a ray that is marched through the air in ECEF by itself."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from pyproj import Geod, Transformer

from distloc.batch.locate import locate
from distloc.batch.sighting import Sighting, direction_from_azimuth
from distloc.filter.ground import Ground, ground_prior
from distloc.geometry.geodesy import LocalFrame
from distloc.types import PoseErrors
from service.localise.terrain.dem import ground_from_dem
from tests.support.dem import write_glo30

CAMERA = (47.05, 8.5, 900.0)
AZIMUTH_DEG = 20.0
REFRACTION = 0.13
RADIUS_M = 6_371_000.0
RAMPS_M = (5_000.0, 20_000.0, 60_000.0)
SURE = PoseErrors(
    heading_bias_rad=2e-5,
    tilt_bias_rad=2e-5,
    attitude_white_rad=1e-6,
    position_m=1e-3,
    position_bias_m=1e-3,
    bias_time_constant_s=1e6,
)
_TO_GEODETIC = Transformer.from_crs(4978, 4979)
_GEOD = Geod(ellps="WGS84")


def land(ramp_m: float) -> Any:
    """Of a place: level land that rises by one in eight from `ramp_m` of the camera on, with a swell across."""

    def heights_m(lat_deg: NDArray[Any], lon_deg: NDArray[Any]) -> NDArray[Any]:
        lat, lon = np.broadcast_arrays(lat_deg, lon_deg)
        camera = np.full(lat.shape, CAMERA[1]), np.full(lat.shape, CAMERA[0])
        _, _, away_m = _GEOD.inv(*camera, lon, lat)
        return np.asarray(400.0 + np.clip(0.125 * (away_m - ramp_m), 0.0, 1200.0) + 20.0 * np.sin(60.0 * lon))

    return heights_m


def marched_m(elevation_deg: float, bent: float, heights_m: Any) -> float:
    """How far away a ray that leaves the camera at this elevation meets the land; `bent` is Gauss' coefficient.

    Light turns towards the ground with `bent` of the earth's curvature: steps of 20 m of the ray's own equation in
    earth-centred axes, its height above the ellipsoid by PROJ.
    """
    lat, lon = math.radians(CAMERA[0]), math.radians(CAMERA[1])
    east = np.array([-math.sin(lon), math.cos(lon), 0.0])
    up = np.array([math.cos(lat) * math.cos(lon), math.cos(lat) * math.sin(lon), math.sin(lat)])
    north = np.cross(up, east)
    azimuth, elevation = math.radians(AZIMUTH_DEG), math.radians(elevation_deg)
    level = math.sin(azimuth) * east + math.cos(azimuth) * north
    towards = math.cos(elevation) * level + math.sin(elevation) * up
    at = np.array(Transformer.from_crs(4979, 4978).transform(*CAMERA))
    start, step_m = at.copy(), 20.0
    track = [at.copy()]
    for _ in range(4000):
        here = at / np.linalg.norm(at)  # up, to a fifth of a degree: of what bends the ray by 0.1 degrees in all
        towards = towards - bent / RADIUS_M * step_m * (here - (here @ towards) * towards)
        towards /= np.linalg.norm(towards)
        at = at + step_m * towards
        track.append(at.copy())
    points = np.array(track)
    lat_deg, lon_deg, height_m = _TO_GEODETIC.transform(*points.T)
    over_m = height_m - heights_m(lat_deg, lon_deg)
    first = int(np.argmax(over_m < 0.0))
    assert first > 0
    share = over_m[first - 1] / (over_m[first - 1] - over_m[first])
    return float(np.linalg.norm(points[first - 1] + share * (points[first] - points[first - 1]) - start))


def elevation_of(ramp_m: float) -> float:
    """At which the ramp is met some 100 m above its foot."""
    fall_m = (1.0 - REFRACTION) * ramp_m**2 / (2.0 * RADIUS_M)
    return math.degrees(math.atan2(500.0 - CAMERA[2] - fall_m, ramp_m + 800.0))


@pytest.fixture(scope="module", params=RAMPS_M)
def case(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> tuple[float, Path]:
    folder = tmp_path_factory.mktemp("dem")
    for lat in (46, 47):
        for lon in (7, 8, 9):
            if lon == 8 or request.param > 30_000.0:
                write_glo30(folder, lat, lon, land(request.param), rows=1200, cols=1200, block=512, overviews=1)
    return request.param, folder


def test_locate_with_a_dem_finds_the_range_of_one_sighting(case: tuple[float, Path]) -> None:
    ramp_m, folder = case
    elevation_deg = elevation_of(ramp_m)
    true_m = marched_m(elevation_deg, REFRACTION, land(ramp_m))
    straight_m = marched_m(elevation_deg, 0.0, land(ramp_m))
    towards = direction_from_azimuth(math.radians(AZIMUTH_DEG), math.radians(elevation_deg))
    one = Sighting(*CAMERA, towards, errors=SURE, sigma_rad=(1e-6, 1e-6))
    width_m = max(1.2 * ramp_m, 6_000.0) + 3_000.0
    (place,) = locate(
        [one], ground=lambda frame: ground_from_dem(folder, frame, 2.0, width_m), range_m=(1000.0, 80_000.0)
    ).places
    low_m, high_m = place.bearing.range95_m
    assert 30.0 < high_m - low_m < 120.0  # two metres of height, and the attitude's, on a slope of one in eight
    assert 0.5 * (low_m + high_m) == pytest.approx(true_m, abs=3.0)
    if ramp_m >= 20_000.0:  # a straight line would be wrong by tens of metres, hundreds at 60 km
        assert abs(straight_m - true_m) > 20.0


def test_the_prior_of_the_filter_is_highest_there(case: tuple[float, Path]) -> None:
    ramp_m, folder = case
    elevation_deg = elevation_of(ramp_m)
    true_m = marched_m(elevation_deg, REFRACTION, land(ramp_m))
    frame = LocalFrame(*CAMERA)
    ground: Ground = ground_from_dem(folder, frame, 1.0, max(1.2 * ramp_m, 6_000.0) + 3_000.0)
    prior = ground_prior(ground, np.zeros(3), 0.0)
    assert prior is not None
    ranges_m = np.arange(0.9 * true_m, 1.1 * true_m, 0.5)
    towards = direction_from_azimuth(math.radians(AZIMUTH_DEG), math.radians(elevation_deg))
    weights = prior(towards[:, None] * ranges_m)
    assert ranges_m[int(np.argmax(weights))] == pytest.approx(true_m, abs=3.0)
