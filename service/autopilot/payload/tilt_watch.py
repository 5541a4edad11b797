"""What the vehicle's tilts say of a gimbal's pitch and roll, and of the frame of its yaw; for `gimbal`.

A servo gimbal's own angles are from the body (FACTS: AP_Mount_Servo): while it holds the camera level they undo each
tilt of the vehicle. From the horizon, as the protocol wants, no gimbal does that: it stays, or it follows. One that
follows only if its yaw is read in the other frame than its flags say has it in that one.
"""

import math

import numpy as np

from distloc.types import FloatArray

STEP_RAD = math.radians(2.0)
STEP_NS = 500_000_000
LONGEST_STEP_NS = 10_000_000_000
FORGETTING_RAD = math.radians(60.0)  # of tilting, after which a step counts by 1/e
ENOUGH_RAD = math.radians(20.0)
UNDONE = -0.7  # share of the vehicle's tilts by which the gimbal's angles change
FOLLOWED, UNLIKE = 0.8, 0.3  # the same in the frame in which it follows, and in the one in which it does not


class TiltWatch:
    """Compares the gimbal's tilts with the vehicle's, as a share of these."""

    def __init__(self) -> None:
        self.clear()

    def clear(self) -> None:
        """Forget everything."""
        self._last: tuple[int, FloatArray, FloatArray, FloatArray] | None = None
        self._tilted_rad = self._square = self._product = self._product_of_other = 0.0
        self.is_yaw_contradicted = False  # it was seen to follow the tilts in the other frame, and not by its flags

    def pause(self) -> None:
        """What comes next is compared with nothing before it."""
        self._last = None

    def take(self, boot_ns: int, R_level_from_body: FloatArray, R_by_flags: FloatArray, R_by_other: FloatArray) -> None:
        """Take both attitudes (3, 3) in level axes that are turned by the vehicle's heading.

        The gimbal's come with its yaw in the frame that its flags say, and in the other one.
        """
        last, now = self._last, (boot_ns, R_level_from_body, R_by_flags, R_by_other)
        if last is None or not 0 <= boot_ns - last[0] <= LONGEST_STEP_NS:
            self._last = now
            return
        tilt = _tilt_rad(R_level_from_body, last[1])
        size_rad = float(np.linalg.norm(tilt))
        if boot_ns - last[0] < STEP_NS or size_rad < STEP_RAD:
            return
        self._last = now
        kept = math.exp(-size_rad / FORGETTING_RAD)
        self._tilted_rad = self._tilted_rad * kept + size_rad
        self._square = self._square * kept + size_rad**2
        self._product = self._product * kept + float(tilt @ _tilt_rad(R_by_flags, last[2]))
        self._product_of_other = self._product_of_other * kept + float(tilt @ _tilt_rad(R_by_other, last[3]))
        follows = self._product_of_other > FOLLOWED * self._square and self._product < UNLIKE * self._square
        if follows and self._tilted_rad >= ENOUGH_RAD:
            self.is_yaw_contradicted = True  # for good: near north the two frames are alike

    @property
    def is_contradicted(self) -> bool:
        """Whether the gimbal's angles undo the vehicle's tilts."""
        return self._tilted_rad >= ENOUGH_RAD and self._product < UNDONE * self._square


def _tilt_rad(R: FloatArray, before: FloatArray) -> FloatArray:
    """The part (2,) about the level axes of a small rotation from one attitude to the next."""
    turned = R @ before.T
    return np.array([turned[2, 1] - turned[1, 2], turned[0, 2] - turned[2, 0]]) / 2.0
