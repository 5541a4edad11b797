"""What a config says of the poses' errors, and where that is hardly true. Free of I/O."""

import math
from dataclasses import replace

from distloc.types import PoseErrors
from service.config.sections import Config

_HAND_SET_DEG = 0.5  # a calibration's angles have hundredths: whole and half degrees were set by eye
_HAND_SET_SIGMA_DEG = 1.0  # of each angle of a mount or lens that nobody calibrated


def told_errors(config: Config) -> PoseErrors:
    """The sizes of a camera's pose errors: the autopilot's and, where grade "survey" leaves it out, the mount's.

    A grade's slow errors of a consumer's craft are larger than any mount's and hold them, and so do sizes of one's own.
    """
    section, errors = config.pose_errors, config.pose_errors.pose_errors()
    mount_rad = math.radians(_mount_sigma_deg(config))
    heading_rad = 0.0 if section.heading_bias_deg else mount_rad
    tilt_rad = 0.0 if section.tilt_bias_deg else mount_rad
    return replace(
        errors,
        heading_bias_rad=math.hypot(errors.heading_bias_rad, heading_rad),
        tilt_bias_rad=math.hypot(errors.tilt_bias_rad, tilt_rad),
    )


def survey_without_calibration(config: Config) -> str:
    """The line that says that grade "survey" claims more than this mount can have; empty: it does not."""
    errors, mount = config.pose_errors, config.camera.mount
    is_told = mount.sigma_deg is not None or (errors.heading_bias_deg and errors.tilt_bias_deg)
    if is_told or not _mount_sigma_deg(config):
        return ""
    said = 'pose_errors.grade is "survey", which takes heading and tilt as right to tenths of a degree'
    mend = f"{_HAND_SET_SIGMA_DEG:g} degree is added until `distloc calibrate` gives camera.mount.sigma_deg"
    if _is_guessed_lens(config):
        return f"{said}, but camera.fx, fy, cx, cy are of no calibration: {mend}"
    angles = f"{mount.yaw_deg:g}, {mount.pitch_deg:g}, {mount.roll_deg:g}"
    return f"{said}, but the angles of camera.mount ({angles}) are of no calibration: {mend}"


def _mount_sigma_deg(config: Config) -> float:
    """Of the mount's angles, beyond what the grade's sizes hold."""
    mount = config.camera.mount
    if config.pose_errors.grade != "survey":
        return 0.0
    if mount.sigma_deg is not None:
        return mount.sigma_deg
    is_hand_set = all(angle % _HAND_SET_DEG == 0.0 for angle in (mount.yaw_deg, mount.pitch_deg, mount.roll_deg))
    return _HAND_SET_SIGMA_DEG if is_hand_set or _is_guessed_lens(config) else 0.0


def _is_guessed_lens(config: Config) -> bool:
    return config.camera.hfov_deg is not None or config.camera.fx is None
