"""The colours of land and sea, and of the sky above them."""

from dataclasses import dataclass

import numpy as np

from distloc.simulation.landscape.detail import Detail
from distloc.simulation.landscape.roads import Roads
from distloc.simulation.landscape.scenes import Scene
from distloc.simulation.landscape.terrain import Terrain
from distloc.simulation.landscape.texture import TILE, Floats, noise_tile, periodic, sampled, smoothstep
from distloc.types import FloatArray

_STANDS_M = (150.0, 700.0)  # how large woods and open land are
_PARCEL_M = (95.0, 60.0)
_PARCEL_TURN_RAD = 0.4
_PARCEL_SAMPLES = (-0.33, 0.0, 0.33)  # along the view, in what a pixel covers
_WAVES = ((3.0, 1.9), (9.0, 3.2), (40.0, 5.5), (260.0, 9.0))  # of the sea: length in metres, speed in metres a second
_CLOUD_BASE_M = 1_800.0
_CLOUD_CELL_M = 420.0
_SHADOW_CELL_M = 110.0
_ROAD_BGR = (128.0, 130.0, 132.0)
_WIND = (0.83, 0.56)  # where it blows to, east and north


@dataclass(frozen=True, slots=True)
class Places:
    """Places (R, C) on the ground that pixels show, the azimuths they are seen along, and how much a pixel covers."""

    east_m: Floats
    north_m: Floats
    sine: Floats
    cosine: Floats
    across_m: Floats
    along_m: Floats


