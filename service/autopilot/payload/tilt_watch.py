"""Whether a gimbal's pitch and roll are from the horizon, as the protocol wants, or from the body; for `gimbal`.

A servo gimbal's own angles are from the body (FACTS: AP_Mount_Servo): while it holds the camera level they undo each
tilt of the vehicle. From the horizon no gimbal does that: it stays, or it follows.
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


class TiltWatch:
    """Compares the gimbal's tilts with the vehicle's, as a share of these."""

    def __init__(self) -> None:
        self.clear()

    def clear(self) -> None:
        """Forget everything."""
        self._last: tuple[int, FloatArray, FloatArray] | None = None
        self._tilted_rad = self._square = self._product = 0.0

    def pause(self) -> None:
        """What comes next is compared with nothing before it."""
        self._last = None

    def take(self, boot_ns: int, R_level_from_body: FloatArray, R_level_from_gimbal: FloatArray) -> None:
        """Take both attitudes (3, 3) in level axes that are turned by the vehicle's heading."""
        last = self._last
        if last is None or not 0 <= boot_ns - last[0] <= LONGEST_STEP_NS:
            self._last = (boot_ns, R_level_from_body, R_level_from_gimbal)
            return
        tilt = _tilt_rad(R_level_from_body, last[1])
        size_rad = float(np.linalg.norm(tilt))
        if boot_ns - last[0] < STEP_NS or size_rad < STEP_RAD:
            return
        self._last = (boot_ns, R_level_from_body, R_level_from_gimbal)
        kept = math.exp(-size_rad / FORGETTING_RAD)
        self._tilted_rad = self._tilted_rad * kept + size_rad
        self._square = self._square * kept + size_rad**2
        self._product = self._product * kept + float(tilt @ _tilt_rad(R_level_from_gimbal, last[2]))

    @property
    def is_contradicted(self) -> bool:
        """Whether the gimbal's angles undo the vehicle's tilts."""
        return self._tilted_rad >= ENOUGH_RAD and self._product < UNDONE * self._square


def _tilt_rad(R: FloatArray, before: FloatArray) -> FloatArray:
    """The part (2,) about the level axes of a small rotation from one attitude to the next."""
    turned = R @ before.T
    return np.array([turned[2, 1] - turned[1, 2], turned[0, 2] - turned[2, 0]]) / 2.0
