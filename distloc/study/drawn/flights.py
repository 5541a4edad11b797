"""Flies drawn flights: landscape, camera, corner tracker and localizer as they fly, with and without the scenery.

Both localizers get the same masks and the same reported poses and are told nothing but their defaults. `study drawn`
calls it. What flies was tuned on seeds under 1000; the study's own start at `SEED`.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from distloc.geometry.metrics import nees
from distloc.geometry.rotations import matrix_from_rotation_vector
from distloc.localizer import Localizer, LocalizerConfig
from distloc.scenery.compass import Compass
from distloc.scenery.corner_tracker import CornerTracker
from distloc.study.coverage.staging import travelled_m
from distloc.study.drawn.cases import CAMERA, DrawnCase
from distloc.study.drawn.ledger import FireLedger, FireTrack
from distloc.study.drawn.staging import DrawnRun, staged
from distloc.study.runner import run_all
from distloc.types import BoolArray, CameraPose, FloatArray

SEED = 64_000
PARTICLES = 10_000


@dataclass(frozen=True, slots=True)
class DrawnFlight:
    """One flight (T,): the camera's way, what was reported without and with the scenery, and how true the attitude was.

    `is_used`: the frame's attitude was the scenery's. Where it is and the frame is a keyframe, `heading_error_rad` is
    what is left of the heading's error beside its told sigma, and `attitude_nees` of all three axes against the told
    covariance (3 where that is true); else NaN.
    """

    stamps_s: FloatArray
    travelled_m: FloatArray
    range_m: float
    without: FireTrack
    scenery: FireTrack
    is_used: BoolArray
    heading_error_rad: FloatArray
    heading_sigma_rad: FloatArray
    attitude_nees: FloatArray


def fly_all(
    cases: Sequence[DrawnCase],
    runs: int,
    jobs: int,
    seed: int = SEED,
    on_done: Callable[[int], None] = lambda done: None,
    n_particles: int = PARTICLES,
    length_share: float = 1.0,
) -> list[list[DrawnFlight]]:
    """Each case's runs, seeded `seed`, `seed` + 1 and so on; `on_done` gets how many flights are done."""
    tasks = [DrawnRun(case, seed + number, n_particles, length_share) for case in cases for number in range(runs)]
    results = run_all(fly, tasks, jobs, on_done)
    return [results[index * runs : (index + 1) * runs] for index in range(len(cases))]


def fly(run: DrawnRun) -> DrawnFlight:
    """One flight by both."""
    stage = staged(run)
    config = LocalizerConfig(n_particles=run.n_particles)
    with_scenery, without = (Localizer(CAMERA, config, rng=rng) for rng in stage.filter_rngs)
    tracker = CornerTracker(CAMERA)
    scenery_ledger, without_ledger = (FireLedger(stage.truth_enu_m) for _ in range(2))
    poses: list[CameraPose] = []
    attitudes: list[tuple[float, float, float, float]] = []
    for frame in stage.frames:
        corners = tracker.track(frame.image, frame.pose, frame.mask)
        is_in_view = bool(frame.mask.any())
        scenery_ledger.enter(with_scenery.step(frame.pose, frame.mask, corners), is_in_view)
        without_ledger.enter(without.step(frame.pose, frame.mask), is_in_view)
        poses.append(frame.true_pose)
        attitudes.append(_attitude(frame.pose, frame.true_pose, with_scenery.compass))
    is_used, error_rad, sigma_rad, squared = np.array(attitudes).T
    return DrawnFlight(
        stamps_s=np.array([pose.stamp_s for pose in poses]),
        travelled_m=travelled_m(poses),
        range_m=stage.range_m,
        without=without_ledger.closed(),
        scenery=scenery_ledger.closed(),
        is_used=is_used > 0.0,
        heading_error_rad=error_rad,
        heading_sigma_rad=sigma_rad,
        attitude_nees=squared,
    )


def _attitude(pose: CameraPose, true_pose: CameraPose, compass: Compass) -> tuple[float, float, float, float]:
    """Whether the scenery's is used; what is left of the heading's error, its told sigma, the NEES of all three."""
    state = compass.state
    if not compass.is_used or state is None or state.stamp_s != pose.stamp_s:
        return float(compass.is_used), np.nan, np.nan, np.nan
    corrected = pose.R_cam_from_enu @ matrix_from_rotation_vector(state.error_rad)
    left_rad = np.asarray(cv2.Rodrigues(corrected.T @ true_pose.R_cam_from_enu)[0], dtype=np.float64)[:, 0]
    return 1.0, float(left_rad[2]), float(state.sigma_rad[2]), nees(left_rad, state.covariance_rad2)
