"""A drawn flight before it is flown: terrain, fire, path, the camera's frames and the reported poses, by a seed."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from distloc.geometry.rotations import matrix_from_rotation_vector
from distloc.simulation.flights import flight_past
from distloc.simulation.landscape.renderer import LandscapeRenderer
from distloc.simulation.landscape.scenes import SCENES
from distloc.simulation.landscape.sensor import compressed
from distloc.simulation.plume import Plume
from distloc.simulation.pose_noise import CorrelatedPoseErrors, PoseAt, PoseNoise
from distloc.study.coverage.cases import ERROR_CLASSES
from distloc.study.drawn.cases import CAMERA, DrawnCase, PoseStep
from distloc.types import CameraPose, FloatArray

FPS = 2.0
_RANGES_M = (1000.0, 2000.0)
_HEIGHT_M = 120.0
_WOBBLE_RAD = 0.02


@dataclass(frozen=True, slots=True)
class DrawnRun:
    """One flight of a case, seeded by `seed` alone: cases of one seed share terrain, fire and errors."""

    case: DrawnCase
    seed: int
    n_particles: int
    length_share: float = 1.0  # of the case's flight


@dataclass(frozen=True, slots=True)
class DrawnFrame:
    """The camera's picture (H, W, 3), the smoke's true mask (H, W), the reported pose and the true one."""

    image: NDArray[np.uint8]
    mask: NDArray[np.uint8]
    pose: CameraPose
    true_pose: CameraPose


@dataclass(frozen=True, slots=True)
class DrawnStage:
    """The frames in the order of time, the fire's place (3,) as the localizer aims at it, the filters' generators."""

    frames: Iterator[DrawnFrame]
    truth_enu_m: FloatArray
    range_m: float
    filter_rngs: tuple[np.random.Generator, np.random.Generator]


class SteppingPoses:
    """Poses as another noise reports them, with a step in them."""

    def __init__(self, noise: PoseNoise, step: PoseStep, at_s: float, rng: np.random.Generator) -> None:
        azimuth_rad, side = rng.uniform(0.0, 2.0 * np.pi), rng.choice([-1.0, 1.0])
        self._noise, self._from_s, self._to_s = noise, at_s, at_s + step.for_s
        self._offset_m = step.position_m * np.array([np.sin(azimuth_rad), np.cos(azimuth_rad), 0.0])
        self._turn_rad = float(side * step.heading_rad)

    def reported(self, pose_at: PoseAt, stamp_s: float) -> CameraPose:
        """The other's report, off by the step while it lasts."""
        pose = self._noise.reported(pose_at, stamp_s)
        if not self._from_s <= stamp_s < self._to_s:
            return pose
        turn = matrix_from_rotation_vector(np.array([0.0, 0.0, self._turn_rad]))
        return replace(
            pose,
            position_enu_m=pose.position_enu_m + self._offset_m,
            R_cam_from_enu=np.ascontiguousarray(pose.R_cam_from_enu @ turn.T),
            heading_rad=None if pose.heading_rad is None else pose.heading_rad - self._turn_rad,
        )


def staged(run: DrawnRun) -> DrawnStage:
    """A flight; nothing is drawn before its frames are asked for."""
    case = run.case
    scene_rng, fire_rng, pose_rng, *filter_rngs = (
        np.random.Generator(np.random.SFC64(one)) for one in np.random.SeedSequence([78, run.seed]).spawn(5)
    )
    plume, range_m = _fire(fire_rng)
    length_m = run.length_share * case.length_share * range_m
    step_m = case.speed_mps / FPS
    flight = flight_past(
        case.geometry, plume.base_enu_m, range_m, length_m, step_m, _HEIGHT_M, _WOBBLE_RAD, run.seed, case.speed_mps
    )
    focal = float(1.0 + case.focal_wrong * fire_rng.choice([-1.0, 1.0]))
    lens = replace(CAMERA, fx=CAMERA.fx * focal, fy=CAMERA.fy * focal, distortion=case.distortion)
    errors = CorrelatedPoseErrors(ERROR_CLASSES["scenery"], pose_rng)
    poses = SteppingPoses(errors, case.step, case.step.at_share * float(flight.stamps_s[-1]), fire_rng)

    def frames() -> Iterator[DrawnFrame]:
        renderer = LandscapeRenderer(lens, [plume], scene_rng, SCENES[case.landscape], case.faults)
        for stamp_s in map(float, flight.stamps_s):
            true_pose = flight.pose_at(stamp_s)
            image, mask = renderer.render(true_pose, flight.pose_at)
            image = compressed(image, case.faults.jpeg_quality)
            yield DrawnFrame(image, mask, poses.reported(flight.pose_at, stamp_s), true_pose)

    return DrawnStage(frames(), plume.base_enu_m, range_m, (filter_rngs[0], filter_rngs[1]))


def _fire(rng: np.random.Generator) -> tuple[Plume, float]:
    """A grown plume north of the origin, and how far from there."""
    range_m = float(np.exp(rng.uniform(*np.log(_RANGES_M))))
    wind_rad = rng.uniform(0.0, 2.0 * np.pi)
    wind_enu_mps = rng.uniform(0.0, 1.5) * np.array([np.sin(wind_rad), np.cos(wind_rad), 0.0])
    height_m, width_m = rng.uniform(180.0, 300.0), rng.uniform(70.0, 130.0)
    return Plume(np.array([0.0, range_m, 0.0]), height_m, width_m, wind_enu_mps, start_share=1.0), range_m
