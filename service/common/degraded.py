"""What may not work as it should: each name with its meaning and its mend, in one place.

The status and the STATUSTEXT say the names, the log and the doctor the meanings and mends; docs/faults.md has the same
table, which a test holds against this one.
"""

from distloc.backports import StrEnum


class Degraded(StrEnum):
    """A name in `degraded`; `meaning` is what it says, `mend` what to do about it."""

    meaning: str
    mend: str

    LINK = (
        "link",
        "no heartbeat of the autopilot for 3 s, or of another system than the one that was followed",
        "check cable, baud rate and mavlink.target_system",
    )
    CLOCK = ("clock", "no TIMESYNC reply for 30 s: times are worse", "let the link pass TIMESYNC both ways")
    EKF = (
        "ekf",
        "the autopilot says that its estimate is poor",
        "wait until the autopilot's EKF is ready; see its pre-arm messages",
    )
    FIX = (
        "fix",
        "no frame was used for 3 s: the autopilot gives no position that is valid",
        "wait for a GPS fix under open sky",
    )
    POSE = (
        "pose",
        "no frame was used for 3 s: no attitude and position of its time came",
        "let the autopilot send ATTITUDE and GLOBAL_POSITION_INT (SRn_EXTRA1, SRn_POSITION); check "
        "camera.source.latency_ms",
    )
    TURNING = (
        "turning",
        "no frame was used for 3 s: the craft turns by over 15 degrees a second",
        "fly straighter, or mount the camera on a gimbal",
    )
    RATES = (
        "rates",
        "attitude or position come much less often than asked for: another client asked for less, or the link is full",
        "stop that client's stream requests (they are asked for again every 5 s), raise the link's baud rate, "
        "or ask for less: mavlink.attitude_hz, position_hz",
    )
    POSITION = ("position", "the position jumped by over 10 m within a step though nobody flagged it", "check GPS")
    HEADING = (
        "heading",
        "the heading jumped by over 5 degrees and the gyroscopes did not turn",
        "check compass",
    )
    COMPASS = (
        "compass",
        "the scenery in the picture shows that the heading has been off by over 10 degrees for 10 s",
        "calibrate the compass, check the camera's mount and camera.mount.yaw_deg",
    )
    GIMBAL = (
        "gimbal",
        "where the gimbal points is not known: silent or under 2 Hz for 2 s, several are heard, or its yaw contradicts "
        "its flags",
        "let it send GIMBAL_DEVICE_ATTITUDE_STATUS at 10 Hz and name it in camera.mount.gimbal_device; "
        "distloc check says what is wrong",
    )
    ZOOM = (
        "zoom",
        "the camera says another field of view or zoom level than it was calibrated at",
        "zoom back, calibrate for this zoom, or name the camera in camera.device",
    )
    CAMERA = (
        "camera",
        "no usable frame for 3 s",
        "check cable, stream and resolution; it is tried again every 5 s at the latest",
    )
    CAMERA_BLIND = (
        "camera_blind",
        "frames without a picture for over a second: black, white or grey all over",
        "uncover and clean the lens, check the exposure",
    )
    CAMERA_FROZEN = ("camera_frozen", "the same picture for over a second", "restart the camera")
    SEGMENTER = (
        "segmenter",
        "no mask for 3 s though frames were given: it fails, floods, or is this slow",
        "check the model, and whether the computer is too hot",
    )
    RECORDER = ("recorder", "nothing is written", "free, mount or replace the disk; it is tried again every 5 s")
    TAK = (
        "tak",
        "a TAK server or group of tak.urls cannot be reached, or takes nothing",
        "check network, address and certificates; the status says why under counters.tak",
    )
    ZENOH = (
        "zenoh",
        "none of the zenoh.connect endpoints is connected, or there is no session",
        "check network and router",
    )

    def __new__(cls, name: str, meaning: str, mend: str) -> "Degraded":
        """A string that carries the other two."""
        member = str.__new__(cls, name)
        member._value_, member.meaning, member.mend = name, meaning, mend
        return member
