"""A reported heading that jumps: targets stay where they are once the localizer is told of it, and not before."""

import numpy as np
import pytest

from distloc.filter.settings import LocalizerConfig
from distloc.geometry.camera import Camera
from distloc.geometry.rotations import R_cam_from_enu, matrix_from_euler, matrix_from_rotation_vector
from distloc.localizer import Localizer
from distloc.types import CameraPose, Detection, FloatArray, TargetEstimate, TargetState

CAMERA = Camera(640, 360, 450.0, 450.0, 319.5, 179.5)
TARGET_ENU_M = np.array([900.0, 300.0, 100.0])
JUMP_RAD = np.radians(12.0)  # clockwise from above
STILL = np.eye(3)
# what is reported is turned: R_enu_from_cam' = turn @ R_enu_from_cam, and up is the third axis
TURNED = matrix_from_rotation_vector(np.array([0.0, 0.0, -JUMP_RAD]))


def seen(localizer: Localizer, start: int, steps: int, turn: FloatArray) -> list[TargetEstimate]:
    """Fly north, looking east; the last step's estimates."""
    estimates: list[TargetEstimate] = []
    for number in range(start, start + steps):
        position_enu_m = np.array([0.0, 12.0 * number, 100.0])
        R_cam = R_cam_from_enu(matrix_from_euler(np.pi / 2, 0.0, 0.0), np.eye(3))
        pixels, _ = CAMERA.project((R_cam @ (TARGET_ENU_M - position_enu_m))[:, None])
        pose = CameraPose(0.5 * number, position_enu_m, R_cam @ turn.T)
        estimates = localizer.step_detections(pose, [Detection.from_point(*pixels[:, 0], 2.0)])
    return estimates


@pytest.mark.parametrize("is_told", [True, False])
def test_a_target_stays_only_if_the_jump_is_told(is_told: bool) -> None:
    localizer = Localizer(CAMERA, LocalizerConfig(n_particles=10_000), rng=np.random.default_rng(0))
    (before,) = seen(localizer, 0, 30, STILL)
    assert before.state is TargetState.CONFIRMED
    if is_told:
        localizer.heading_jumped(JUMP_RAD)
    after = seen(localizer, 30, 15, TURNED)
    stays = [one.id for one in after] == [before.id]
    assert stays is is_told
    if is_told:
        assert after[0].state is TargetState.CONFIRMED
        assert float(np.linalg.norm((after[0].position_enu_m - TARGET_ENU_M)[:2])) < after[0].ellipse95.semi_major_m
