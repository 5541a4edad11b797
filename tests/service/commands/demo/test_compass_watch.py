"""What the demo says of the compass beside the truth."""

import math
from dataclasses import replace

import numpy as np
import pytest

from distloc.geometry.rotations import matrix_from_rotation_vector
from distloc.types import CameraPose
from service.commands.demo.compass_watch import CompassWatch
from service.common.messages import Frame
from service.localise.scenery import SceneryState
from service.localise.stage import Localised
from service.simulator.scenario import camera_pose, load_scenario, pose_from_truth

START_NS, S = 5_000_000_000, 1_000_000_000


@pytest.mark.parametrize("error_deg", [3.0, -7.0])
def test_the_truth_has_the_sign_of_a_compass_that_reads_too_much(error_deg: float) -> None:
    scenario = load_scenario("demo")
    watch = CompassWatch(scenario, START_NS)
    truth = scenario.flight.state(12.0)
    reported_yaw_rad = truth.yaw_rad + math.radians(error_deg)
    pose = pose_from_truth(scenario, replace(truth, yaw_rad=reported_yaw_rad), 17.0)
    localised = Localised(Frame(START_NS + 12 * S, "", None), pose, None, ())
    error_rad, sigma_rad = np.radians([0.0, 0.0, -error_deg]), np.radians([0.1, 0.1, 0.2])
    watch.see(localised, SceneryState("scenery", 17.0, error_rad, sigma_rad))
    assert watch.truth_deg == pytest.approx(error_deg, abs=1e-6)
    assert watch.line() == (f"compass off by {error_deg:+.2f} +- 0.20 deg by the scenery, in truth by {error_deg:+.2f}")


def test_what_is_of_another_frame_is_not_compared_and_nothing_measured_says_why() -> None:
    scenario = load_scenario("demo")
    watch = CompassWatch(scenario, START_NS)
    assert watch.line() == "the scenery did not measure the compass: no step of the filter"
    pose = camera_pose(scenario, 12.0, 17.0)
    localised = Localised(Frame(START_NS + 12 * S, "", None), pose, None, ())
    watch.see(localised, SceneryState("autopilot", 16.0, np.zeros(3), np.ones(3), 0, {"few_corners": 3, "gap": 1}))
    assert watch.truth_deg is None
    assert watch.line() == "the scenery did not measure the compass: few_corners 3, gap 1"


def test_a_turn_of_the_truth_alone_is_found() -> None:
    pose = camera_pose(load_scenario("demo"), 0.0, 0.0)
    turned = CameraPose(
        0.0, pose.position_enu_m, pose.R_cam_from_enu @ matrix_from_rotation_vector(np.array([0, 0, 0.1]))
    )
    watch = CompassWatch(load_scenario("demo"), 0)
    watch.see(Localised(Frame(0, "", None), turned, None, ()), SceneryState("scenery", 0.0, np.zeros(3), np.ones(3)))
    assert watch.truth_deg == pytest.approx(math.degrees(0.1), abs=1e-6)
