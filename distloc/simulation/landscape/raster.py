"""Draws upright things pixel by pixel: each pixel of a thing's frame is a ray, met with the thing's own shape.

So what is drawn of a thing is where it is, from every pose and through every lens. All things' pixels ("fragments") are
worked out at once and then laid over the picture, the farthest first.
"""

import itertools
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from distloc.simulation.landscape.terrain import Horizon
from distloc.simulation.landscape.texture import Floats, of_lists, sampled
from distloc.simulation.landscape.things import BROADLEAF, CONIFER, LAMP, MAST, Boxes, Uprights
from distloc.simulation.landscape.view import View
from distloc.types import BoolArray, FloatArray

_LEAST_PX = 3.0  # smaller things are not drawn; up to twice that they fade in
_NEAREST_M = 20.0
_FARTHEST_M = 4_500.0
_BARK_CELL_M = 0.55
_SUN_RAD = 2.2  # azimuth
_WINDOW_M = 2.4
_ROUNDS = 3  # to where a ray meets a crown: each leaves a tenth of the error
_SUBPIXELS = np.array([[-0.25, -0.25], [0.25, -0.25], [-0.25, 0.25], [0.25, 0.25]], np.float32)


@dataclass(frozen=True, slots=True)
class Fragments:
    """Pixels of things: index in the image, range, BGR (3, N), opacity and whether it gives light of its own (N,)."""

    pixel: NDArray[np.int64]
    range_m: Floats
    bgr: Floats
    alpha: Floats
    is_lamp: BoolArray

    def chosen(self, which: BoolArray) -> "Fragments":
        """Some of them."""
        return Fragments(
            self.pixel[which], self.range_m[which], self.bgr[:, which], self.alpha[which], self.is_lamp[which]
        )


@dataclass(frozen=True, slots=True)
class _Frames:
    """The pixels (M,) of N things' frames: which thing, column, row, and the ray there (3, M) in the earth's axes."""

    thing: NDArray[np.int64]
    u: NDArray[np.int64]
    v: NDArray[np.int64]
    ray: Floats
    position: Floats
    metres_a_pixel: Floats
    fade: Floats


