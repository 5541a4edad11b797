"""Follows corners of the scenery from frame to frame, each found again by how it looked first.

Corners (Shi and Tomasi 1994) where the reported pose says ground, never in the smoke, spread over the image; pyramidal
Lucas-Kanade there and back from where the reported turn puts them; then each is aligned with its first patch, so that
it does not drift.
"""

from dataclasses import replace
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from distloc.geometry.camera import Camera
from distloc.scenery.corners import Corners
from distloc.scenery.own_parts import OwnParts
from distloc.scenery.patches import Patches, is_sane
from distloc.types import BoolArray, CameraPose, FloatArray, MaskArray

Grey = NDArray[np.uint8]

_WIDTH = 1280  # pixels at the most: more is only slower
_WINDOW, _LEVELS = (17, 17), 3
_MOST_BACK_PX = 0.5
_MOST_OFF_PX = 2.0  # of the first patch from where Lucas-Kanade says
_LEAST_CORRELATION = 0.8
_BORDER_PX = 12
_APART_PX = 16
_CELLS = (8, 6)
_BELOW_HORIZON_RAD = float(np.radians(0.7))  # the reported attitude errs
_ASK_AGAIN, _FEW = 0.8, 0.5  # of the corners: fewer, and new ones are looked for, and at once
_QUALITY = 0.01
_WIDER_PX = 25  # about the smoke
_GROUND_M = 30.0  # at least so high, for a guess of how far the ground is
_SIGMA_PX, _SIGMA_GROWTH = 0.35, 0.25  # of a new corner; of the warp's change from 1
_USUAL = 0.25  # of its square: from frame to frame they err by half as much


