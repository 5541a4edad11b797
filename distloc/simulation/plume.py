"""A smoke plume that stands at a place on the earth, as soft puffs; the renderer draws it."""

from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np

from distloc.geometry.camera import Camera
from distloc.types import CameraPose, FloatArray

_TEXTURE_PX = 64
_CANVAS_PX = 360.0  # a plume that fills the frame is drawn at a coarser scale: it is soft
_SMOKE_BGR = np.array([205.0, 203.0, 200.0])


@dataclass(frozen=True, slots=True)
class Plume:
    """A plume's place and size when it has grown; the wind leans it by (wind / 10 m/s) of its height at the top.

    It starts at `start_share` of its size at stamp 0 and is grown after `growth_s`; `density` scales its opacity.
    """

    base_enu_m: FloatArray
    height_m: float
    width_m: float
    wind_enu_mps: FloatArray
    growth_s: float = 300.0
    start_share: float = 0.9
    rise_mps: float = 3.0
    density: float = 1.0

    def __post_init__(self) -> None:
        if not (self.height_m > 0.0 and self.width_m > 0.0 and self.growth_s > 0.0):
            raise ValueError(f"a plume's sizes must be > 0, got {self.height_m}, {self.width_m}, {self.growth_s}")

    @property
    def centre_enu_m(self) -> FloatArray:
        """The centre (3,) of the grown plume's volume as it is seen: the middle of its outline weighted by width."""
        share = np.linspace(0.0, 1.0, 101)
        weight = self.radius_m(share)
        return np.asarray(self.axis_enu_m(share * self.reach) @ (weight / weight.sum()))

    @property
    def reach(self) -> float:
        """The share of the height at which the highest puffs' middles are: their own radius ends at the height."""
        return max(0.3, 1.0 - 0.3 * self.width_m / self.height_m)

    def size_share(self, stamp_s: float) -> float:
        """How much of its size it has at a time, from `start_share` to 1."""
        return float(
            np.clip(self.start_share + (1.0 - self.start_share) * stamp_s / self.growth_s, self.start_share, 1)
        )

    def radius_m(self, share: FloatArray) -> FloatArray:
        """The plume's half-width (N,) at shares of its height: narrow at the fire, widest near the top."""
        return np.asarray(0.5 * self.width_m * (0.3 + 0.7 * np.sqrt(share)))

    def axis_enu_m(self, share: FloatArray) -> FloatArray:
        """The plume's middle line (3, N) at shares (N,) of its height."""
        lean = 0.1 * self.height_m * np.asarray(self.wind_enu_mps, dtype=np.float64)
        up = np.array([0.0, 0.0, self.height_m])
        return np.asarray(self.base_enu_m)[:, None] + lean[:, None] * share**1.5 + up[:, None] * share


