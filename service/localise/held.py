"""How long an angle has been off, surely and to one side; `scenery` asks, so that a moment's error is not told."""

import math

SURE = 4.0  # standard deviations that an error must be
OLD_S = 10.0  # what was measured longer ago is not told


class Held:
    """For how long an angle has been beyond a limit, surely and to one side."""

    def __init__(self, limit_rad: float) -> None:
        self._limit_rad = limit_rad
        self.reset()

    def reset(self) -> None:
        """It is not."""
        self._since_s = self._last_s = math.inf
        self._side = 0.0

    def for_s(self, angle_rad: float, sigma_rad: float, stamp_s: float) -> float:
        """Take the angle at a time; 0 where it is not beyond."""
        side = math.copysign(1.0, angle_rad)
        if not (abs(angle_rad) > self._limit_rad and abs(angle_rad) > SURE * sigma_rad):
            self.reset()
            return 0.0
        if side != self._side or not 0.0 <= stamp_s - self._last_s <= OLD_S:
            self._since_s, self._side = stamp_s, side
        self._last_s = stamp_s
        return stamp_s - self._since_s
