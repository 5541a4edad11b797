"""What the mount adds to the sizes of the poses' errors."""

import math
from typing import Any

import pytest

from service.config.camera_section import CameraConfig, MountConfig
from service.config.doubts import survey_without_calibration, told_errors
from service.config.sections import Config, PoseErrorsConfig

LENS: dict[str, Any] = {"width": 640, "height": 480, "fx": 500.0, "fy": 500.0, "cx": 320.0, "cy": 240.0}
BY_HAND = MountConfig(yaw_deg=-75.0, pitch_deg=-5.5)
CALIBRATED = MountConfig(yaw_deg=-74.21, pitch_deg=-5.5)


def slow_deg(errors: PoseErrorsConfig, mount: MountConfig, **lens: Any) -> tuple[float, float]:
    """Heading's and tilt's."""
    told = told_errors(Config(camera=CameraConfig(mount=mount, **(lens or LENS)), pose_errors=errors))
    return math.degrees(told.heading_bias_rad), math.degrees(told.tilt_bias_rad)


@pytest.mark.parametrize(
    ("mount", "lens", "mount_deg"),
    [
        (BY_HAND, LENS, 1.0),
        (CALIBRATED, LENS, 0.0),
        (CALIBRATED, {"width": 640, "height": 480, "hfov_deg": 70.0}, 1.0),
        (MountConfig(yaw_deg=-75.0, sigma_deg=0.2), LENS, 0.2),
        (MountConfig(yaw_deg=-74.21, sigma_deg=0.6), LENS, 0.6),
    ],
)
def test_a_survey_grade_leaves_out_the_mount(mount: MountConfig, lens: dict[str, Any], mount_deg: float) -> None:
    heading_deg, tilt_deg = slow_deg(PoseErrorsConfig(grade="survey"), mount, **lens)
    assert heading_deg == pytest.approx(math.hypot(0.3, mount_deg))
    assert tilt_deg == pytest.approx(math.hypot(0.1, mount_deg))


def test_sizes_that_hold_the_mount_stay() -> None:
    assert slow_deg(PoseErrorsConfig(), BY_HAND) == pytest.approx((2.0, 0.5))
    own = PoseErrorsConfig(grade="survey", heading_bias_deg=0.4)
    assert slow_deg(own, BY_HAND) == pytest.approx((0.4, math.hypot(0.1, 1.0)))


def test_who_says_the_mounts_sigma_is_not_warned() -> None:
    survey = PoseErrorsConfig(grade="survey")
    for mount, is_warned in ((BY_HAND, True), (MountConfig(yaw_deg=-75.0, sigma_deg=0.2), False)):
        config = Config(camera=CameraConfig(mount=mount, **LENS), pose_errors=survey)
        assert ("distloc calibrate" in survey_without_calibration(config)) == is_warned