class Ground:
    """The surface's colours at places; the sea's and the clouds' move with the time."""

    def __init__(self, scene: Scene, terrain: Terrain, roads: Roads, rng: np.random.Generator) -> None:
        self._scene, self._terrain, self._roads = scene, terrain, roads
        self._stands = [noise_tile(rng) for _ in _STANDS_M]
        self._waves = [noise_tile(rng) for _ in _WAVES]
        self._parcels = periodic(rng.normal(size=(TILE, TILE)))
        self._detail = Detail(rng)
        self._clouds = noise_tile(rng, 2.0)

    def field_share(self, east_m: Floats, north_m: Floats) -> Floats:
        """How much of a place (R, C) is open land, 0 (forest) to 1."""
        kind = sum(
            sampled(tile, east_m / cell_m, north_m / cell_m)
            for cell_m, tile in zip(_STANDS_M, self._stands, strict=True)
        )
        return np.asarray(np.clip(kind * 3.0 + 0.9, 0.0, 1.0), dtype=np.float32)

    def colours(self, place: Places, stamp_s: float) -> Floats:
        """BGR (3, R, C) of places before the haze."""
        scene, east_m, north_m = self._scene, place.east_m, place.north_m
        covered_m = np.sqrt(place.across_m * place.along_m)
        if scene.is_sea:
            return self._sea(east_m, north_m, covered_m, stamp_s)
        field = self.field_share(east_m, north_m)
        along_m = place.along_m
        wood, open_land = self._detail.at(east_m, north_m, place.sine, place.cosine, place.across_m, along_m)
        parcel = np.zeros_like(east_m)
        for part in _PARCEL_SAMPLES:
            way_m = np.float32(part) * along_m
            parcel += self._parcel(east_m + way_m * place.sine, north_m + way_m * place.cosine, covered_m)
        parcel *= np.clip(2.0 - along_m / _PARCEL_M[1], 0.0, 1.0) * field / np.float32(len(_PARCEL_SAMPLES))
        texture = wood + (open_land - wood) * field + np.float32(0.14) * parcel
        light = 1.0 + np.float32(scene.contrast) * texture
        light *= self._terrain.shade(east_m, north_m)
        if scene.cloud_shadow > 0.0:
            light *= 1.0 - np.float32(scene.cloud_shadow) * self._shadow(east_m, north_m, stamp_s)
        hue = np.float32(0.10 * scene.contrast) * parcel
        colours = np.empty((3, *east_m.shape), np.float32)
        for channel, turn in enumerate((-0.6, 0.3, 1.2)):
            low, high = (np.float32(colour[channel]) for colour in (scene.forest_bgr, scene.field_bgr))
            colours[channel] = (low + (high - low) * field) * (light + np.float32(turn) * hue)
        if scene.has_roads:
            share = self._roads.share(east_m, north_m, covered_m)
            for channel in range(3):
                colours[channel] += share * (np.float32(_ROAD_BGR[channel]) * light - colours[channel])
        return colours

    def sky(self, directions: Floats, position_enu_m: FloatArray, stamp_s: float) -> Floats:
        """BGR (3, R, C) of the sky in directions (3, R, C) from a place; clouds have a height, and so parallax."""
        scene = self._scene
        up = np.maximum(directions[2], np.float32(0.0))
        blue = 1.0 - np.exp(-up / np.float32(0.22))
        cloud = self._cloud(directions, up, position_enu_m, stamp_s) if scene.cloud_cover > 0.0 else np.float32(0.0)
        colours = np.empty_like(directions)
        for channel in range(3):
            low, high = np.float32(scene.haze_bgr[channel]), np.float32(scene.zenith_bgr[channel])
            base = low + (high - low) * blue
            colours[channel] = base + cloud * (np.float32(244.0 - 4.0 * channel) - base)
        return colours

    def _parcel(self, east_m: Floats, north_m: Floats, covered_m: Floats) -> Floats:
        """Each parcel's own shade, with an edge that is as sharp as the pixels there allow."""
        cosine, sine = np.float32(np.cos(_PARCEL_TURN_RAD)), np.float32(np.sin(_PARCEL_TURN_RAD))
        x = (cosine * east_m + sine * north_m) / np.float32(_PARCEL_M[0])
        y = (cosine * north_m - sine * east_m) / np.float32(_PARCEL_M[1])
        return sampled(self._parcels, _edged(x, covered_m / _PARCEL_M[0]), _edged(y, covered_m / _PARCEL_M[1]))

    def _shadow(self, east_m: Floats, north_m: Floats, stamp_s: float) -> Floats:
        drift_m = stamp_s * self._scene.wind_mps
        x = (east_m - np.float32(_WIND[0] * drift_m % (TILE * _SHADOW_CELL_M))) / np.float32(_SHADOW_CELL_M)
        y = (north_m - np.float32(_WIND[1] * drift_m % (TILE * _SHADOW_CELL_M))) / np.float32(_SHADOW_CELL_M)
        return np.asarray(smoothstep((sampled(self._clouds, x, y) - 0.1) * 2.0))

    def _cloud(self, directions: Floats, up: Floats, position_enu_m: FloatArray, stamp_s: float) -> Floats:
        far = np.float32(_CLOUD_BASE_M - position_enu_m[2]) / np.maximum(up, np.float32(0.02))
        here_m = position_enu_m[:2] - np.array(_WIND) * stamp_s * self._scene.wind_mps
        x, y = ((far * directions[axis] + np.float32(here_m[axis])) / np.float32(_CLOUD_CELL_M) for axis in (0, 1))
        cover = sampled(self._clouds, x, y) + np.float32(0.4) * sampled(self._waves[0], 3.0 * x, 3.0 * y)
        share = smoothstep((cover - np.float32(1.0 - 2.0 * self._scene.cloud_cover)) * 0.8)
        return np.asarray(share * np.clip((up - 0.03) / 0.12, 0.0, 0.8), dtype=np.float32)

    def _sea(self, east_m: Floats, north_m: Floats, covered_m: Floats, stamp_s: float) -> Floats:
        """Waves of several lengths, each layer running its own way at its own speed: no place keeps its texture."""
        light = np.zeros_like(east_m)
        for number, (length_m, speed_mps) in enumerate(_WAVES):
            seen = np.clip(1.6 - covered_m / np.float32(length_m), 0.0, 1.0)
            for side in (-1.0, 1.0):
                turn = 0.9 + side * (0.5 + 0.1 * number)
                x = (east_m - np.float32(speed_mps * stamp_s * np.cos(turn))) / np.float32(length_m)
                y = (north_m - np.float32(speed_mps * stamp_s * np.sin(turn))) / np.float32(length_m)
                light += sampled(self._waves[number], x + np.float32(40.0 * side), y) * seen
        share = np.clip(0.35 + np.float32(0.11 * self._scene.contrast) * light, 0.0, 1.2)
        colours = (self._scene.forest_bgr, self._scene.field_bgr)
        low, high = (np.array(colour, np.float32)[:, None, None] for colour in colours)
        return np.asarray(low + (high - low) * share)


def _edged(x: Floats, covered: Floats) -> Floats:
    """Cells x with all of the change between two of them within one pixel, which covers so many cells."""
    whole = np.floor(x)
    return np.asarray(whole + np.clip((x - whole - 0.5) / np.maximum(covered, 1e-3) + 0.5, 0.0, 1.0), dtype=np.float32)