class Rasteriser:
    """For one camera: its pixels' rays, and the texture of bark, leaves and walls."""

    def __init__(self, rays_cam: Floats, tile: Floats) -> None:
        self._rays = rays_cam  # (3, H, W)
        self._tile = tile

    def uprights(self, view: View, horizon: Horizon, middle_rad: float, things: Uprights) -> Fragments:
        """The bodies of revolution in view."""
        seen, frames = self._frames(view, things.base_enu_m, things.radius_m, things.height_m)
        k = seen[frames.thing]
        base = things.base_enu_m[:, k].astype(np.float32) - frames.position
        level_m = np.hypot(base[0], base[1])
        ahead = base[:2] / level_m
        ray = frames.ray
        reach = level_m / np.maximum(ray[0] * ahead[0] + ray[1] * ahead[1], np.float32(1e-3))
        aside_m = reach * (ray[0] * ahead[1] - ray[1] * ahead[0])
        up_m = reach * ray[2] - base[2]
        height, kind = things.height_m[k].astype(np.float32), things.kind[k]
        radius = things.radius_m[k].astype(np.float32)
        mpp = frames.metres_a_pixel
        profile = _profile(kind, up_m / height) * radius
        alpha = (
            np.clip((profile - np.abs(aside_m)) / mpp + 0.5, 0.0, 1.0)
            * np.clip((height - up_m) / mpp + 0.5, 0.0, 1.0)
            * np.clip(up_m / mpp + 0.5, 0.0, 1.0)
            * np.minimum(1.0, 2.0 * profile / mpp)
        )
        is_lamp = kind == LAMP
        if is_lamp.any():  # its head alone, never under two pixels
            apart_m = np.hypot(aside_m, up_m - height)
            head = np.clip((np.maximum(radius, 0.9 * mpp) - apart_m) / mpp + 0.5, 0.0, 1.0)
            alpha = np.where(is_lamp, head, alpha)
        # where on the surface: its near side is nearer than the axis, so the ray is there at another height
        drop = ray[2] * reach / level_m
        depth_m, aside_there_m, up_there_m, profile_there = np.zeros_like(up_m), aside_m, up_m, profile
        for _ in range(_ROUNDS):
            depth_m = np.sqrt(np.maximum(profile_there**2 - aside_there_m**2, 0.0))
            aside_there_m, up_there_m = aside_m * (1.0 - depth_m / level_m), up_m - depth_m * drop
            profile_there = np.maximum(_profile(kind, up_there_m / height) * radius, 1e-3)
        share = np.clip(aside_there_m / profile_there, -1.0, 1.0)
        azimuth = np.arctan2(ahead[0], ahead[1]) + np.float32(np.pi) - np.arcsin(share)
        crest = horizon.crest(_relative(np.arctan2(ahead[0], ahead[1]), middle_rad), level_m)
        alpha = alpha * frames.fade * np.clip((up_m + base[2] - crest * level_m) / mpp + 0.5, 0.0, 1.0)
        light = self._surface(kind, azimuth, up_there_m, height, radius, mpp, things.turn_rad[k])
        bgr = things.bgr[:, k].astype(np.float32) * light
        return self._made(view, frames, reach * np.linalg.norm(ray, axis=0), bgr, alpha, is_lamp)

    def boxes(self, view: View, horizon: Horizon, middle_rad: float, things: Boxes) -> Fragments:
        """The boxes in view, each pixel's mean of four rays."""
        seen, frames = self._frames(view, things.base_enu_m, np.hypot(*things.size_m[:2]), things.size_m[2])
        k = seen[frames.thing]
        heading = things.heading_rad[k].astype(np.float32)
        cosine, sine = np.cos(heading), np.sin(heading)
        offset = frames.position - things.base_enu_m[:, k].astype(np.float32)
        start = np.stack([cosine * offset[0] + sine * offset[1], cosine * offset[1] - sine * offset[0], offset[2]])
        size = things.size_m[:, k].astype(np.float32)
        low, high = -size, size.copy()
        low[2] = 0.0
        wall, roof = (bgr[:, k].astype(np.float32) for bgr in (things.wall_bgr, things.roof_bgr))
        total, cover = np.zeros_like(wall), np.zeros(k.size, np.float32)
        right, down = self._steps(view, frames)
        for du, dv in _SUBPIXELS:
            ray = frames.ray + du * right + dv * down
            way = np.stack([cosine * ray[0] + sine * ray[1], cosine * ray[1] - sine * ray[0], ray[2]])
            way = np.where(np.abs(way) < 1e-6, np.float32(1e-6), way)
            one, other = (low - start) / way, (high - start) / way
            enters = np.minimum(one, other)
            axis = np.argmax(enters, axis=0)
            at = enters.max(axis=0)
            is_hit = at < np.maximum(one, other).min(axis=0)
            place = start + at * way
            shade = np.where(axis == 0, np.float32(0.82), np.float32(1.0)) * np.where(
                way[axis, np.arange(k.size)] > 0.0, np.float32(0.78), np.float32(1.0)
            )
            bgr = np.where(axis == 2, roof, wall * shade)
            if things.has_windows:
                along = np.where(axis == 0, place[1], place[0])
                is_glass = (axis < 2) & (along % _WINDOW_M < 1.0) & ((place[2] - 0.9) % 2.8 < 1.3)
                bgr = np.where(is_glass, np.float32(58.0), bgr)
            total += bgr * is_hit
            cover += is_hit
        level_m = np.hypot(offset[0], offset[1])
        ahead = np.arctan2(-offset[0], -offset[1])
        crest = horizon.crest(_relative(ahead, middle_rad), level_m)
        rise = frames.ray[2] / np.maximum(np.hypot(frames.ray[0], frames.ray[1]), np.float32(1e-6))
        alpha = cover / len(_SUBPIXELS) * frames.fade
        alpha *= np.clip((rise - crest) * level_m / frames.metres_a_pixel + 0.5, 0.0, 1.0)
        bgr = total / np.maximum(cover, 1.0)
        return self._made(view, frames, np.linalg.norm(offset, axis=0), bgr, alpha, np.zeros(k.size, bool))

    def _frames(
        self, view: View, base_enu_m: FloatArray, radius_m: FloatArray, height_m: FloatArray
    ) -> tuple[NDArray[np.int64], _Frames]:
        camera = view.camera
        offset = base_enu_m - view.pose.position_enu_m[:, None]
        range_m = np.linalg.norm(offset, axis=0)
        size_px = camera.fx * np.maximum(height_m, 2.0 * radius_m) / np.maximum(range_m, 1.0)
        near = np.flatnonzero((range_m > _NEAREST_M) & (range_m < _FARTHEST_M) & (size_px > _LEAST_PX))
        forward = view.pose.R_cam_from_enu[2] @ offset[:, near]
        near = near[forward > 0.3 * range_m[near]]
        level = np.hypot(offset[0, near], offset[1, near])
        side = np.stack([offset[1, near], -offset[0, near], np.zeros(near.size)]) / level * radius_m[near]
        ahead = np.stack([offset[0, near], offset[1, near], np.zeros(near.size)]) / level * radius_m[near]
        up = np.outer([0.0, 0.0, 1.0], height_m[near])
        foot = base_enu_m[:, near]
        corners = [foot + a * side + b * ahead + c * up for a in (-1, 1) for b in (-1, 1) for c in (0, 1)]
        pixels = view.project(np.hstack(corners)).reshape(2, len(corners), near.size)
        is_known = np.isfinite(pixels).all(axis=(0, 1))
        near, pixels = near[is_known], pixels[:, :, is_known]
        low = np.maximum(np.floor(pixels.min(axis=1)) - 1.0, 0.0).astype(np.int64)
        high = np.minimum(np.ceil(pixels.max(axis=1)) + 2.0, [[camera.width], [camera.height]]).astype(np.int64)
        is_in = (high > low).all(axis=0)
        near, low, high = near[is_in], low[:, is_in], high[:, is_in]
        width, height = high - low
        area = width * height
        thing = np.repeat(np.arange(near.size), area)
        place = np.arange(thing.size) - np.repeat(np.cumsum(area) - area, area)
        u, v = low[0, thing] + place % width[thing], low[1, thing] + place // width[thing]
        ray = view.directions(self._rays[:, v, u], v.astype(np.float64))
        position = view.position_enu_m(v.astype(np.float64)).T.astype(np.float32)
        mpp = (range_m[near] / camera.fx)[thing].astype(np.float32)
        fade = np.clip(size_px[near] / _LEAST_PX - 1.0, 0.0, 1.0)[thing].astype(np.float32)
        return near, _Frames(thing, u, v, ray, position, mpp, fade)

    def _steps(self, view: View, frames: _Frames) -> tuple[Floats, Floats]:
        """How a ray changes (3, M) over one pixel to the right and down."""
        _, height, width = self._rays.shape
        u, v = np.minimum(frames.u, width - 2), np.minimum(frames.v, height - 2)
        here = self._rays[:, v, u]
        rows = frames.v.astype(np.float64)
        return (
            view.directions(self._rays[:, v, u + 1] - here, rows),
            view.directions(self._rays[:, v + 1, u] - here, rows),
        )

    def _surface(
        self,
        kind: FloatArray,
        azimuth: Floats,
        up_m: Floats,
        height_m: Floats,
        radius_m: Floats,
        mpp: Floats,
        turn_rad: FloatArray,
    ) -> Floats:
        """How light the surface is (M,): leaves, a trunk, a mast's bands; the sun's side brighter."""
        is_tree = kind <= BROADLEAF
        turn = turn_rad.astype(np.float32)
        x = ((azimuth + turn) % np.float32(2.0 * np.pi)) * np.float32(3.2) + turn * np.float32(20.0)
        y = up_m / np.float32(_BARK_CELL_M * 2.0)
        leaves = of_lists(lambda x, y: sampled(self._tile, x, y), x, y) * np.clip(1.7 - mpp / _BARK_CELL_M, 0.0, 1.0)
        sun = 0.86 + 0.3 * np.cos(azimuth - _SUN_RAD)
        rise = up_m / height_m
        tree = (sun + 0.32 * leaves) * (0.75 + 0.45 * np.clip(rise, 0.0, 1.0))
        bands = np.where(np.floor(rise * 7.0) % 2 > 0, np.float32(0.45), np.float32(1.05))
        other = np.where(kind == MAST, bands, np.float32(1.0))
        return np.asarray(np.where(is_tree, np.clip(tree, 0.25, 2.2), other), dtype=np.float32)

    def _made(
        self, view: View, frames: _Frames, range_m: Floats, bgr: Floats, alpha: Floats, is_lamp: BoolArray
    ) -> Fragments:
        pixel = frames.v * view.camera.width + frames.u
        made = Fragments(pixel, range_m.astype(np.float32), bgr.astype(np.float32), alpha.astype(np.float32), is_lamp)
        return made.chosen(alpha > 0.01)


