"""Whether the camera's lens is as it was calibrated, by what it says of its view and its zoom; for the autopilot.

A focal length of another zoom puts every sight elsewhere, so frames are refused from the first word that differs until
one that agrees. Silence changes nothing: zoom is told where it changes, and a lens that was zoomed stays so.
"""

import math
from dataclasses import dataclass
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from service.config.sections import CameraConfig

AUTOPILOT_COMPONENT, OWN_CAMERA_COMPONENT = 1, 100
FOV_SHARE = 0.04  # by which a maker's figure may differ from a calibration: 1 degree at the border of a view of 60
WHOLE_DEG = 1.0  # VIDEO_STREAM_INFORMATION has whole degrees, rounded or cut
LEVEL_PERCENT = 0.5
ECHO_DEG = 1e-3  # single precision
MOST = 16


@dataclass(frozen=True, slots=True)
class _Word:
    """What a camera last said by one message; `difference` is empty where it agrees with the calibration."""

    camera: int
    is_stream: bool  # of several streams one is ours: it is enough that one agrees
    difference: str


class Zoom:
    """Follows what the vehicle's cameras say; without a calibration to compare with, everything agrees."""

    def __init__(self, camera: CameraConfig | None) -> None:
        self._config = camera or CameraConfig()
        self._is_on = camera is not None
        self._fov_deg = [math.degrees(angle) for angle in self._config.camera().fov_rad]
        self._words: dict[tuple[int, str], _Word] = {}
        self._back_ns = 0
        self.fault = ""  # in words, empty while all agrees

    def receive(self, message: Any, now_ns: int) -> None:
        """Take a CAMERA_FOV_STATUS, CAMERA_SETTINGS or VIDEO_STREAM_INFORMATION that arrived at `now_ns`."""
        component, kind = message.get_srcComponent(), message.get_type()
        device = int(message.camera_device_id)
        camera = component if component != AUTOPILOT_COMPONENT else device or AUTOPILOT_COMPONENT
        if not self._is_on or self._config.device not in (0, camera):
            return
        if kind == "CAMERA_SETTINGS":
            difference = self._of_level(message.zoomLevel)
        elif kind == "CAMERA_FOV_STATUS":
            is_echo = component == OWN_CAMERA_COMPONENT and abs(message.hfov - self._fov_deg[0]) < ECHO_DEG
            difference = None if is_echo else self._of_view(message.hfov, message.vfov, 0.0)
        else:
            is_thermal = int(message.flags) & mavlink.VIDEO_STREAM_STATUS_FLAGS_THERMAL
            difference = None if is_thermal else self._of_view(float(message.hfov), math.nan, WHOLE_DEG)
            kind = f"{kind} {message.stream_id}"
        key = (camera, kind)
        if difference is not None and self._has_room(key, difference):
            self._words[key] = _Word(camera, kind.startswith("VIDEO"), difference)
            self._judge(now_ns)

    def hides(self, stamp_ns: int) -> bool:
        """Whether a frame was taken while the lens was, or may have been, other than calibrated."""
        return bool(self.fault) or stamp_ns < self._back_ns

    def _has_room(self, key: tuple[int, str], difference: str) -> bool:
        """Whether the word can be kept; one that differs takes the place of one that agrees."""
        if key in self._words or len(self._words) < MOST:
            return True
        agreeing = next((one for one, word in self._words.items() if not word.difference), None)
        if not difference or agreeing is None:
            return False
        del self._words[agreeing]
        return True

    def _judge(self, now_ns: int) -> None:
        agreeing = {word.camera for word in self._words.values() if word.is_stream and not word.difference}
        faults = [
            f"camera {word.camera}: {word.difference}"
            for word in self._words.values()
            if word.difference and not (word.is_stream and word.camera in agreeing)
        ]
        if self.fault and not faults:
            self._back_ns = now_ns
        self.fault = faults[0] if faults else ""

    def _of_level(self, level_percent: float) -> str | None:
        """How it differs; None where nothing is said."""
        if not math.isfinite(level_percent) or level_percent < 0.0:
            return None
        wanted = self._config.zoom_level
        if abs(level_percent - wanted) <= LEVEL_PERCENT:
            return ""
        return f"zoom level {level_percent:g} %, calibrated at {wanted:g} % (camera.zoom_level)"

    def _of_view(self, hfov_deg: float, vfov_deg: float, rounding_deg: float) -> str | None:
        """How it differs, by the horizontal angle or, where that is unknown, the vertical one; None for neither."""
        for name, said_deg, wanted_deg in zip("hv", (hfov_deg, vfov_deg), self._fov_deg, strict=True):
            if 0.0 < said_deg < math.inf and math.isfinite(wanted_deg):
                if abs(said_deg - wanted_deg) <= FOV_SHARE * wanted_deg + rounding_deg:
                    return ""
                return f"{name}fov {said_deg:.1f} degrees, by the calibration {wanted_deg:.1f}"
        return None
