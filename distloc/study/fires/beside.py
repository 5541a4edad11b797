"""What stays beside the drone or on its lens while a fire goes by: birds that fly along, and dirt."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from distloc.geometry.camera import Camera
from distloc.simulation.flights import Flight
from distloc.study.fires.smoke import Puffs, draw_balls
from distloc.types import CameraPose, FloatArray

_FLOCKS_A_S = 1.0 / 40.0
_STAY_S, _MOST_BIRDS = (10.0, 60.0), 6
_AHEAD_M, _SWAY_M, _SWAY_S = (12.0, 60.0), (0.5, 3.0), (3.0, 9.0)
_WING_M = (0.15, 0.45)  # folded, and spread
_APART_M, _DRIFT_MPS = 3.0, 0.3
_SPOTS, _SPOT_PX, _SPOT_SHOWN = 4, (3.0, 14.0), (0.6, 0.95)  # how many; their radius; of the frames


@dataclass(frozen=True, slots=True)
class Bird:
    """It keeps a place (3,) right, ahead of and above the craft, drifts (3,) from it, sways, and flaps its wings.

    The sway is so large (3,), with periods (3,) and phases (3,); the flaps are drawn by `seed`.
    """

    beside_m: FloatArray
    drift_mps: FloatArray
    sway_m: FloatArray
    sway_s: FloatArray
    phase: FloatArray
    shown_s: tuple[float, float]
    seed: int

    def draw(self, mask: NDArray[np.uint8], camera: Camera, pose: CameraPose) -> None:
        """Set the pixels of `mask` (H, W) that it covers to 255 while it is there."""
        since_s = pose.stamp_s - self.shown_s[0]
        if since_s < 0.0 or pose.stamp_s >= self.shown_s[1]:
            return
        off_m = self.beside_m + since_s * self.drift_mps
        off_m = off_m + self.sway_m * np.sin(2.0 * np.pi * (pose.stamp_s / self.sway_s + self.phase))
        sine, cosine = np.sin(pose.heading_rad or 0.0), np.cos(pose.heading_rad or 0.0)
        east_north = np.array([[cosine, sine], [-sine, cosine]]) @ off_m[:2]
        centre = pose.position_enu_m + np.array([*east_north, off_m[2]])
        wing_m = np.random.default_rng([self.seed, round(1e3 * pose.stamp_s)]).uniform(*_WING_M)
        draw_balls(mask, camera, pose, Puffs(centre[:, None], np.array([wing_m])))


@dataclass(frozen=True, slots=True)
class Spot:
    """Dirt on the lens: an ellipse at a pixel (2,), so large (2,), found in that share of the frames, by `seed`."""

    centre_px: FloatArray
    axes_px: FloatArray
    shown: float
    seed: int

    def draw(self, mask: NDArray[np.uint8], camera: Camera, pose: CameraPose) -> None:
        """Set the pixels of `mask` (H, W) that it covers to 255."""
        del camera
        if np.random.default_rng([self.seed, round(1e3 * pose.stamp_s)]).random() < self.shown:
            centre, axes = self.centre_px.round().astype(int).tolist(), self.axes_px.round().astype(int).tolist()
            cv2.ellipse(mask, centre, axes, 0, 0, 360, 255, -1)


def flocks(flight: Flight, rng: np.random.Generator) -> list[Bird]:
    """Now and then one to six birds that fly along before the camera."""
    end_s = float(flight.stamps_s[-1])
    found = []
    for start_s in np.sort(rng.uniform(0.0, end_s, max(2, int(rng.poisson(_FLOCKS_A_S * end_s))))).tolist():
        ahead_m = rng.uniform(*_AHEAD_M)
        middle_m = ahead_m * np.array([rng.uniform(-0.5, 0.5), 1.0, rng.uniform(-0.2, 0.25)])
        drift_mps = rng.normal(0.0, _DRIFT_MPS, 3)
        shown_s = (start_s, start_s + float(rng.uniform(*_STAY_S)))
        for _ in range(int(rng.integers(1, _MOST_BIRDS + 1))):
            found.append(
                Bird(
                    beside_m=middle_m + rng.normal(0.0, _APART_M, 3) * [1.0, 1.0, 0.4],
                    drift_mps=drift_mps + rng.normal(0.0, 0.1 * _DRIFT_MPS, 3),
                    sway_m=rng.uniform(*_SWAY_M) * np.array([1.0, 0.5, 0.4]),
                    sway_s=rng.uniform(*_SWAY_S, 3),
                    phase=rng.random(3),
                    shown_s=shown_s,
                    seed=int(rng.integers(1 << 31)),
                )
            )
    return found


def dirt(camera: Camera, pose: CameraPose, place_enu_m: FloatArray, rng: np.random.Generator) -> list[Spot]:
    """Spots all over the picture, the first where a place (3,) is seen from a pose: it hides the fire as that goes by.

    They are in the picture's middle half upright, where ground and smoke are.
    """
    pixel, _ = camera.project((pose.R_cam_from_enu @ (place_enu_m - pose.position_enu_m))[:, None])
    centres = rng.uniform([0.1, 0.3], [0.9, 0.7], (_SPOTS, 2)) * [camera.width, camera.height]
    centres[0] = pixel[:, 0] + rng.normal(0.0, 4.0, 2)
    return [
        Spot(
            centre_px=centre,
            axes_px=rng.uniform(*_SPOT_PX) * np.array([1.0, rng.uniform(0.5, 1.0)]),
            shown=float(rng.uniform(*_SPOT_SHOWN)),
            seed=int(rng.integers(1 << 31)),
        )
        for centre in centres
    ]