class PlumePainter:
    """Draws one plume as `n_puffs` puffs, each on its own way up, through the camera model."""

    def __init__(self, plume: Plume, rng: np.random.Generator, n_puffs: int = 140) -> None:
        self._plume = plume
        self._share = rng.uniform(0.0, 1.0, n_puffs)
        radius = np.sqrt(rng.uniform(0.0, 1.0, n_puffs))
        angle = rng.uniform(0.0, 2.0 * np.pi, n_puffs)
        self._across = 0.62 * np.stack(
            [radius * np.cos(angle), radius * np.sin(angle), 0.25 * rng.normal(size=n_puffs)]
        )
        self._size = rng.uniform(0.32, 0.6, n_puffs)
        self._tint = rng.uniform(0.92, 1.04, n_puffs)
        self._textures = [_puff_texture(rng) for _ in range(6)]

    def range_m(self, pose: CameraPose) -> float:
        """How far the middle of the plume's foot is."""
        return float(np.linalg.norm(self._plume.base_enu_m - pose.position_enu_m))

    def paint(
        self,
        camera: Camera,
        pose: CameraPose,
        haze_bgr: FloatArray,
        haze_range_m: float,
        image: np.ndarray,
        alpha: np.ndarray,
        in_camera: Callable[[FloatArray], FloatArray] | None = None,
        visible: np.ndarray | None = None,
    ) -> None:
        """Blend the plume into `image` (H, W, 3) uint8 and its opacity into `alpha` (H, W) float32, both in place.

        `in_camera` gives points (3, N) in the camera's axes where not all rows share the pose; `visible` (H, W) float32
        is 0 where something nearer hides the plume.
        """
        centres_px, radius_px, tint, opacity, range_m = self._puffs(camera, pose, in_camera)
        if radius_px.size == 0:
            return
        low = np.floor((centres_px - radius_px).min(axis=1)).astype(int)
        high = np.ceil((centres_px + radius_px).max(axis=1)).astype(int) + 1
        u0, v0 = np.maximum(low, 0)
        u1, v1 = np.minimum(high, [camera.width, camera.height])
        if u1 - u0 < 1 or v1 - v0 < 1:
            return
        scale = min(1.0, _CANVAS_PX / max(u1 - u0, v1 - v0))
        shape = (max(1, round((v1 - v0) * scale)), max(1, round((u1 - u0) * scale)))
        shade, cover = np.zeros(shape, np.float32), np.zeros(shape, np.float32)
        for index in range(radius_px.size):
            u, v = (centres_px[:, index] - [u0, v0] + 0.5) * scale - 0.5
            texture = self._textures[index % len(self._textures)]
            _over(shade, cover, texture, u, v, radius_px[index] * scale, tint[index], opacity[index])
        size = (int(u1 - u0), int(v1 - v0))
        shade, cover = cv2.resize(shade, size), cv2.resize(cover, size)
        if visible is not None:
            shade, cover = shade * visible[v0:v1, u0:u1], cover * visible[v0:v1, u0:u1]
        haze = 1.0 - np.exp(-range_m / haze_range_m)
        smoke = (1.0 - haze) * _SMOKE_BGR.astype(np.float32) * shade[..., None]
        smoke += np.float32(haze) * haze_bgr.astype(np.float32) * cover[..., None]
        view = image[v0:v1, u0:u1]
        view[...] = np.clip(view * (1.0 - cover[..., None]) + smoke, 0.0, 255.0).astype(np.uint8)
        part = alpha[v0:v1, u0:u1]
        part[...] = 1.0 - (1.0 - part) * (1.0 - cover)

    def _puffs(
        self, camera: Camera, pose: CameraPose, in_camera: Callable[[FloatArray], FloatArray] | None
    ) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, float]:
        """Centres (2, N), radii, tints and opacities (N,) of the puffs in view, farthest first; the plume's range."""
        plume, size = self._plume, self._plume.size_share(pose.stamp_s)
        share = (self._share + pose.stamp_s * plume.rise_mps / plume.height_m) % 1.0
        half_width = plume.radius_m(share)
        places = plume.axis_enu_m(share * plume.reach) + half_width * self._across
        places = plume.base_enu_m[:, None] + size * (places - plume.base_enu_m[:, None])
        places_cam = (
            pose.R_cam_from_enu @ (places - pose.position_enu_m[:, None]) if in_camera is None else in_camera(places)
        )
        pixels, _ = camera.project(places_cam)
        radius = size * half_width * self._size * 1.4
        range_m = np.linalg.norm(places_cam, axis=0)
        radius_px = camera.fx * radius / np.maximum(places_cam[2], 1.0)
        # a wide margin keeps puffs whose edge is in the image; far outside, a distortion polynomial folds back
        tangent = np.hypot(places_cam[0], places_cam[1]) / np.maximum(places_cam[2], 1e-3)
        near = (
            np.isfinite(pixels).all(axis=0)
            & (places_cam[2] > 2.0 * radius)
            & (tangent < 1.3 * np.hypot(camera.width, camera.height) / camera.fx)
        )
        order = np.flatnonzero(near)[np.argsort(-range_m[near])]
        # puffs appear at the fire and dissolve at the top
        opacity = np.clip(share / 0.06, 0.0, 1.0) * np.clip((1.0 - share) / 0.15, 0.0, 1.0) * (0.85 - 0.35 * share)
        tint = self._tint * (0.86 + 0.14 * share)
        return (
            pixels[:, order],
            radius_px[order],
            tint[order],
            np.clip(plume.density * opacity[order], 0.0, 1.0),
            float(range_m.mean()),
        )


def _over(
    shade: np.ndarray,
    cover: np.ndarray,
    texture: np.ndarray,
    u: float,
    v: float,
    radius: float,
    tint: float,
    opacity: float,
) -> None:
    """Lay one puff over what is there (Porter and Duff's "over"), in place."""
    u0, v0 = max(0, int(np.floor(u - radius))), max(0, int(np.floor(v - radius)))
    u1, v1 = min(cover.shape[1], int(np.ceil(u + radius)) + 1), min(cover.shape[0], int(np.ceil(v + radius)) + 1)
    if u1 <= u0 or v1 <= v0 or radius < 0.2:
        return
    step = _TEXTURE_PX / (2.0 * radius)
    warp = np.array([[step, 0.0, (u0 - u + radius) * step], [0.0, step, (v0 - v + radius) * step]])
    patch = cv2.warpAffine(texture, warp, (u1 - u0, v1 - v0), flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP)
    puff = patch[..., 0] * np.float32(opacity)
    rest = 1.0 - puff
    shade_view, cover_view = shade[v0:v1, u0:u1], cover[v0:v1, u0:u1]
    shade_view *= rest
    shade_view += puff * patch[..., 1] * np.float32(tint)
    cover_view *= rest
    cover_view += puff


def _puff_texture(rng: np.random.Generator) -> np.ndarray:
    """One puff (S, S, 2) float32: opacity and brightness; lit from the upper left, with a ragged edge."""
    axis = np.linspace(-1.0, 1.0, _TEXTURE_PX, dtype=np.float32)
    x, y = np.meshgrid(axis, axis)
    ragged = np.zeros((_TEXTURE_PX, _TEXTURE_PX), np.float32)
    for cells, weight in ((5, 0.30), (10, 0.18), (20, 0.10)):
        noise = rng.normal(size=(cells, cells)).astype(np.float32)
        ragged += np.float32(weight) * cv2.resize(noise, (_TEXTURE_PX, _TEXTURE_PX), interpolation=cv2.INTER_CUBIC)
    radius = np.sqrt(x * x + y * y)
    soft = np.clip(1.0 - radius * radius * (1.15 + 0.5 * ragged), 0.0, 1.0) * np.clip((1.0 - radius) / 0.2, 0.0, 1.0)
    lit = np.clip(0.93 - 0.07 * x - 0.14 * y + 0.06 * ragged, 0.6, 1.12)
    return np.stack([soft, lit], axis=-1).astype(np.float32)
