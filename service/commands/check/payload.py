"""What the doctor says of the gimbal and of the camera's zoom, as the autopilot's link tells of them."""

from service.autopilot.autopilot import Autopilot
from service.commands.check.finding import Finding, fail, ok, warn
from service.common.degraded import Degraded

_GIMBAL_MESSAGES = ("GIMBAL_DEVICE_ATTITUDE_STATUS", "MOUNT_ORIENTATION", "MOUNT_STATUS")
GIMBAL_MEND = "let it send GIMBAL_DEVICE_ATTITUDE_STATUS at 10 Hz, in the frame that its flags say"


def payload_findings(autopilot: Autopilot, now_ns: int) -> list[Finding]:
    """Of the gimbal, where the config or the link has one, and of the zoom, where it is not the calibration's."""
    zoom = [fail("zoom", autopilot.zoom.fault, Degraded.ZOOM.mend)] if autopilot.zoom.fault else []
    return [*_gimbal(autopilot, now_ns), *zoom]


def _gimbal(autopilot: Autopilot, now_ns: int) -> list[Finding]:
    gimbal = autopilot.camera.gimbal
    if gimbal is None:
        heard = [kind for kind in _GIMBAL_MESSAGES if autopilot.messages[kind]]
        if not heard:
            return []
        said = f"{heard[0]} is heard, but camera.mount.gimbal is false"
        return [warn("gimbal", said, "if the camera is on that gimbal, set camera.mount.gimbal = true")]
    if gimbal.heard.is_ambiguous:
        mend = f"set camera.mount.gimbal_device to the camera's: {' or '.join(map(str, gimbal.heard.ids))}"
        return [fail("gimbal", gimbal.fault(now_ns), mend)]
    if fault := gimbal.fault(now_ns):
        return [fail("gimbal", fault, GIMBAL_MEND)]
    if gimbal.heard.followed is None:
        return [warn("gimbal", "none is heard yet", "listen longer: --seconds")]
    return [ok("gimbal", gimbal.described())]
