"""What is in the pictures beside the fires: clouds far away, birds before the drone, dust that drives past."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from distloc.geometry.camera import Camera
from distloc.simulation.flights import Flight
from distloc.simulation.mask_noise import MaskNoise
from distloc.study.fires.smoke import Puffs, Smoke, SmokeLook, Source, draw_balls
from distloc.types import CameraPose, FloatArray

# false segments, frames without smoke and partial masks, as a segmenter gives them; sides for a picture of 640 x 360
SEGMENTER_NOISE = MaskNoise(0.05, 0.2, 3, 0.05, 0.05, 0.2, false_positive_side_px=(4, 40))
_CLOUD_RANGE_M = (40_000.0, 80_000.0)
_CLOUD_ELEVATION_RAD = (float(np.radians(9.0)), float(np.radians(20.0)))
_CLOUD_HALF_VIEW_RAD = float(np.radians(34.0))
_CLOUD_RADIUS_RAD = (float(np.radians(0.3)), float(np.radians(0.7)))
_BIRDS_A_S, _DUST_A_S = 1.0 / 45.0, 1.0 / 150.0
_BIRD_S, _DUST_S = (3.0, 20.0), (20.0, 90.0)
_BIRD_AHEAD_M, _BIRD_RADIUS_M, _BIRD_MPS = (15.0, 60.0), 0.4, (8.0, 15.0)
_DUST_MPS = (4.0, 12.0)
_DUST_LOOK = SmokeLook(height_m=15.0, life_s=8.0, root_m=5.0)


@dataclass(frozen=True, slots=True)
class Ball:
    """A thing of a radius that flies straight from `place_enu_m` (3,), where it is at `shown_s[0]`, until the other."""

    place_enu_m: FloatArray
    radius_m: float
    velocity_enu_mps: FloatArray
    shown_s: tuple[float, float]

    def draw(self, mask: NDArray[np.uint8], camera: Camera, pose: CameraPose) -> None:
        """Set the pixels of `mask` (H, W) that it covers to 255 while it is there."""
        since_s = pose.stamp_s - self.shown_s[0]
        if since_s >= 0.0 and pose.stamp_s < self.shown_s[1]:
            centre = self.place_enu_m + since_s * self.velocity_enu_mps
            draw_balls(mask, camera, pose, Puffs(centre[:, None], np.array([self.radius_m])))


def clouds(count: int, pose: CameraPose, rng: np.random.Generator) -> list[Ball]:
    """Spread over the sky of a pose's picture, so far that a flight's parallax says nothing of them."""
    ahead = pose.R_cam_from_enu[2]
    columns = max(1, int(np.ceil(np.sqrt(3.0 * count))))
    rows = int(np.ceil(count / columns))
    across, upright = np.divmod(rng.permutation(columns * rows)[:count], rows)
    azimuth = np.arctan2(ahead[0], ahead[1]) + _spread(
        across, columns, (-_CLOUD_HALF_VIEW_RAD, _CLOUD_HALF_VIEW_RAD), rng
    )
    elevation = _spread(upright, rows, _CLOUD_ELEVATION_RAD, rng)
    range_m = rng.uniform(*_CLOUD_RANGE_M, count)
    radius_m = range_m * rng.uniform(*_CLOUD_RADIUS_RAD, count)
    towards = np.stack([np.cos(elevation) * np.sin(azimuth), np.cos(elevation) * np.cos(azimuth), np.sin(elevation)])
    places = pose.position_enu_m[:, None] + range_m * towards
    return [Ball(places[:, i], float(radius_m[i]), np.zeros(3), (0.0, np.inf)) for i in range(count)]


def birds(flight: Flight, rng: np.random.Generator) -> list[Ball]:
    """Now and then one before the camera, across the picture or along with the craft."""
    found = []
    for start_s in _arrivals(flight, _BIRDS_A_S, rng):
        pose = flight.pose_at(start_s)
        ahead_m = rng.uniform(*_BIRD_AHEAD_M)
        in_camera = ahead_m * np.array([rng.uniform(-0.6, 0.6), rng.uniform(-0.35, 0.35), 1.0])
        course, speed_mps = rng.uniform(0.0, 2.0 * np.pi), rng.uniform(*_BIRD_MPS)
        velocity = speed_mps * np.array([np.sin(course), np.cos(course), 0.0])
        if rng.random() < 0.5:
            velocity = flight.path.state(start_s).velocity_enu_mps + 0.1 * velocity
        place = pose.position_enu_m + pose.R_cam_from_enu.T @ in_camera
        found.append(Ball(place, _BIRD_RADIUS_M, velocity, (start_s, start_s + rng.uniform(*_BIRD_S))))
    return found


def dust(flight: Flight, middle_enu_m: FloatArray, within_m: float, rng: np.random.Generator) -> list[Smoke]:
    """Vehicles on the ground that drive straight, each for a minute or so, within a circle about a place (3,)."""
    found = []
    for start_s in _arrivals(flight, _DUST_A_S, rng):
        azimuth, course = rng.uniform(0.0, 2.0 * np.pi, 2)
        away_m = within_m * np.sqrt(rng.uniform())
        place = middle_enu_m + away_m * np.array([np.sin(azimuth), np.cos(azimuth), 0.0])
        velocity = rng.uniform(*_DUST_MPS) * np.array([np.sin(course), np.cos(course), 0.0])
        lit_s = (start_s, start_s + float(rng.uniform(*_DUST_S)))
        found.append(Smoke(Source(place - start_s * velocity, _DUST_LOOK, np.zeros(3), velocity, lit_s), rng))
    return found


def _arrivals(flight: Flight, rate_hz: float, rng: np.random.Generator) -> list[float]:
    end_s = float(flight.stamps_s[-1])
    return sorted(rng.uniform(0.0, end_s, int(rng.poisson(rate_hz * end_s))).tolist())


def _spread(
    cells: np.ndarray[tuple[int], np.dtype[np.int64]],
    count: int,
    between: tuple[float, float],
    rng: np.random.Generator,
) -> FloatArray:
    """A value in each cell (N,) of `count` that share an interval; between neighbours a quarter of a cell is free."""
    share = (cells + rng.uniform(0.125, 0.875, cells.size)) / count
    return np.asarray(between[0] + share * (between[1] - between[0]))
