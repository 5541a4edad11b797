"""Smoke as puffs that leave a source, rise and go with the wind; drawn through the true pose into a mask."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from distloc.geometry.camera import Camera
from distloc.types import BoolArray, CameraPose, FloatArray

_RISE_POWER = 0.75  # height against age: Briggs' two thirds and straight up lie about it
_SHEAR_POWER, _SHEAR_REFERENCE_M = 0.15, 10.0  # wind against height, given at 10 m
_PUFFS = 100  # alive at a time
_PATTERN = 509  # puffs until their irregularities repeat
_NEAREST_M = 5.0
_FARTHEST_PX = 8000.0
_SUBPIXEL_BITS = 3
_TREE_LINE_M = 500.0  # to each side


@dataclass(frozen=True, slots=True)
class SmokeLook:
    """How smoke rises: to `height_m` in the `life_s` until it dissolves, `root_m` in radius at its source.

    The radius grows by `spread` of the height. Where it is `puffing_s`, the source smokes for the first and rests for
    the second.
    """

    height_m: float
    life_s: float
    root_m: float = 12.0
    spread: float = 0.2
    puffing_s: tuple[float, float] = (1.0, 0.0)

    def __post_init__(self) -> None:
        sizes = (self.height_m, self.life_s, self.root_m, self.puffing_s[0])
        if not (all(size > 0.0 for size in sizes) and self.spread >= 0.0 and self.puffing_s[1] >= 0.0):
            raise ValueError(f"a smoke's sizes and times must be > 0, its spread and rest >= 0, got {self}")


@dataclass(frozen=True, slots=True)
class Source:
    """Where the smoke comes from (3,) at stamp 0, how the source moves, and from when to when it smokes.

    `wind_enu_mps` (3,) is at 10 m above the source. What is lower than `hidden_m` above it is behind trees.
    """

    place_enu_m: FloatArray
    look: SmokeLook
    wind_enu_mps: FloatArray
    velocity_enu_mps: FloatArray
    lit_s: tuple[float, float] = (-np.inf, np.inf)
    hidden_m: float = 0.0

    def at(self, stamp_s: float) -> FloatArray:
        """The source (3,) at a time: the fire's place on the ground."""
        return np.asarray(self.place_enu_m + stamp_s * self.velocity_enu_mps)


@dataclass(frozen=True, slots=True)
class Puffs:
    """Centres (3, N) and radii (N,) in metres."""

    centres_enu_m: FloatArray
    radii_m: FloatArray


