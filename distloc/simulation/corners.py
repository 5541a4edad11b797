"""Corners that a tracker would follow in a simulated landscape: points on the earth, seen with noise for a while."""

import numpy as np

from distloc.geometry.camera import Camera
from distloc.scenery.corners import Corners
from distloc.simulation.flights import Flown
from distloc.types import BoolArray, CameraPose, FloatArray

_CELLS = (8, 5)  # columns and rows over which corners are spread
_BORDER_PX = 5.0
_NEAREST_M = 40.0


class SimulatedCorners:
    """At most `most` at a time, each for at most `longest` frames, lost by chance in a share `lost` of them.

    The points (3, N) in ENU are fixed; `pixel_sigma_px` is the noise of each coordinate, which the corners tell.
    """

    def __init__(
        self,
        camera: Camera,
        points_enu_m: FloatArray,
        rng: np.random.Generator,
        most: int = 40,
        longest: int = 25,
        lost: float = 0.03,
        pixel_sigma_px: float = 0.7,
    ) -> None:
        self._camera, self._points, self._rng = camera, points_enu_m, rng
        self._most, self._longest, self._lost, self._sigma_px = most, longest, lost, pixel_sigma_px
        self._held: dict[int, tuple[int, int]] = {}  # of a point: its name and for how many frames
        self._next = 0

    def at(self, pose: CameraPose) -> Corners:
        """Those in the frame of a true pose."""
        in_camera = pose.R_cam_from_enu @ (self._points - pose.position_enu_m[:, None])
        pixels, is_inside = self._camera.project(in_camera)
        is_seen = is_inside & (in_camera[2] > _NEAREST_M)
        is_seen[is_inside] &= self._off_border(pixels[:, is_inside])
        self._held = {
            point: (name, age + 1)
            for point, (name, age) in self._held.items()
            if is_seen[point] and age < self._longest and self._rng.random() >= self._lost
        }
        self._start(pixels, is_seen)
        points = np.array(list(self._held), dtype=np.intp)
        names = np.array([name for name, _ in self._held.values()], dtype=np.int64)
        noise = self._sigma_px * self._rng.standard_normal((2, points.size))
        return Corners(names, pixels[:, points] + noise, np.full(points.size, self._sigma_px))

    @property
    def places_enu_m(self) -> FloatArray:
        """Where the corners of the last frame truly are (3, n), in the order of their names."""
        return self._points[:, list(self._held)]

    def _start(self, pixels: FloatArray, is_seen: BoolArray) -> None:
        """New ones where the image has fewest."""
        candidates = np.flatnonzero(is_seen)
        candidates = candidates[~np.isin(candidates, list(self._held))]
        self._rng.shuffle(candidates)
        size = np.array([[self._camera.width], [self._camera.height]]) / np.array(_CELLS)[:, None]
        cells = [tuple(cell) for cell in (pixels[:, candidates] // size).T.astype(int)]
        full: dict[tuple[int, ...], int] = {}
        for cell in (pixels[:, list(self._held)] // size).T.astype(int):
            full[tuple(cell)] = full.get(tuple(cell), 0) + 1
        for level in range(self._most):
            for point, cell in zip(candidates, cells, strict=True):
                if len(self._held) >= self._most:
                    return
                if full.get(cell, 0) <= level and int(point) not in self._held:
                    self._held[int(point)] = (self._next, 1)
                    self._next += 1
                    full[cell] = full.get(cell, 0) + 1

    def _off_border(self, pixels: FloatArray) -> BoolArray:
        size = np.array([[self._camera.width], [self._camera.height]])
        return np.asarray(((pixels > _BORDER_PX) & (pixels < size - 1 - _BORDER_PX)).all(axis=0))


def corners_along(camera: Camera, flight: Flown, rng: np.random.Generator) -> SimulatedCorners:
    """As a tracker would follow them in a landscape about a flight."""
    path = np.stack([flight.pose_at(float(stamp_s)).position_enu_m for stamp_s in flight.stamps_s], axis=1)
    return SimulatedCorners(camera, landscape_points(rng, path), rng)


def landscape_points(
    rng: np.random.Generator, path_enu_m: FloatArray, n: int = 6000, reach_m: float = 4000.0
) -> FloatArray:
    """Points (3, n) about a path (3, T), denser near it: trees and houses on ground that rises and falls by 30 m."""
    about = path_enu_m[:2, rng.integers(0, path_enu_m.shape[1], n)]
    distance_m = 30.0 * (reach_m / 30.0) ** rng.random(n)
    angle = rng.uniform(0.0, 2.0 * np.pi, n)
    east, north = about + distance_m * np.stack([np.cos(angle), np.sin(angle)])
    ground_m = 30.0 * np.sin(east / 430.0 + 1.0) * np.sin(north / 610.0)
    return np.stack([east, north, ground_m + rng.uniform(0.0, 20.0, n)])
