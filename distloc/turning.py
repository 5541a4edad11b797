"""How slow errors of a heading change as the craft turns, and what that can have moved a target by.

Iron that turns with the craft makes its compass err by a sinusoid of the heading, and levels that are off by an angle
are off to other sides once it has turned. So slow errors are forgotten in turns as well as in time. Around a target
that is not enough: the sinusoid comes again in each round, and sees the target where it is not, by its amplitude times
the range, however often it goes round. Both matter little on straight flights, where such an error is constant.
"""

from dataclasses import dataclass, field, replace

import numpy as np

from distloc.types import CameraPose, FloatArray, PoseErrors

_SMOOTH_S = 5.0  # a craft that rocks does not turn
_SHARE = 0.5**0.5  # of the heading's slow error: half of its variance changes with the heading


class TurnRate:
    """How fast a craft turns about up, smoothed; the localizer has one."""

    def __init__(self) -> None:
        self._rate_rps = 0.0
        self._last: tuple[float, float] | None = None

    def take(self, pose: CameraPose, errors: PoseErrors) -> PoseErrors:
        """These errors at a pose: the faster it turns, the sooner slow ones are forgotten."""
        if pose.heading_rad is None:
            return errors
        if self._last is not None:
            elapsed_s = pose.stamp_s - self._last[0]
            if elapsed_s > 0.0:
                turned_rad = (pose.heading_rad - self._last[1] + np.pi) % (2.0 * np.pi) - np.pi
                kept = float(np.exp(-elapsed_s / _SMOOTH_S))
                self._rate_rps = kept * self._rate_rps + (1.0 - kept) * turned_rad / elapsed_s
        self._last = (pose.stamp_s, pose.heading_rad)
        rate_hz = 1.0 / errors.bias_time_constant_s + abs(self._rate_rps) / errors.bias_turn_rad
        return replace(errors, bias_time_constant_s=1.0 / rate_hz)


@dataclass(slots=True)
class Headings:
    """From which headings a target was seen, and how far away: a track has one.

    `sums` (4,) over the sightings: of the heading's cosine and sine and of 1, each over the squared range, which is
    what a bearing tells; and their number.
    """

    sums: FloatArray = field(default_factory=lambda: np.zeros(4))

    def add(self, pose: CameraPose, range_m: float) -> None:
        """A sighting; of a pose without a heading nothing is known."""
        if pose.heading_rad is not None:
            told = 1.0 / max(range_m, 1.0) ** 2
            self.sums = self.sums + np.array(
                [told * np.cos(pose.heading_rad), told * np.sin(pose.heading_rad), told, 1.0]
            )

    def sigma_m(self, errors: PoseErrors) -> float:
        """One standard deviation on each level axis of what an error that changes with the heading moves a target by.

        It grows with the headings' circular variance (Mardia and Jupp 2000, 2.3.1): 0 on a straight flight, all of the
        error times the range once around. 0 where no error changes with turns, and where nothing was seen.
        """
        cos, sin, told, count = self.sums
        if count == 0.0 or not np.isfinite(errors.bias_turn_rad):
            return 0.0
        varied = max(1.0 - (cos**2 + sin**2) / told**2, 0.0)
        return float(_SHARE * errors.heading_bias_rad * np.sqrt(varied * count / told))