def joined(parts: list[Fragments]) -> Fragments:
    """All of them as one."""
    return Fragments(
        np.concatenate([part.pixel for part in parts]),
        np.concatenate([part.range_m for part in parts]),
        np.concatenate([part.bgr for part in parts], axis=1),
        np.concatenate([part.alpha for part in parts]),
        np.concatenate([part.is_lamp for part in parts]),
    )


def lay_over(image: NDArray[np.uint8], alpha: Floats, fragments: Fragments) -> None:
    """Blend fragments into `image` (H, W, 3), farthest first, and take what they hide off `alpha` (H, W), in place."""
    if fragments.pixel.size == 0:
        return
    order = np.lexsort((-fragments.range_m, fragments.pixel))
    pixel = fragments.pixel[order]
    starts = np.flatnonzero(np.diff(pixel, prepend=-1))
    rank = np.arange(pixel.size) - np.repeat(starts, np.diff(starts, append=pixel.size))
    by_rank = np.argsort(rank, kind="stable")
    bounds = np.searchsorted(rank[by_rank], np.arange(rank.max() + 2))
    flat, hidden = image.reshape(-1, 3), alpha.reshape(-1)
    touched = pixel[starts]
    local = np.repeat(np.arange(starts.size), np.diff(starts, append=pixel.size))
    picture = flat[touched].astype(np.float32)
    left = np.ones(starts.size, np.float32)
    bgr, opacity = fragments.bgr[:, order].T, fragments.alpha[order]
    for begin, end in itertools.pairwise(bounds):
        which = by_rank[begin:end]
        to, share = local[which], opacity[which]
        picture[to] += share[:, None] * (bgr[which] - picture[to])
        left[to] *= 1.0 - share
    flat[touched] = np.clip(picture + 0.5, 0.0, 255.0).astype(np.uint8)
    hidden[touched] *= left


def _profile(kind: FloatArray, rise: Floats) -> Floats:
    """A body's radius (M,) at shares of its height, in shares of its greatest."""
    rise = np.clip(rise, 0.0, 1.0)
    conifer = np.where(rise < 0.12, np.float32(0.1), (1.0 - rise) / 0.88)
    crown = np.sqrt(np.clip(1.0 - ((rise - 0.62) / 0.38) ** 2, 0.0, 1.0))
    broadleaf = np.maximum(crown, np.where(rise < 0.62, np.float32(0.09), np.float32(0.0)))
    return np.asarray(
        np.where(kind == CONIFER, conifer, np.where(kind == BROADLEAF, broadleaf, np.float32(1.0))), dtype=np.float32
    )


def _relative(azimuth_rad: Floats, middle_rad: float) -> Floats:
    return np.asarray((azimuth_rad - middle_rad + np.pi) % (2.0 * np.pi) - np.pi, dtype=np.float32)
