"""The orientation of the camera's gimbal over time; used by the camera's poses where the mount says `gimbal`.

Of several gimbals one is followed: attitudes of two are never mixed. Times are the autopilot's time since boot.
"""

import math
from typing import Any

import numpy as np

from distloc.geometry.rotations import matrix_from_euler, matrix_from_quaternion
from distloc.types import FloatArray, RejectReason
from service.autopilot.payload.gimbal_attitude import GimbalAttitude, attitude_of, has_delta_yaw
from service.autopilot.payload.gimbal_clock import GimbalClock
from service.autopilot.payload.heard_gimbals import HeardGimbals
from service.autopilot.payload.tilt_watch import TiltWatch
from service.autopilot.payload.yaw_watch import YawWatch
from service.autopilot.poses import AttitudeTrack
from service.autopilot.timesync import ENVELOPE_SPREAD_S

GAP_NS = 500_000_000  # 2 Hz
SILENT_NS = 2_000_000_000


class Gimbal:
    """Attitudes of one gimbal with yaw either from north or from the vehicle's heading, whichever is reported.

    `device` is its id: 1 to 6 of those that the autopilot reports, else the component's; 0: the only one heard.
    `is_from_north` says that its attitudes owe nothing to the vehicle's heading.
    """

    def __init__(self, device: int = 0, gap_ns: int = GAP_NS) -> None:
        self.heard = HeardGimbals(device)
        self.is_from_north = False
        self._track = AttitudeTrack(gap_ns=gap_ns)
        self._clock = GimbalClock()
        self._yaw, self._tilt = YawWatch(), TiltWatch()
        self._followed: int | None = None
        self._gives_delta_yaw = False
        self._usable_ns: int | None = None  # on the host's clock
        self._refused = ""
        self._now_ns = 0

    def clear(self) -> None:
        """Forget all attitudes: their times were wrong, or the autopilot restarted. The flags' trial holds."""
        self._track.clear()
        self._clock.clear()
        self.heading_jumped()

    def expected(self, now_ns: int) -> None:
        """The vehicle tells its attitude: from here on the gimbal should be heard too."""
        self._now_ns = now_ns
        if self._usable_ns is None:
            self._usable_ns = now_ns

    def heading_jumped(self) -> None:
        """The vehicle's heading changed without a turn: that says nothing of the gimbal."""
        self._yaw.pause()
        self._tilt.pause()

    def receive(
        self,
        message: Any,
        vehicle_boot_ns: int | None,
        now_boot_ns: int,
        now_ns: int,
        R_ned_from_body: FloatArray | None,
    ) -> bool:
        """Take a message of a gimbal that arrived now; False if the followed one's tells no attitude.

        `vehicle_boot_ns` is its stamp taken for the autopilot's; the vehicle's attitude (3, 3) is None where unknown.
        """
        is_followed = self.heard.take(message)
        if self.heard.followed != self._followed:
            self._start_following(self.heard.followed)
        if not is_followed:
            return True
        attitude = attitude_of(message, self._gives_delta_yaw)
        self._gives_delta_yaw = self._gives_delta_yaw or has_delta_yaw(message)
        if isinstance(attitude, str):
            self._refused = attitude
            return False
        boot_ns = self._clock.stamp_ns(getattr(message, "time_boot_ms", 0), vehicle_boot_ns, now_boot_ns)
        if boot_ns is not None:
            self._add(boot_ns, attitude, now_ns, R_ned_from_body)
        return True

    def R_ned_from_gimbal(
        self, boot_ns: int, now_boot_ns: int, R_ned_from_body: FloatArray
    ) -> FloatArray | RejectReason | None:
        """(3, 3); None: a later sample may still come."""
        if self.heard.is_ambiguous or self._is_contradicted:
            return RejectReason.GIMBAL_UNKNOWN
        q = self._track.at(boot_ns, now_boot_ns)
        if isinstance(q, RejectReason):
            return q if q is RejectReason.FRAME_TOO_OLD else RejectReason.GIMBAL_UNKNOWN
        if q is None:
            return None
        R_level_from_gimbal = matrix_from_quaternion(q)
        if self.is_from_north:
            return R_level_from_gimbal
        heading_rad = math.atan2(R_ned_from_body[1, 0], R_ned_from_body[0, 0])
        return np.asarray(matrix_from_euler(heading_rad, 0.0, 0.0) @ R_level_from_gimbal)

    @property
    def clock_spread_s(self) -> float:
        """How wrong its times may be beside the vehicle's."""
        return ENVELOPE_SPREAD_S if self._clock.is_by_arrival else 0.0

    def fault(self, now_ns: int) -> str:
        """Why it is not known where it points, in words; empty if it is known."""
        if self.heard.is_ambiguous:
            ids = ", ".join(map(str, self.heard.ids))
            return f"gimbals {ids} are heard: camera.mount.gimbal_device must be one of them"
        if self._usable_ns is not None and now_ns - self._usable_ns > SILENT_NS:
            return self._silence()
        if self._tilt.is_yaw_contradicted:
            return f"the yaw of gimbal {self._followed} is in the other frame than its flags say: so its tilts tell"
        if self._yaw.is_contradicted:
            return f"the yaw of gimbal {self._followed} moves against its flags when the vehicle turns"
        if self._tilt.is_contradicted:
            return f"pitch and roll of gimbal {self._followed} are from the body: they undo each tilt of the vehicle"
        return ""

    def described(self) -> str:
        """Which gimbal is followed, the frame of its yaw, and whether a turn has borne that out."""
        frame = "from north" if self.is_from_north else "from the vehicle's nose"
        tried = "a turn has borne it out" if self._yaw.is_tried else "turn the vehicle by 30 degrees to try that"
        return f"gimbal {self._followed}, {self.heard.kind}, yaw {frame}: {tried}"

    def counters(self) -> dict[str, object]:
        """What the status carries."""
        return {"followed": self._followed, "heard": list(self.heard.ids), "fault": self.fault(self._now_ns)}

    @property
    def _is_contradicted(self) -> bool:
        return self._yaw.is_contradicted or self._tilt.is_contradicted or self._tilt.is_yaw_contradicted

    def _start_following(self, device: int | None) -> None:
        self._followed = device
        self._track.clear()
        self._clock.clear()
        self._yaw.clear()
        self._tilt.clear()
        self._gives_delta_yaw, self._refused = False, ""

    def _add(self, boot_ns: int, attitude: GimbalAttitude, now_ns: int, R_ned_from_body: FloatArray | None) -> None:
        if attitude.is_from_north != self.is_from_north:
            self._track.clear()
            self._tilt.clear()
            self.is_from_north = attitude.is_from_north
        latest_ns = self._track.latest_ns
        if not self._track.add(boot_ns, attitude.q):
            return
        self._refused = ""
        if latest_ns is not None and boot_ns - latest_ns <= self._track.gap_ns:
            self._usable_ns = now_ns
        if R_ned_from_body is not None:
            self._watch(boot_ns, attitude, R_ned_from_body)

    def _watch(self, boot_ns: int, attitude: GimbalAttitude, R_ned_from_body: FloatArray) -> None:
        """Hold the attitude against the vehicle's own moves."""
        heading_rad = math.atan2(R_ned_from_body[1, 0], R_ned_from_body[0, 0])
        self._yaw.take(boot_ns, heading_rad, attitude)
        R_level_from_ned = matrix_from_euler(-heading_rad, 0.0, 0.0)
        R_gimbal = matrix_from_quaternion(attitude.q)
        readings = (R_level_from_ned @ R_gimbal, R_gimbal)
        by_flags, by_other = readings if attitude.is_from_north else readings[::-1]
        self._tilt.take(boot_ns, R_level_from_ned @ R_ned_from_body, by_flags, by_other)

    def _silence(self) -> str:
        if self._refused and self._followed is not None:
            return f"gimbal {self._followed} tells no attitude: {self._refused}"
        wanted = self.heard.device or self._followed
        name = f"gimbal {wanted}" if wanted else "a gimbal"
        others = [one for one in self.heard.ids if one != wanted]
        said = f", only of {', '.join(map(str, others))}" if others else ""
        return f"no attitude of {name} at 2 Hz or more{said}"