class Smoke:
    """One source's smoke; what it looks like at a time depends on the time and on `rng` at its making alone."""

    def __init__(self, source: Source, rng: np.random.Generator) -> None:
        self.source = source
        self._every_s = source.look.life_s / _PUFFS
        self._offset = rng.uniform(-0.5, 0.5, (3, _PATTERN))
        self._size = rng.uniform(0.6, 1.15, _PATTERN)
        self._phase_s = float(rng.uniform(0.0, sum(source.look.puffing_s)))

    def puffs(self, stamp_s: float) -> Puffs:
        """Those alive: each left the source where that was then and has gone with the wind since."""
        look = self.source.look
        first = np.ceil((stamp_s - look.life_s) / self._every_s)
        number = np.arange(first, np.floor(stamp_s / self._every_s) + 1.0)
        born_s = number * self._every_s
        is_alive = self._is_smoking(born_s)
        born_s, pattern = born_s[is_alive], number[is_alive].astype(np.int64) % _PATTERN
        age_s = stamp_s - born_s
        left = 1.0 - age_s / look.life_s
        up_m = look.height_m * (1.0 - left) ** _RISE_POWER
        radius_m = self._size[pattern] * (look.root_m + look.spread * up_m) * np.clip(4.0 * left, 0.0, 1.0)
        sheared = (up_m / _SHEAR_REFERENCE_M) ** _SHEAR_POWER / (1.0 + _RISE_POWER * _SHEAR_POWER)
        source = self.source.place_enu_m[:, None] + self.source.velocity_enu_mps[:, None] * born_s
        centres = source + self.source.wind_enu_mps[:, None] * (sheared * age_s) + radius_m * self._offset[:, pattern]
        centres[2] += up_m
        return Puffs(centres, radius_m)

    def draw(self, mask: NDArray[np.uint8], camera: Camera, pose: CameraPose) -> None:
        """Set the pixels of `mask` (H, W) that the smoke covers to 255."""
        puffs = self.puffs(pose.stamp_s)
        if self.source.hidden_m == 0.0:
            draw_balls(mask, camera, pose, puffs)
            return
        own = np.zeros_like(mask)
        draw_balls(own, camera, pose, puffs)
        self._hide_foot(own, camera, pose)
        mask |= own

    def direction_box(self, pose: CameraPose) -> tuple[FloatArray, FloatArray]:
        """Least and most (2,) of azimuth and elevation of the smoke and its source from a camera, in radians.

        Azimuths are relative to that of the source.
        """
        source = self.source.at(pose.stamp_s)
        points = np.column_stack([source, self.puffs(pose.stamp_s).centres_enu_m])
        angles = directions_from(pose.position_enu_m, points, source)
        return angles.min(axis=1), angles.max(axis=1)

    def _is_smoking(self, stamp_s: FloatArray) -> BoolArray:
        on_s, off_s = self.source.look.puffing_s
        first_s, last_s = self.source.lit_s
        is_on = (stamp_s + self._phase_s) % (on_s + off_s) < on_s
        return np.asarray(is_on & (stamp_s >= first_s) & (stamp_s < last_s))

    def _hide_foot(self, mask: NDArray[np.uint8], camera: Camera, pose: CameraPose) -> None:
        """Clear what is seen under a level line across the sight, `hidden_m` above the source."""
        source = self.source.at(pose.stamp_s)
        east, north = (source - pose.position_enu_m)[:2]
        across = np.array([north, -east, 0.0]) / max(float(np.hypot(east, north)), 1.0)
        ends = source[:, None] + np.array([0.0, 0.0, self.source.hidden_m])[:, None]
        ends = ends + across[:, None] * np.array([-_TREE_LINE_M, _TREE_LINE_M])
        (u0, u1), (v0, v1) = camera.project(pose.R_cam_from_enu @ (ends - pose.position_enu_m[:, None]))[0]
        if np.isfinite([u0, u1, v0, v1]).all() and u1 - u0 > 1.0:
            columns = np.arange(mask.shape[1])
            line = v0 + (columns - u0) * (v1 - v0) / (u1 - u0)
            mask[np.arange(mask.shape[0])[:, None] > line] = 0


def draw_balls(mask: NDArray[np.uint8], camera: Camera, pose: CameraPose, puffs: Puffs) -> None:
    """Fill the discs that balls nearly are in the picture, at least half a pixel in radius."""
    in_camera = pose.R_cam_from_enu @ (puffs.centres_enu_m - pose.position_enu_m[:, None])
    centres_px, _ = camera.project(in_camera)
    radii_px = np.maximum(camera.fx * puffs.radii_m / np.maximum(in_camera[2], _NEAREST_M), 0.5)
    is_near_frame = (np.abs(centres_px) < _FARTHEST_PX).all(axis=0)  # not for NaN, what is behind
    is_drawn = is_near_frame & (in_camera[2] > _NEAREST_M) & (radii_px < _FARTHEST_PX) & (puffs.radii_m > 0.0)
    scale = 1 << _SUBPIXEL_BITS
    discs = np.rint(scale * np.vstack([centres_px, radii_px])[:, is_drawn]).astype(int)
    for u, v, radius in discs.T.tolist():
        cv2.circle(mask, (u, v), radius, 255, -1, shift=_SUBPIXEL_BITS)


def directions_from(camera_enu_m: FloatArray, points_enu_m: FloatArray, about_enu_m: FloatArray) -> FloatArray:
    """Azimuths relative to that of a point (3,), and elevations (2, N), of points (3, N) in radians."""
    offsets = points_enu_m - camera_enu_m[:, None]
    about = about_enu_m - camera_enu_m
    azimuths = np.arctan2(offsets[0], offsets[1]) - np.arctan2(about[0], about[1])
    azimuths = (azimuths + np.pi) % (2.0 * np.pi) - np.pi
    return np.stack([azimuths, np.arctan2(offsets[2], np.hypot(offsets[0], offsets[1]))])
