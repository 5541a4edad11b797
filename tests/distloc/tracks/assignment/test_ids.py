"""Fires that stand closer in the picture than the compass is sure keep their ids."""

from dataclasses import replace

import numpy as np
import pytest

from distloc.geometry.rotations import matrix_from_rotation_vector
from distloc.localizer import Localizer, LocalizerConfig
from distloc.simulation.targets import Box
from distloc.types import CameraPose, FloatArray, TargetEstimate
from tests.support.cube_samples import CAMERA, CUBE_ENU_M, empty_mask, pose_at

CONFIG = LocalizerConfig(n_particles=4000, bias_time_constant_s=60.0, aim="centre")
STEADY = 25
FIRES = [
    Box(CUBE_ENU_M + np.array([east_m, 0.0, 0.0]), (20.0, 20.0, 60.0)) for east_m in (-90.0, -50.0, 0.0, 35.0, 95.0)
]


def reported(pose: CameraPose, right_rad: float) -> CameraPose:
    """The same camera, said to look to the right of where it looks."""
    R_enu_from_cam = matrix_from_rotation_vector(np.array([0.0, 0.0, -right_rad])) @ pose.R_cam_from_enu.T
    return replace(pose, R_cam_from_enu=np.ascontiguousarray(R_enu_from_cam.T))


def flown(headings_rad: FloatArray) -> list[list[TargetEstimate]]:
    """With a compass that is off by so much in each step."""
    located, flight = Localizer(CAMERA, CONFIG, rng=np.random.default_rng(0)), []
    for k, heading_rad in enumerate(headings_rad):
        mask, pose = empty_mask(), pose_at(10.0 * k)
        for fire in FIRES:
            fire.draw(mask, CAMERA, pose)
        flight.append(located.step(reported(pose, heading_rad), mask))
    return flight


@pytest.mark.parametrize("seed", range(4))
def test_a_compass_that_jumps_by_half_their_distance_exchanges_none(seed: int) -> None:
    jumps_rad = np.random.default_rng(seed).normal(0.0, 0.006, 60)
    jumps_rad[:STEADY] = 0.0  # until they are believed
    flight = flown(np.cumsum(jumps_rad))
    first, last = (sorted(step, key=lambda one: float(one.position_enu_m[0])) for step in (flight[STEADY], flight[-1]))
    known = {one.id for one in first}
    assert len(known) == len(FIRES)
    assert [one.id for one in last if one.id in known] == [one.id for one in first]
    assert len({one.id for step in flight for one in step}) <= len(FIRES) + 1
