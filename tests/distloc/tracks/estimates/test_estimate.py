"""What is added to a cloud that no particle has, and what is told while the scenery is about to tell."""

from dataclasses import replace

import numpy as np

from distloc.localizer import Localizer, LocalizerConfig
from distloc.simulation.targets import Box
from distloc.tracks.estimates.estimate import beside_m2
from distloc.types import AttitudeError, CameraPose, Extent, PoseErrors, TargetEstimate, TargetState
from tests.support.cube_samples import CAMERA, R_NORTH, empty_mask

ERRORS = PoseErrors(0.01, 0.005, 0.001, 0.5, 120.0, position_bias_m=3.0, focal_sigma=0.01)
BOX = Box(np.array([0.0, 600.0, 20.0]), (40.0, 40.0, 40.0))
STEPS, TOLD = 50, 40


def test_the_place_the_focal_length_and_the_middle_are_beside_the_cloud() -> None:
    beside = beside_m2(ERRORS, Extent(100.0, 1.0, 50.0, 1.0), np.array([300.0, 400.0, -80.0]))
    # 3 m of the place and 6 m of the middle; 1 % of the line
    assert np.allclose(beside, [[45.0 + 9.0, 12.0], [12.0, 45.0 + 16.0]])


def flown(awaited: range) -> list[TargetEstimate]:
    """The only target's estimates on the way past a box, told of or not, by steps in which the scenery is awaited."""
    localizer = Localizer(CAMERA, LocalizerConfig(n_particles=2000, aim="centre"), rng=np.random.default_rng(5))
    kept, told = np.exp(-1.0 / 120.0), ERRORS.bias_variance
    attitude = AttitudeError(told, kept * np.eye(3), (1.0 - kept**2) * told, "autopilot")
    estimates = []
    for step in range(STEPS):
        pose = CameraPose(float(step), np.array([10.0 * step - 5.0 * STEPS, 0.0, 80.0]), R_NORTH, ERRORS)
        mask = empty_mask()
        BOX.draw(mask, CAMERA, pose)
        now = replace(attitude, is_about_to_tell=step in awaited)
        estimates.extend(localizer.step(replace(pose, attitude=now), mask))
    return estimates


def test_nothing_is_confirmed_while_the_scenery_is_about_to_tell() -> None:
    def confirmed_s(awaited: range) -> list[float]:
        return [one.last_seen_s for one in flown(awaited) if one.state is TargetState.CONFIRMED]

    assert min(confirmed_s(range(0))) < TOLD, "it would be confirmed by then"
    assert min(confirmed_s(range(TOLD))) >= TOLD
