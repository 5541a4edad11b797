"""The frame with what was seen drawn into it."""

import dataclasses

import numpy as np
import pytest

from distloc.geometry.camera import Camera
from distloc.geometry.rotations import matrix_from_rotation_vector
from distloc.types import CameraPose
from service.common.messages import Frame
from service.localise.stage import Localised
from service.publish.overlay import annotated
from tests.support.wire_samples import located, vehicle

CAMERA = Camera(960, 540, 800.0, 800.0, 479.5, 269.5)


def test_the_cross_is_where_the_corrected_attitude_puts_the_target() -> None:
    """The compass reads 3 degrees too much: as it says, a target ahead would be left of the middle."""
    true = vehicle().pose
    turn = matrix_from_rotation_vector(np.radians([0.0, 0.0, 3.0]))
    reported = CameraPose(true.stamp_s, true.position_enu_m, true.R_cam_from_enu @ turn)
    image = np.zeros((540, 960, 3), np.uint8)
    localised = Localised(Frame(0, "", image), reported, None, (located().estimate,), best_pose=true)
    for one, expected_px in ((localised, 479.5), (dataclasses.replace(localised, best_pose=None), 479.5 - 41.9)):
        picture = annotated(one, CAMERA)
        assert picture is not None
        red = (picture[:, :, 2] > 200) & (picture[:, :, 1] < 120)
        assert np.nonzero(red)[1].mean() == pytest.approx(expected_px, abs=2.0)
