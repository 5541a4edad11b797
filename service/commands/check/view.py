"""What the doctor makes of the camera's numbers alone: its view, its mount, its lateness, the grade of the poses."""

from service.commands.check.finding import Finding, ok, warn
from service.config.camera_section import field_of_view_deg
from service.config.doubts import survey_without_calibration
from service.config.sections import Config

_LEVEL_DEG = 10.0  # a mount that looks further up than this sees sky
_SHORTEST_MS, _LONGEST_MS = 5.0, 2000.0  # exposure and transfer alone take longer than the first


def check_view(config: Config) -> list[Finding]:
    """What can be said without a frame."""
    camera, mount, source = config.camera.camera(), config.camera.mount, config.camera.source
    across_deg, down_deg = field_of_view_deg(camera)
    said = f"{across_deg:.0f} x {down_deg:.0f} degrees, {camera.width} x {camera.height} pixels"
    findings = [ok("view", said + (" by camera.hfov_deg" if config.camera.hfov_deg is not None else ""))]
    if mount.pitch_deg > _LEVEL_DEG and not mount.gimbal:
        said = f"camera.mount.pitch_deg is {mount.pitch_deg:g}: the camera looks up, into the sky"
        findings.append(warn("mount", said, "negative pitch looks down"))
    if source.is_live and source.times == "arrival" and not _SHORTEST_MS <= source.latency_ms <= _LONGEST_MS:
        said = (
            f"camera.source.latency_ms is {source.latency_ms:g}: a {source.kind} camera's frames come later than that"
        )
        if source.latency_ms > _LONGEST_MS:
            said = f"camera.source.latency_ms is {source.latency_ms:g}: over two seconds, in which the craft moves on"
        mend = "measure it: film a clock, or distloc calibrate --time-offset; USB has 30 to 100, a stream 100 to 1000"
        findings.append(warn("latency", said, mend))
    if said := survey_without_calibration(config):
        mend = "run distloc calibrate and paste its lines, or take grade = 'consumer'"
        findings.append(warn("pose_errors", said, mend))
    return findings
