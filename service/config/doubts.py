"""What a config that is allowed says and is hardly true; the doctor and the service's log tell it. Free of I/O."""

from service.config.sections import Config

_HAND_SET_DEG = 0.5  # a calibration's angles have hundredths: whole and half degrees were set by eye


def survey_without_calibration(config: Config) -> str:
    """The line that says that grade "survey" claims more than this mount can have; empty: it does not."""
    errors, mount, camera = config.pose_errors, config.camera.mount, config.camera
    if errors.grade != "survey" or (errors.heading_bias_deg and errors.tilt_bias_deg):
        return ""
    said = 'pose_errors.grade is "survey", which takes heading and tilt as right to tenths of a degree'
    if camera.hfov_deg is not None or camera.fx is None:
        return f"{said}, but camera.fx, fy, cx, cy are of no calibration"
    if all(angle % _HAND_SET_DEG == 0.0 for angle in (mount.yaw_deg, mount.pitch_deg, mount.roll_deg)):
        angles = f"{mount.yaw_deg:g}, {mount.pitch_deg:g}, {mount.roll_deg:g}"
        return f"{said}, but the angles of camera.mount ({angles}) are of no calibration"
    return ""
