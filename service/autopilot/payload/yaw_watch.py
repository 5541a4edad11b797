"""Whether a gimbal's yaw does what its flags say while the vehicle turns; for `gimbal`. Free of I/O.

Senders exist whose angles contradict their flags (FACTS: AP_Mount_Gremsy, AP_Mount_Servo; ArduPilot before the frame
flags sent the lock with a yaw from the vehicle's nose). A turn shows it: a locked gimbal looks on where it looked, one
that follows turns with the vehicle. If by the flags' frame it does the one where it should do the other, and by the
other frame it would be right, then the frame is not what the flags say.
"""

import math

import numpy as np

from distloc.geometry.rotations import matrix_from_quaternion
from distloc.types import FloatArray
from service.autopilot.payload.gimbal_attitude import GimbalAttitude

STEP_RAD = math.radians(3.0)  # well above a compass' jitter
STEP_NS = 500_000_000  # ten times the lateness of a gimbal's attitude
LONGEST_STEP_NS = 10_000_000_000  # over longer ones a pilot moves the gimbal
FORGETTING_RAD = math.radians(60.0)  # of turn, after which a step counts by 1/e
ENOUGH_RAD = math.radians(25.0)
TRACKING_RPS = math.radians(6.0)  # the bearing of a place 100 m away from a craft that passes it at 10 m/s
INSIDE_RAD = math.radians(45.0)
RIGHT, WRONG = 0.3, 0.7  # how near to, and how far from, what is expected a share of the vehicle's turn must be


class YawWatch:
    """Compares the gimbal's turns with the vehicle's, as a share of these; the last 60 degrees of turn count most."""

    def __init__(self) -> None:
        self.clear()

    def clear(self) -> None:
        """Forget everything."""
        self._reading: tuple[bool, bool | None] | None = None
        self._last: tuple[int, float, FloatArray] | None = None
        self._turned_rad = self._square = self._product = 0.0

    def pause(self) -> None:
        """What comes next is compared with nothing before it: the vehicle's heading jumped, or its times changed."""
        self._last = None

    def take(self, boot_ns: int, heading_rad: float, attitude: GimbalAttitude) -> None:
        """Take the gimbal's attitude beside the vehicle's heading at that time."""
        reading = (attitude.is_from_north, attitude.is_locked)
        if reading != self._reading:
            self.clear()
            self._reading = reading
        R = matrix_from_quaternion(attitude.q)
        last = self._last
        if last is None or not 0 <= boot_ns - last[0] <= LONGEST_STEP_NS:
            self._last = (boot_ns, heading_rad, R)
            return
        turn_rad = math.remainder(heading_rad - last[1], 2.0 * math.pi)
        if boot_ns - last[0] < STEP_NS or abs(turn_rad) < STEP_RAD:
            return
        self._last = (boot_ns, heading_rad, R)
        if reading == (False, True) and _may_track_a_place(turn_rad, (boot_ns - last[0]) * 1e-9, R):
            return
        relative = R @ last[2].T
        followed_rad = math.atan2(relative[1, 0] - relative[0, 1], relative[0, 0] + relative[1, 1])
        kept = math.exp(-abs(turn_rad) / FORGETTING_RAD)
        self._turned_rad = self._turned_rad * kept + abs(turn_rad)
        self._square = self._square * kept + turn_rad * turn_rad
        self._product = self._product * kept + turn_rad * followed_rad

    @property
    def is_tried(self) -> bool:
        """Whether the vehicle has turned enough to say anything."""
        return self._turned_rad >= ENOUGH_RAD

    @property
    def is_contradicted(self) -> bool:
        """Whether the camera's turns fit the other frame, and not the one that the flags say."""
        if not self.is_tried or self._reading is None:
            return False
        is_from_north, is_locked = self._reading
        share = self._product / self._square
        by_flags, by_other = (share, share + 1.0) if is_from_north else (share + 1.0, share)
        expected = np.array([0.0, 1.0] if is_locked is None else [0.0 if is_locked else 1.0])
        return bool(np.abs(by_flags - expected).min() > WRONG and np.abs(by_other - expected).min() < RIGHT)


def _may_track_a_place(turn_rad: float, span_s: float, R_level_from_gimbal: FloatArray) -> bool:
    """Whether a locked camera may turn with the vehicle because it is held on a place that the vehicle flies around.

    It then turns no faster than the bearing of such a place, or looks at the inside of the turn.
    """
    yaw_rad = math.atan2(R_level_from_gimbal[1, 0], R_level_from_gimbal[0, 0])
    off_inside_rad = math.remainder(yaw_rad - math.copysign(math.pi / 2.0, turn_rad), 2.0 * math.pi)
    return abs(turn_rad) < TRACKING_RPS * span_s or abs(off_inside_rad) < INSIDE_RAD
