"""Draws a landscape with hills and what stands there through a camera: the demo's pictures, and tests of tracking."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from distloc.geometry.camera import Camera
from distloc.simulation.landscape.ground import Ground, Places
from distloc.simulation.landscape.raster import Fragments, Rasteriser, joined, lay_over
from distloc.simulation.landscape.roads import Roads
from distloc.simulation.landscape.scenes import Scene
from distloc.simulation.landscape.sensor import CameraFaults, Sensor
from distloc.simulation.landscape.terrain import FLAT_M, Horizon, Terrain
from distloc.simulation.landscape.texture import Floats, noise_tile
from distloc.simulation.landscape.things import Cars, houses, uprights
from distloc.simulation.landscape.view import PoseAt, View
from distloc.simulation.plume import Plume, PlumePainter
from distloc.types import CameraPose, FloatArray

_MASK_ALPHA = 0.35
_FARTHEST_M = 60_000.0
PERFECT = CameraFaults()


@dataclass(frozen=True, slots=True)
class Backdrop:
    """Ground and sky as drawn, at half size: BGR (H, W, 3), each pixel's range (H, W), and the horizon behind it."""

    picture: Floats
    range_m: Floats
    horizon: Horizon
    middle_rad: float


class LandscapeRenderer:
    """A camera in a landscape that `rng` and the scene make; about the origin and the plumes the ground is flat.

    Frames depend on the pose, its stamp and the rng's seed alone; `pose_at` is asked where the faults need other poses.
    """

    def __init__(
        self,
        camera: Camera,
        plumes: Sequence[Plume],
        rng: np.random.Generator,
        scene: Scene,
        faults: CameraFaults = PERFECT,
        ground_height_m: float = 0.0,
    ) -> None:
        self._camera, self._scene, self._faults = camera, scene, faults
        self._painters = [PlumePainter(plume, rng) for plume in plumes]
        places = [np.zeros(3), *(plume.base_enu_m for plume in plumes)]
        self.terrain = Terrain(rng, places, scene.hill_height_m, scene.ridge_height_m, ground_height_m)
        self.roads = Roads(rng)
        self.ground = Ground(scene, self.terrain, self.roads, rng)
        clear = places[1:]
        self.uprights = uprights(scene, self.terrain, self.ground, clear, rng)
        self.houses = houses(scene, self.terrain, self.ground, clear, rng)
        self.cars = Cars(scene, self.terrain, self.roads, rng)
        self._sensor = Sensor(camera, faults, scene.noise, int(rng.integers(2**32)))
        full = (np.arange(float(camera.width)), np.arange(float(camera.height)))
        self._rasteriser = Rasteriser(_rays(camera, *full), noise_tile(rng))
        # half the size in whole pixels, whose middles lie where cv2.resize has them
        columns, self._rows = ((np.arange((n + 1) // 2) + 0.5) * n / ((n + 1) // 2) - 0.5 for n in map(len, full))
        self._rays = _rays(camera, columns, self._rows)

    def render(self, pose: CameraPose, pose_at: PoseAt | None = None) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
        """The image (H, W, 3) BGR at a pose, and the smoke's mask (H, W), 255 where the plumes hide over a third."""
        view = View(self._camera, pose, pose_at, self._faults.readout_s)
        backdrop = self._backdrop(view)
        size = (self._camera.width, self._camera.height)
        picture = cv2.resize(backdrop.picture, size, interpolation=cv2.INTER_LINEAR)
        image = np.clip(picture, 0.0, 255.0).astype(np.uint8)
        alpha = np.zeros((self._camera.height, self._camera.width), np.float32)
        haze_bgr = np.array(self._scene.haze_bgr) * (1.0 + self._scene.land_haze) / 2.0
        things = self._things(view, backdrop)
        lamps, things = things.chosen(things.is_lamp), things.chosen(~things.is_lamp)
        for painter in sorted(self._painters, key=lambda one: -one.range_m(pose)):
            range_m = painter.range_m(pose)
            lay_over(image, alpha, things.chosen(things.range_m >= range_m))
            things = things.chosen(things.range_m < range_m)
            visible = cv2.resize((backdrop.range_m > range_m - FLAT_M).astype(np.float32), size)
            painter.paint(self._camera, pose, haze_bgr, self._scene.haze_range_m, image, alpha, view.in_camera, visible)
        lay_over(image, alpha, things)
        if self._scene.light < 1.0:
            image = np.asarray(cv2.convertScaleAbs(image, alpha=self._scene.light), dtype=np.uint8)
        lay_over(image, alpha, lamps)
        image = self._sensor.smeared(image, backdrop.range_m, pose, pose_at)
        image = self._sensor.zoomed(self._sensor.noisy(image, pose.stamp_s))
        return image, np.where(alpha > _MASK_ALPHA, 255, 0).astype(np.uint8)

    def range_m(self, pose: CameraPose) -> Floats:
        """How far the land is (h, w) that each pixel of the picture at half its size shows, infinite for the sky."""
        return self._backdrop(View(self._camera, pose)).range_m

    def _things(self, view: View, backdrop: Backdrop) -> Fragments:
        horizon, middle_rad = backdrop.horizon, backdrop.middle_rad
        parts = [self._rasteriser.uprights(view, horizon, middle_rad, self.uprights)]
        for boxes in (self.houses, self.cars.at(view.pose.stamp_s)):
            if boxes.heading_rad.size:
                parts.append(self._rasteriser.boxes(view, horizon, middle_rad, boxes))
        made = joined(parts)
        clear = np.exp(made.range_m * np.float32(-1.0 / self._scene.haze_range_m))
        haze = np.array(self._scene.haze_bgr, np.float32)[:, None] * np.float32(self._scene.land_haze)
        return replace(made, bgr=haze + (made.bgr - haze) * clear)

    def _backdrop(self, view: View) -> Backdrop:
        scene, rows = self._scene, self._rows[:, None]
        east, north, up = directions = view.directions(self._rays, rows)
        across = np.maximum(np.sqrt(east * east + north * north), np.float32(1e-6))
        tangent, sine, cosine = up / across, east / across, north / across
        middle_rad, azimuth, span_rad = _azimuths(view.pose, sine, cosine)
        horizon = Horizon(self.terrain, view.pose.position_enu_m, middle_rad, span_rad)
        origin = view.position_enu_m(rows)
        # a pixel is half sky where its middle is at the skyline: what lies half a pixel above still shows the ridge
        skyline = horizon.skyline(azimuth)
        pixel = np.float32(2.0 / self._camera.fx)
        sky_share = np.clip((tangent - skyline) / pixel + 0.5, 0.0, 1.0)
        lowered = np.where(sky_share < 1.0, np.minimum(tangent, skyline - np.float32(0.02) * pixel), tangent)
        level_m = horizon.meet(azimuth, sine, cosine, lowered, origin)
        range_m = level_m / across
        picture = np.zeros((*level_m.shape, 3), np.float32)
        has_sky = np.asarray(np.any(sky_share > 0.0, axis=1))
        has_land = np.asarray(np.any(np.isfinite(level_m), axis=1))
        last = len(has_sky) - int(np.argmax(has_sky[::-1])) if has_sky.any() else 0
        first = int(np.argmax(has_land)) if has_land.any() else len(has_land)
        if last:
            sky = self.ground.sky(directions[:, :last], view.pose.position_enu_m, view.pose.stamp_s)
            picture[:last] = np.moveaxis(sky, 0, 2)
        if first < len(has_land):
            below = slice(first, None)
            far_m = np.minimum(level_m[below], np.float32(_FARTHEST_M))
            east_m = origin[below, :, 0].astype(np.float32) + far_m * sine[below]
            north_m = origin[below, :, 1].astype(np.float32) + far_m * cosine[below]
            slant_m = np.minimum(range_m[below], np.float32(_FARTHEST_M))
            across_m = np.maximum(pixel * slant_m, np.float32(0.01))
            along_m = across_m / np.maximum(-up[below], np.float32(0.02))
            place = Places(east_m, north_m, sine[below], cosine[below], across_m, along_m)
            colours = self.ground.colours(place, view.pose.stamp_s)
            clear = np.exp(slant_m * np.float32(-1.0 / scene.haze_range_m))
            share = np.where(np.isfinite(level_m[below]), sky_share[below], np.float32(1.0))
            for channel in range(3):
                haze = np.float32(scene.land_haze * scene.haze_bgr[channel])
                colour = haze + (colours[channel] - haze) * clear
                above = picture[below, :, channel]
                above[...] = np.where(share > 0.0, colour + share * (above - colour), colour)
        return Backdrop(picture, range_m, horizon, middle_rad)


def _rays(camera: Camera, columns: FloatArray, rows: FloatArray) -> Floats:
    """The camera's rays (3, R, C) through a grid of pixels."""
    grid = np.stack(np.meshgrid(columns, rows)).reshape(2, -1)
    return np.asarray(camera.rays(grid).astype(np.float32).reshape(3, len(rows), len(columns)))


def _azimuths(pose: CameraPose, sine: Floats, cosine: Floats) -> tuple[float, Floats, float]:
    """The azimuth of the view's middle, each ray's from there, and how wide the view is, all in radians."""
    forward, down = pose.R_cam_from_enu[2], pose.R_cam_from_enu[1]
    ahead = forward[:2] if np.hypot(*forward[:2]) > 0.1 else -down[:2]  # straight down: where its top looks
    middle_rad = float(np.arctan2(ahead[0], ahead[1]))
    c, s = np.float32(np.cos(middle_rad)), np.float32(np.sin(middle_rad))
    azimuth = np.arctan2(sine * c - cosine * s, cosine * c + sine * s)
    span_rad = min(2.0 * float(np.abs(azimuth).max()) + 0.02, 2.0 * np.pi)
    return middle_rad, azimuth, span_rad
