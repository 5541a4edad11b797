"""From where and in which directions a target was seen, evenly over all its sightings; its track has one."""

import math

import numpy as np

from distloc.sights.sights import Ray
from distloc.types import BoolArray, FloatArray, PoseErrors

MOST = 32
_ANOTHER = 10.0  # times that an error has forgotten itself: nothing of it is left
COLUMNS = 8
TIME, EAST, NORTH, AZIMUTH, WHITE, BIAS, AGE, SOURCE = range(COLUMNS)


class Bearings:
    """At most `MOST` rows, the first `count` of those `held`.

    They are the time, the camera's place east and north, the azimuth, one standard deviation of the frame's own error
    and of the slow one, how often the slow one has forgotten itself by then, and 1 where the scenery measured it.
    """

    def __init__(self, rows: FloatArray | None = None) -> None:
        self.held = np.zeros((MOST, COLUMNS))
        self.count, self._stride, self._skipped, self._age = 0, 1, 0, 0.0
        self._stamp_s: float | None = None
        if rows is not None and len(rows) > 0:
            self.count = min(len(rows), MOST)
            self.held[: self.count] = rows[-self.count :]
            self._stamp_s, self._age = float(rows[-1, TIME]), float(rows[-1, AGE])

    @property
    def rows(self) -> FloatArray:
        """A copy of those held."""
        return self.held[: self.count].copy()

    def jumped(self, by_rad: float) -> None:
        """The reported azimuths, and so what they err by, are others from now on, by an angle clockwise from above."""
        self.held[: self.count, AZIMUTH] += by_rad

    def forget_error(self) -> None:
        """From now on the slow error is another."""
        self._age += _ANOTHER

    def add(self, ray: Ray, errors: PoseErrors, white_rad: float) -> bool:
        """A sighting whose azimuth errs by `white_rad` in this frame alone; whether it is held."""
        pose = ray.pose
        if self._stamp_s is not None:
            self._age += max(pose.stamp_s - self._stamp_s, 0.0) / errors.bias_time_constant_s
        self._stamp_s = pose.stamp_s
        self._skipped += 1
        if self._skipped < self._stride:
            return False
        self._skipped = 0
        if self.count == MOST:  # from now on every other as often
            self.held[: MOST // 2] = self.held[::2].copy()
            self.count, self._stride = MOST // 2, 2 * self._stride
        east_m, north_m, _ = pose.position_enu_m.tolist()
        along_east, along_north, _ = ray.axes[2].tolist()
        told_rad = errors.heading_bias_rad / errors.heading_scale
        is_measured = pose.attitude is not None and pose.attitude.source == "scenery"
        azimuth_rad = math.atan2(along_east, along_north)
        row = (pose.stamp_s, east_m, north_m, azimuth_rad, white_rad, told_rad, self._age, is_measured)
        self.held[self.count] = row
        self.count += 1
        return True


def correlated(
    rows: FloatArray, is_held: BoolArray, aim_rad: FloatArray, turn_rad: float, scales: FloatArray
) -> FloatArray:
    """The covariances (k, s, m, m) of the azimuths of rows (k, m, 8), those held; the aim errs by `aim_rad` (k,).

    The slow error keeps of itself what its age says, the aim's what a turn of the sight by `turn_rad` leaves. The
    autopilot's is as many times as large as told as `scales` (s,) say.
    """
    age, source = rows[:, :, AGE], rows[:, :, SOURCE]
    is_same = source[:, :, None] == source[:, None, :]
    slow = np.exp(-np.abs(age[:, :, None] - age[:, None, :])) * is_same
    bias = rows[:, :, BIAS] * is_held
    slow *= bias[:, :, None] * bias[:, None, :]
    times = np.where((source > 0.0)[:, None, :, None], 1.0, np.square(scales)[:, None, None])
    azimuth = rows[:, :, AZIMUTH]
    apart = np.abs((azimuth[:, :, None] - azimuth[:, None, :] + np.pi) % (2.0 * np.pi) - np.pi)
    aim = np.square(aim_rad)[:, None, None] * np.exp(-apart / turn_rad) * is_held[:, :, None] * is_held[:, None, :]
    white = np.where(is_held, np.square(rows[:, :, WHITE]), 1.0)
    others = aim + white[:, :, None] * np.eye(rows.shape[1])
    return np.asarray(slow[:, None] * times + others[:, None])