class CornerTracker:
    """At most `most` corners, each for at most `longest_s`; every array is made at construction.

    None is taken where `own` (h, w), of any size, is not 0: the craft's own parts, as far as they are known.
    """

    def __init__(self, camera: Camera, most: int = 48, longest_s: float = 25.0, own: MaskArray | None = None) -> None:
        self._camera, self._most, self._longest_s = camera, most, longest_s
        self._by, self._size = tracked_size(camera)
        self._names = np.full(most, -1, dtype=np.int64)
        self._pixels = np.zeros((2, most))
        self._since_s = np.zeros(most)
        self._patches = Patches(most)
        self._own = OwnParts(self._size)
        self._known_own = None if own is None or not own.any() else self._resized(own)
        self._next = 0
        self._last: tuple[Grey, CameraPose] | None = None
        self._fresh: Grey | None = None  # the last frame, where it was not looked at for new ones
        self._coarse = 1.0  # the last frame's pixels, where it is of less than the full size
        self._contrast = cv2.createCLAHE(3.0, (8, 8))

    def track(self, image: NDArray[np.uint8], pose: CameraPose, smoke: MaskArray | None = None) -> Corners:
        """The corners in a frame (H, W, 3) or (H, W) at its reported pose; none of them in the smoke (h, w)."""
        self.follow(image, pose, smoke)
        return self.look(smoke)

    def follow(self, image: NDArray[np.uint8], pose: CameraPose, smoke: MaskArray | None = None) -> Corners:
        """The same without new ones, where half are left: whoever is in a hurry lets it `look` for those later."""
        grey = grey_of(image, self._size)
        half = np.asarray(cv2.resize(grey, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA), dtype=np.uint8)
        if self._last is not None:
            self._follow(*self._last, grey, half, pose, self._avoided(smoke))
        self._last = (half, pose)
        self._fresh, self._coarse = grey, self._camera.width / min(image.shape[1], self._size[0])
        self._retire(pose.stamp_s)
        return self.look(smoke) if self._held < _FEW * self._most else self._corners()

    def look(self, smoke: MaskArray | None = None) -> Corners:
        """The last frame's corners, with new ones outside of the smoke (h, w) where few are left."""
        grey, self._fresh = self._fresh, None
        if self._last is not None and grey is not None and self._held < _ASK_AGAIN * self._most:
            self._look(grey, *self._last, self._avoided(smoke))
        return self._corners()

    def outside(self, corners: Corners, smoke: MaskArray) -> Corners:
        """Those of a frame's corners that are not in its smoke (h, w), found later; the others are given up."""
        avoid = self._avoided(smoke)
        if avoid is None:
            return corners
        good = self._is_free(avoid, (corners.pixels + 0.5) / self._by - 0.5)
        self._names[np.isin(self._names, corners.names[~good])] = -1
        return replace(
            corners, names=corners.names[good], pixels=corners.pixels[:, good], sigma_px=corners.sigma_px[good]
        )

    def forget(self) -> None:
        """The next frame has none before it."""
        self._last, self._fresh = None, None
        self._names.fill(-1)

    @property
    def _held(self) -> int:
        return int((self._names >= 0).sum())

    def _corners(self) -> Corners:
        held = np.flatnonzero(self._names >= 0)
        stretch = np.abs(self._patches.warp[held] - np.eye(2)).max(axis=(1, 2), initial=0.0)
        sigma_px = self._coarse * np.hypot(_SIGMA_PX, _SIGMA_GROWTH * stretch)
        full_px = (self._pixels[:, held] + 0.5) * self._by - 0.5
        return Corners(self._names[held].copy(), full_px, sigma_px, usual=_USUAL)

    def _follow(
        self, before: Grey, last: CameraPose, grey: Grey, half: Grey, pose: CameraPose, avoid: Grey | None
    ) -> None:
        """Where the corners are now; those that are lost, moved by themselves or went into the smoke are given up."""
        held = np.flatnonzero(self._names >= 0)
        if held.size == 0:
            return
        old_px = self._pixels[:, held]
        expected_px = self._expected(old_px, last, pose)
        new_px, good = _followed(before, half, old_px, expected_px)
        good &= self._is_inside(new_px)
        refined_px, correlation = self._patches.find(held, grey, np.where(good, new_px, old_px))
        good &= (correlation > _LEAST_CORRELATION) & is_sane(self._patches.warp[held])
        good &= (np.abs(refined_px - new_px).max(axis=0) < _MOST_OFF_PX) & self._is_inside(refined_px)
        good &= ~self._own.are_own(old_px, refined_px, expected_px, good)
        if avoid is not None:
            good &= self._is_free(avoid, refined_px)
        self._pixels[:, held] = refined_px
        self._names[held[~good]] = -1

    def _expected(self, pixels: FloatArray, last: CameraPose, pose: CameraPose) -> FloatArray:
        """Where the reported poses put corners (2, n) that stand on flat ground."""
        rays = last.R_cam_from_enu.T @ self._camera.rays((pixels + 0.5) * self._by - 0.5)
        height_m = max(float(last.position_enu_m[2]), _GROUND_M)
        depth_m = height_m / np.maximum(-rays[2], 0.01)
        points = rays * depth_m + (last.position_enu_m - pose.position_enu_m)[:, None]
        expected_px, _ = self._camera.project(pose.R_cam_from_enu @ points)
        expected_px = (expected_px + 0.5) / self._by - 0.5
        return np.where(np.isfinite(expected_px), expected_px, pixels)

    def _is_inside(self, pixels: FloatArray) -> BoolArray:
        size = np.array(self._size)[:, None]
        with np.errstate(invalid="ignore"):
            return np.asarray(((pixels > _BORDER_PX) & (pixels < size - 1 - _BORDER_PX)).all(axis=0))

    def _is_free(self, avoid: Grey, pixels: FloatArray) -> BoolArray:
        u, v = np.clip(pixels.astype(int), 0, np.array(self._size)[:, None] - 1)
        return np.asarray(avoid[v, u] == 0)

    def _retire(self, stamp_s: float) -> None:
        """A corner that was followed for long is looked for anew, under another name."""
        self._names[(stamp_s - self._since_s > self._longest_s) | (self._since_s > stamp_s)] = -1

    def _avoided(self, smoke: MaskArray | None) -> Grey | None:
        """Where the smoke is (h, w), widened, and the craft's own parts."""
        if smoke is None or not smoke.any():
            return self._known_own
        wide = np.asarray(cv2.dilate(self._resized(smoke), np.ones((_WIDER_PX, _WIDER_PX), np.uint8)), np.uint8)
        return wide if self._known_own is None else wide | self._known_own

    def _resized(self, mask: MaskArray) -> Grey:
        return np.asarray(cv2.resize(mask.astype(np.uint8), self._size, interpolation=cv2.INTER_NEAREST), np.uint8)

    def _look(self, grey: Grey, half: Grey, pose: CameraPose, avoid: Grey | None) -> None:
        """New corners where the image has fewest."""
        free = np.flatnonzero(self._names < 0)
        allowed = self._ground(pose) & self._own.allowed()
        if avoid is not None:
            allowed[avoid > 0] = 0
        held_px = self._pixels[:, self._names >= 0]
        for u, v in held_px.T.round().astype(int):
            cv2.circle(allowed, (int(u), int(v)), _APART_PX, 0, -1)
        mask = cv2.resize(allowed, half.shape[1::-1], interpolation=cv2.INTER_NEAREST)
        found = cv2.goodFeaturesToTrack(
            self._contrast.apply(half), 4 * self._most, _QUALITY, _APART_PX // 2, mask=mask, blockSize=5
        )
        if found is None:
            return
        new_px = (found.reshape(-1, 2).T.astype(np.float64) + 0.5) * 2.0 - 0.5
        new_px = new_px[:, self._spread(new_px, held_px, free.size)]
        slots = free[: new_px.shape[1]]
        self._patches.take(slots, grey, new_px)
        self._pixels[:, slots] = new_px
        good = slots[self._patches.is_good[slots]]
        self._names[good] = self._next + np.arange(good.size)
        self._next += good.size
        self._since_s[good] = pose.stamp_s

    def _spread(self, new_px: FloatArray, held_px: FloatArray, room: int) -> NDArray[np.intp]:
        """Indices of at most `room` of pixels (2, n), best first, from the emptiest cells of the image."""
        size = np.array(self._size)[:, None] / np.array(_CELLS)[:, None]
        by = np.array([1, _CELLS[0]])
        counts = np.bincount(by @ (held_px // size).astype(np.intp), minlength=_CELLS[0] * _CELLS[1])
        rank = np.zeros(new_px.shape[1])
        for index, cell in enumerate(by @ (new_px // size).astype(np.intp)):
            rank[index] = counts[cell]
            counts[cell] += 1
        return np.asarray(np.argsort(rank, kind="stable")[:room])

    def _ground(self, pose: CameraPose) -> Grey:
        """255 where the reported attitude says ground, well below the horizon, and off the border (h, w)."""
        step = 16
        u, v = np.meshgrid(np.arange(0, self._size[0], step), np.arange(0, self._size[1], step))
        grid = (np.stack([u, v]).reshape(2, -1).astype(np.float64) + 0.5) * self._by - 0.5
        up = np.asarray(pose.R_cam_from_enu[:, 2] @ self._camera.rays(grid))
        below = (up < -np.sin(_BELOW_HORIZON_RAD)).reshape(u.shape)
        ground = cv2.resize(below.astype(np.uint8) * 255, self._size, interpolation=cv2.INTER_NEAREST)
        border = 2 * _BORDER_PX
        ground[:border], ground[-border:], ground[:, :border], ground[:, -border:] = 0, 0, 0, 0
        return np.asarray(ground, dtype=np.uint8)


def tracked_size(camera: Camera) -> tuple[int, tuple[int, int]]:
    """By which whole number frames are made smaller, and the width and height that they have then."""
    by = max(1, -(-camera.width // _WIDTH))
    return by, (camera.width // by, camera.height // by)


def grey_of(image: NDArray[np.uint8], size: tuple[int, int]) -> Grey:
    """A frame (H, W, 3) or (H, W) in grey levels at a width and height."""
    grey = image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
    if grey.shape[1::-1] != size:
        grey = cv2.resize(grey, size, interpolation=cv2.INTER_AREA)
    return np.asarray(grey, dtype=np.uint8)


def _followed(before: Grey, now: Grey, old_px: FloatArray, expected_px: FloatArray) -> tuple[FloatArray, BoolArray]:
    """By Lucas-Kanade there and back on images of half the size: pixels (2, n) and which of them came home (n,)."""
    settings: dict[str, Any] = {"winSize": _WINDOW, "maxLevel": _LEVELS, "flags": cv2.OPTFLOW_USE_INITIAL_FLOW}
    start, expected = _halved(old_px), _halved(expected_px)
    ahead, found, _ = cv2.calcOpticalFlowPyrLK(before, now, start, expected, **settings)
    back, found_back, _ = cv2.calcOpticalFlowPyrLK(now, before, ahead, start.copy(), **settings)
    good = (found.ravel() == 1) & (found_back.ravel() == 1)
    good &= np.linalg.norm((back - start).reshape(-1, 2), axis=1) < _MOST_BACK_PX
    return (ahead.reshape(-1, 2).T.astype(np.float64) + 0.5) * 2.0 - 0.5, np.asarray(good)


def _halved(pixels: FloatArray) -> NDArray[np.float32]:
    """Pixels (2, n) in the image of half the size, as OpenCV takes points."""
    return np.ascontiguousarray(((pixels + 0.5) / 2.0 - 0.5).T.reshape(-1, 1, 2), dtype=np.float32)
