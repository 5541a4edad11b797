"""How steadily what is reported goes from keyframe to keyframe: the attitude, and the position.

What steps farther than it can is let go. A compass steps; tilt does not, nor does a position that is reported to have
gone on as before. Where such steps come again and again the poses are not the frames', or the ground moves, and what
the window says is not believed.
"""

from collections import deque
from dataclasses import replace

import numpy as np

from distloc.scenery.information import Chain
from distloc.types import BoolArray, CameraPose, FloatArray, PoseErrors

_JUMP = 4.0  # standard deviations of a step of the slow errors
_STEADY = np.array([True, True, False, True, True, True])  # all but the heading
_MOST_JUMPS, _LATELY = 2, 25  # of as many keyframes
_MOST_ACCELERATION = 10.0  # m/s^2, of a craft
_LEAST_OFFSET_M, _OF_OFFSET = 10.0, 0.5  # of a leap: less is let wander back; its share that is one sigma


class Steadiness:
    """Of the errors that the window finds; the compass has one."""

    def __init__(self) -> None:
        self._jumped: deque[bool] = deque(maxlen=_LATELY)

    @property
    def is_restless(self) -> bool:
        """Whether more than a heading stepped lately, again and again."""
        return sum(self._jumped) > _MOST_JUMPS

    def jumps(self, step: FloatArray, chain: Chain) -> BoolArray:
        """Which components of a step (6,) of the errors, less what is kept of them, a chain cannot have made."""
        return np.asarray(np.square(step) > _JUMP**2 * (chain.new + 2.0 * chain.white))

    def note(self, has_jumped: BoolArray) -> None:
        """After a solved keyframe: which components jumped."""
        self._jumped.append(bool(has_jumped[_STEADY].any()))


class Leaps:
    """Of the position: where it comes farther than a craft can, it is from then on taken as it was before.

    `offset_m` (3,) is by how much. Whether it was right before or is now nobody knows: part of it is one sigma of the
    place. `moved_m` (3,) is the way from the keyframe before the last to the last.
    """

    def __init__(self) -> None:
        self.offset_m, self.moved_m = np.zeros(3), np.zeros(3)
        self._elapsed_s = 0.0
        self._has_leapt = False

    def taken_off(self, pose: CameraPose) -> CameraPose:
        """A reported pose as it was before the leaps."""
        return replace(pose, position_enu_m=pose.position_enu_m - self.offset_m)

    def told(self, errors: PoseErrors) -> PoseErrors:
        """What is told of a pose's errors, and that the place may be off by what was taken off."""
        off_m = _OF_OFFSET * float(np.linalg.norm(self.offset_m))
        return replace(errors, position_bias_m=float(np.hypot(errors.position_bias_m, off_m)))

    def note(self, moved_m: FloatArray, elapsed_s: float) -> float:
        """How much farther a reported place is from that of the keyframe before than a craft can have come."""
        before_s = max(self._elapsed_s, 1e-3)
        off_m = float(np.linalg.norm(moved_m - self.moved_m * (elapsed_s / before_s))) if self._elapsed_s else 0.0
        self.moved_m, self._elapsed_s = moved_m, elapsed_s
        could_m = 0.5 * _MOST_ACCELERATION * elapsed_s * (elapsed_s + before_s) + _LEAST_OFFSET_M / 2.0
        self._has_leapt = off_m > could_m
        if not self._has_leapt:
            return 0.0
        self._elapsed_s = 0.0  # no speed to compare the next with
        return off_m

    def let_go(self, step_m: FloatArray) -> FloatArray:
        """What is taken off of the step (3,) that the position's error made: all of it where the reports leapt.

        Where they did not it is scenery that begins to move, and none.
        """
        has_leapt, self._has_leapt = self._has_leapt, False
        if not has_leapt or np.linalg.norm(step_m) <= _LEAST_OFFSET_M:
            return np.zeros(3)
        self.offset_m = self.offset_m + step_m
        return step_m


def let_go(chain: Chain, step: FloatArray, which: BoolArray) -> Chain:
    """A chain that lets some components of a step (6,) be."""
    return replace(chain, new=np.where(which, chain.new + 4.0 * np.square(step), chain.new))
