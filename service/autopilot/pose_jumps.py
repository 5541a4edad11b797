"""Notices where the autopilot's estimate jumps though nobody flagged it; used by the autopilot. Free of I/O.

An estimator that resets onto a false GPS position calls itself nominal again: the jump is the only trace (ArduPilot).
Which of the two places or headings is true nobody knows; one that jumps back has been where it was.
"""

import math

import numpy as np

from distloc.geometry.rotations import matrix_from_rotation_vector
from distloc.types import FloatArray

POSITION_M = 10.0  # ten times what a consumer's position jitters by
HEADING_RAD = math.radians(5.0)  # a turn at 250 deg/s between two attitudes at 50 Hz, had the rates not told of it
POSITION_DOUBT_NS = 30_000_000_000  # then the new place is taken for the true one
HEADING_DOUBT_NS = 10_000_000_000  # the sights have told by then
_MOST_TURNS = 8  # those that frames on their way may still need
POSITION_GAP_NS = 1_000_000_000  # over longer ones, up to the most, it may have flown anywhere at the speeds heard
MOST_GAP_NS = 30_000_000_000
ATTITUDE_GAP_NS = 120_000_000  # over longer ones nothing can be said: a hard turn may begin and end unseen


class JumpWatch:
    """Sums the jumps of position and heading; within the doubt's time the sum is how wrong it may be."""

    def __init__(self) -> None:
        self.counts = {"position": 0, "heading": 0}
        self._turns: tuple[tuple[int, float], ...] = ((0, 0.0),)  # time since boot, sum of all jumps up to then
        self.clear()

    def clear(self) -> None:
        """Forget everything but the counts: the autopilot restarted."""
        self._position: tuple[int, FloatArray, FloatArray] | None = None
        self._drifts_mps: tuple[FloatArray, ...] = ()  # what the velocities left over in the last two steps
        self._attitude: tuple[int, FloatArray, FloatArray] | None = None
        self._offset_m = np.zeros(2)
        self._turn_rad = 0.0
        self._moved_ns = self._turned_ns = 0
        self._turns = ((0, self._turns[-1][1]),)

    def position(self, boot_ns: int, position_enu_m: FloatArray, velocity_enu_mps: FloatArray, now_ns: int) -> None:
        """Take the next position (3,) and velocity (3,)."""
        last, self._position = self._position, (boot_ns, position_enu_m, velocity_enu_mps)
        if last is None or not 0 < boot_ns - last[0] <= MOST_GAP_NS:
            return
        gap_s = (boot_ns - last[0]) * 1e-9
        flown_m = 0.5 * (last[2] + velocity_enu_mps) * gap_s
        step_m = (position_enu_m - last[1] - flown_m)[:2]  # not the height: no GPS glitch shows there alone
        before_mps, self._drifts_mps = self._drifts_mps, (*self._drifts_mps[-1:], step_m / gap_s)
        # a velocity that is always wrong, as one that is left at 0, makes each step like those before
        unlike_m = [float(np.linalg.norm(step_m - drift_mps * gap_s)) for drift_mps in before_mps]
        if not before_mps or min(unlike_m) <= POSITION_M:
            return
        off_m = float(np.linalg.norm(step_m))
        if boot_ns - last[0] > POSITION_GAP_NS:
            fastest_mps = max(float(np.linalg.norm(one[:2])) for one in (last[2], velocity_enu_mps))
            off_m = float(np.linalg.norm((position_enu_m - last[1])[:2])) - fastest_mps * gap_s
        if off_m > POSITION_M:
            self.counts["position"] += 1
            self._offset_m = step_m + (self._offset_m if now_ns - self._moved_ns < POSITION_DOUBT_NS else 0.0)
            self._moved_ns = now_ns

    def attitude(
        self,
        boot_ns: int,
        R_ned_from_body: FloatArray,
        body_rate_rps: FloatArray,
        now_ns: int,
        *,
        turns_camera: bool = True,
    ) -> None:
        """Take the next attitude (3, 3) and the body's rates (3,), as the same message tells them.

        `turns_camera` says whether the camera's pose goes by this heading; if not, a jump is doubted but turns no pose.
        Rates that are not finite say nothing: what comes after them cannot be judged.
        """
        last, self._attitude = self._attitude, None
        if not np.isfinite(body_rate_rps).all():
            return
        self._attitude = (boot_ns, R_ned_from_body, body_rate_rps)
        if last is None or not 0 < boot_ns - last[0] <= ATTITUDE_GAP_NS:
            return
        turned_rad = 0.5 * (last[2] + body_rate_rps) * ((boot_ns - last[0]) * 1e-9)
        step_rad = _twist_about_down(R_ned_from_body @ (last[1] @ matrix_from_rotation_vector(turned_rad)).T)
        if abs(step_rad) > HEADING_RAD:
            self.counts["heading"] += 1
            doubted_rad = self._turn_rad if now_ns - self._turned_ns < HEADING_DOUBT_NS else 0.0
            self._turn_rad = _wrapped(step_rad + doubted_rad)
            self._turned_ns = now_ns
            if turns_camera:  # replaced as a whole: another thread reads it
                self._turns = (*self._turns[-_MOST_TURNS:], (boot_ns, _wrapped(self._turns[-1][1] + step_rad)))

    def turned_rad(self, boot_ns: int) -> float:
        """The sum of the jumps that turned the camera up to a time: a pose of then differs by it from one before.

        It is an angle, in [-pi, pi]: a difference of two must be wrapped.
        """
        return next((turned for at_ns, turned in reversed(self._turns) if at_ns <= boot_ns), self._turns[0][1])

    def is_position_doubted(self, now_ns: int) -> bool:
        """Whether the position jumped of late, and not back."""
        return now_ns - self._moved_ns < POSITION_DOUBT_NS and float(np.linalg.norm(self._offset_m)) > POSITION_M

    def heading_rad(self, now_ns: int) -> float:
        """By how much the heading jumped of late, both ways summed; 0 if it did not."""
        is_doubted = now_ns - self._turned_ns < HEADING_DOUBT_NS and abs(self._turn_rad) > HEADING_RAD
        return abs(self._turn_rad) if is_doubted else 0.0


def _twist_about_down(R: FloatArray) -> float:
    """How far a rotation (3, 3) turns about its third axis; unlike a heading it has a meaning in steep flight too."""
    return math.atan2(R[1, 0] - R[0, 1], R[0, 0] + R[1, 1])


def _wrapped(angle_rad: float) -> float:
    return math.remainder(angle_rad, 2.0 * math.pi)
