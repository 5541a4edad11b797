"""What a camera adds to what it sees: the blur of its motion, noise that is new in each frame, JPEG's blocks."""

from dataclasses import dataclass
from statistics import NormalDist

import cv2
import numpy as np
from numpy.typing import NDArray

from distloc.geometry.camera import Camera
from distloc.simulation.landscape.texture import Floats
from distloc.simulation.landscape.view import PoseAt
from distloc.types import CameraPose

Image = NDArray[np.uint8]
_GRID_PX = 16
_TAPS = np.linspace(-0.4, 0.4, 5)  # the middles of five equal parts of the exposure
_LEAST_PX = 0.4  # a shorter smear is none
_SKY_M = 1e6
_PATTERN = 1.6  # grey levels by which a pixel always errs, where they are seen enlarged


@dataclass(frozen=True, slots=True)
class CameraFaults:
    """How far a camera is from a perfect one; all zero, and no JPEG, is perfect.

    The rows are read from the top down over `readout_s`, the middle one at the frame's stamp; each is exposed for
    `exposure_s` about its own moment. With a digital `zoom` the sensor has so many times fewer pixels each way, which
    are not quite alike, and gives an enlarged picture. JPEG is for who hands pictures on: the renderer gives them
    before it.
    """

    readout_s: float = 0.0
    exposure_s: float = 0.0
    jpeg_quality: int | None = None
    zoom: int = 1

    @property
    def is_moving(self) -> bool:
        """Whether a frame shows more than one moment."""
        return self.readout_s > 0.0 or self.exposure_s > 0.0


def compressed(image: Image, quality: int | None) -> Image:
    """An image after JPEG of a quality, unchanged where there is none."""
    if quality is None:
        return image
    _, data = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, quality])
    return np.asarray(cv2.imdecode(data, cv2.IMREAD_COLOR), dtype=np.uint8)


class Sensor:
    """Spoils pictures; the noise is drawn by `seed` and the frame's stamp."""

    def __init__(self, camera: Camera, faults: CameraFaults, noise: float, seed: int) -> None:
        self._camera, self._faults, self._seed = camera, faults, seed
        levels = [noise * NormalDist().inv_cdf((index + 0.5) / 256.0) for index in range(256)]
        self._levels = np.rint(levels).astype(np.int16)
        self._size = (max(2, camera.width // _GRID_PX), max(2, camera.height // _GRID_PX))
        u, v = (
            (np.arange(n) + 0.5) * full / n - 0.5
            for n, full in zip(self._size, (camera.width, camera.height), strict=True)
        )
        self._grid = np.stack(np.meshgrid(u, v)).reshape(2, -1)
        self._rays = camera.rays(self._grid)
        size = (camera.height // faults.zoom, camera.width // faults.zoom, 1)
        self._pattern = np.random.default_rng(seed).normal(0.0, _PATTERN, size) if faults.zoom > 1 else None
        sides = (camera.width, camera.height) if faults.exposure_s > 0.0 else (1, 1)
        self._u, self._v = np.meshgrid(*(np.arange(side, dtype=np.float32) for side in sides))

    def smeared(self, image: Image, range_m: Floats, pose: CameraPose, pose_at: PoseAt | None) -> Image:
        """The image as it looks when the camera moves during the exposure; `range_m` (h, w) is how far things are."""
        if pose_at is None or self._faults.exposure_s <= 0.0:
            return image
        flow = self._flow(range_m, pose, pose_at)
        if np.hypot(*flow).max() < _LEAST_PX:
            return image
        size = (self._camera.width, self._camera.height)
        du, dv = (cv2.resize(one.astype(np.float32), size, interpolation=cv2.INTER_LINEAR) for one in flow)
        total = np.zeros(image.shape, np.float32)
        for share in _TAPS.astype(np.float32):
            tap = cv2.remap(
                image, self._u + share * du, self._v + share * dv, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
            )
            cv2.accumulate(tap, total)
        return np.asarray(cv2.convertScaleAbs(total, alpha=1.0 / len(_TAPS)), dtype=np.uint8)

    def noisy(self, image: Image, stamp_s: float) -> Image:
        """The image with the frame's own noise."""
        rng = np.random.default_rng([self._seed, round(abs(stamp_s) * 1e6)])
        drawn = np.frombuffer(rng.bytes(image.size), np.uint8).reshape(image.shape)
        return np.asarray(cv2.add(image, cv2.LUT(drawn, self._levels), dtype=cv2.CV_8U), dtype=np.uint8)

    def zoomed(self, image: Image) -> Image:
        """The image of fewer pixels, enlarged."""
        if self._pattern is None:
            return image
        height, width, _ = self._pattern.shape
        small = cv2.resize(image, (width, height), interpolation=cv2.INTER_AREA) + self._pattern
        small = np.clip(np.rint(small), 0.0, 255.0).astype(np.uint8)
        return np.asarray(cv2.resize(small, image.shape[1::-1], interpolation=cv2.INTER_LINEAR), dtype=np.uint8)

    def _flow(self, range_m: Floats, pose: CameraPose, pose_at: PoseAt) -> NDArray[np.float64]:
        """By how much (2, h, w) what is at a pixel moves over the exposure."""
        far_m = cv2.resize(np.where(np.isfinite(range_m), range_m, _SKY_M), self._size, interpolation=cv2.INTER_NEAREST)
        points = pose.position_enu_m[:, None] + pose.R_cam_from_enu.T @ (self._rays * far_m.reshape(-1))
        half_s = 0.5 * self._faults.exposure_s
        ends = [pose_at(pose.stamp_s + side * half_s) for side in (-1.0, 1.0)]
        before, after = (
            self._camera.project(end.R_cam_from_enu @ (points - end.position_enu_m[:, None]))[0] for end in ends
        )
        return np.nan_to_num(after - before).reshape(2, self._size[1], self._size[0])
