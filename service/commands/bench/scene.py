"""The paper's scene as the filters see it, and how contenders fly it: a cube 2 km ahead on a perpendicular flight."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Protocol

import cv2
import numpy as np
from numpy.typing import NDArray

from distloc.filter.settings import LocalizerConfig
from distloc.sights.detections import detections_from_mask
from distloc.sights.sight import Sight
from distloc.sights.sights import ray_of, sight_of
from distloc.study.scenes import PAPER_CAMERA, PAPER_TARGET_ENU_M, paper_scene
from distloc.types import CameraPose, FloatArray
from service.commands.bench.timing import timed_s

SIGMA_P_M = 5.0  # the paper's
_PAD_PX = 28  # exp(-28^2) is 0 in float64: what lies farther off weighs nothing


@dataclass(frozen=True, slots=True)
class Near:
    """Squared distances (h, w) in px^2 to the nearest positive pixel, by a chamfer map, about a mask's box."""

    squared_px2: FloatArray
    left: int
    top: int

    def log_weights(self, positions_enu_m: FloatArray, pose: CameraPose) -> FloatArray:
        """-min d^2 (N,) of positions (3, N), at the nearest pixel; outside the map its edge's, which weighs nothing."""
        camera = PAPER_CAMERA
        K = np.array([[camera.fx, 0.0, camera.cx], [0.0, camera.fy, camera.cy], [0.0, 0.0, 1.0]])
        P = K @ pose.R_cam_from_enu
        q = P @ positions_enu_m
        q -= (P @ pose.position_enu_m)[:, None]
        behind = q[2] <= 0.0
        with np.errstate(divide="ignore", invalid="ignore"):
            q[:2] /= q[2]
        height, width = self.squared_px2.shape
        q[0] -= self.left
        q[1] -= self.top
        np.rint(q[:2], out=q[:2])
        np.clip(q[0], 0.0, width - 1.0, out=q[0])
        np.clip(q[1], 0.0, height - 1.0, out=q[1])
        index = (q[1] * width + q[0]).astype(np.intp)
        log = -self.squared_px2.ravel().take(index, mode="clip")
        log[behind] = -np.inf
        return np.asarray(log)


@dataclass(frozen=True, slots=True)
class Seen:
    """One frame of the flight, with what filters other than ours are handed ready-made."""

    pose: CameraPose
    mask: NDArray[np.uint8]
    centre_px: FloatArray
    sight: Sight
    near: Near


class Contender(Protocol):
    """A filter that flies the scene; only `step` is timed."""

    def begin(self, seen: Seen) -> None:
        """Take the first frame."""
        ...

    def step(self, seen: Seen) -> None:
        """Predict, weigh, resample."""
        ...


def frames(number: int | None = None) -> Iterator[Seen]:
    """The flight's first `number` frames (all 101 if not given), each made when it is asked for."""
    scene = paper_scene()
    for stamp_s in scene.flight.stamps_s[:number]:
        yield _seen(scene.flight.pose_at(float(stamp_s)))


def fly(
    contenders: Mapping[str, Contender], number: int | None, on_step: Callable[[Seen], None] = lambda seen: None
) -> dict[str, list[float]]:
    """Seconds of each contender's steps; all take each frame in turn. `on_step` comes after each, untimed."""
    times_s: dict[str, list[float]] = {name: [] for name in contenders}
    for index, seen in enumerate(frames(number)):
        for name, contender in contenders.items():
            if index == 0:
                contender.begin(seen)
            else:
                times_s[name].append(timed_s(partial(contender.step, seen)))
        if index:
            on_step(seen)
    return times_s


def _seen(pose: CameraPose) -> Seen:
    mask: NDArray[np.uint8] = np.zeros((PAPER_CAMERA.height, PAPER_CAMERA.width), dtype=np.uint8)
    paper_scene().target.draw(mask, PAPER_CAMERA, pose)
    detection = detections_from_mask(mask, PAPER_CAMERA)[0]
    config = LocalizerConfig()
    range_m = float(np.linalg.norm(PAPER_TARGET_ENU_M - pose.position_enu_m))
    ray = ray_of(PAPER_CAMERA, pose, detection, "centre")  # of a cube, as the truth is
    sight = sight_of(ray, config.pose_errors, config.pixel_sigma_px, range_m, None)
    return Seen(pose, mask, detection.centre_px, sight, _near(mask))


def _near(mask: NDArray[np.uint8]) -> Near:
    left, top, width, height = cv2.boundingRect(mask)
    crop = np.pad(mask[top : top + height, left : left + width], _PAD_PX)
    distances = cv2.distanceTransform(np.where(crop > 0, 0, 255).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_5)
    return Near(np.square(distances.astype(np.float64)), left - _PAD_PX, top - _PAD_PX)
