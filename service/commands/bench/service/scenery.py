"""What following the scenery costs: corners in drawn frames of 1280 x 720, and the keyframes' solution."""

import time
from collections.abc import Callable

import msgspec
import numpy as np

from distloc.filter.settings import LocalizerConfig
from distloc.geometry.rotations import matrix_from_rotation_vector
from distloc.scenery.compass import Compass
from distloc.scenery.corner_tracker import CornerTracker
from distloc.types import CameraPose
from service.commands.bench.service.pipeline import Latency
from service.simulator.drawn_scene import DrawnScene
from service.simulator.scenario import camera_pose, load_scenario

FRAMES = 150
_OFF_RAD = np.radians([0.3, -0.2, 2.0])  # of the reported attitude
_FILLED = 0.4  # of the frames: then the window is full


class SceneryCost(msgspec.Struct, frozen=True):
    """`track` is of each frame, `keyframe` of those that were solved with a full window, `corners` places in the last.

    `heading_off_deg` is what is left of two degrees at the end.
    """

    track: Latency
    keyframe: Latency
    corners: int
    heading_off_deg: float


def measure_scenery(number: int = FRAMES, on_step: Callable[[], None] = lambda: None) -> SceneryCost:
    """Follow the demo's flight in frames drawn beforehand, one after the other."""
    scenario = load_scenario("demo")
    scene, camera = DrawnScene(scenario, np.random.default_rng(7)), scenario.camera.camera()
    tracker, told = CornerTracker(camera), LocalizerConfig().pose_errors
    compass = Compass(camera)
    turned = matrix_from_rotation_vector(-_OFF_RAD)
    track_s, keyframe_s = [], []
    corners, off_deg = 0, float("nan")
    for frame in range(number):
        stamp_s = frame / scenario.fps
        image, mask = scene.at(stamp_s)
        true = camera_pose(scenario, stamp_s, stamp_s)
        pose = CameraPose(stamp_s, true.position_enu_m, true.R_cam_from_enu @ turned, heading_rad=true.heading_rad)
        began_s = time.perf_counter()
        found = tracker.track(image, pose, mask)
        tracked_s = time.perf_counter()
        compass.step(pose, told, found)
        solved_s = time.perf_counter()
        track_s.append(tracked_s - began_s)
        state = compass.state
        if state is not None and state.stamp_s == stamp_s:
            corners, off_deg = state.corners, float(np.degrees(state.error_rad[2] - _OFF_RAD[2]))
            if frame >= _FILLED * number:
                keyframe_s.append(solved_s - tracked_s)
        on_step()
    return SceneryCost(_latency(track_s), _latency(keyframe_s), corners, round(off_deg, 3))


def _latency(times_s: list[float]) -> Latency:
    p50, p95 = np.percentile(times_s, [50, 95]) * 1e3 if times_s else (float("nan"),) * 2
    return Latency(round(float(p50), 3), round(float(p95), 3), len(times_s))
