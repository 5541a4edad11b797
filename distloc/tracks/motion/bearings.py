"""From where and in which directions a target was seen, evenly over all its sightings; its track has one."""

import math
import zlib

import numpy as np

from distloc.sights.sights import Ray
from distloc.types import BoolArray, FloatArray, PoseErrors

MOST, ENOUGH = 32, 6  # held; to judge by
_ANOTHER = 10.0  # times that an error has forgotten itself: nothing of it is left
_RISES, _FALLS = 0.05, 0.2  # of how much higher or lower than mostly the foot is seen, what a sighting teaches
_ADRIFT, _LEVELS = 0.5, 3.0  # of its root's width; of one frame's error of the attitude
_JUMPS, _SOON = -0.25, 0.05  # a correlation: half-way between -0.5 and 0; a share of what the slow error lasts
COLUMNS = 8
TIME, EAST, NORTH, AZIMUTH, WHITE, BIAS, AGE, SOURCE = range(COLUMNS)


class _Slow:
    """A platform's slow error: how often it has forgotten itself by a time; its sightings since one was held.

    And `foot`, as a tangent over the level, how high it mostly sees where the smoke begins, from its last place (3,).
    """

    def __init__(self, stamp_s: float, age: float = 0.0) -> None:
        self.stamp_s, self.age, self.skipped = stamp_s, age, 0
        self.foot, self._camera_enu_m = math.nan, np.zeros(3)

    def is_adrift(self, ray: Ray, errors: PoseErrors, target_enu_m: FloatArray) -> bool:
        """Whether the foot is half its root's width higher than mostly, and than tilts explain.

        A puff has then left the fire and goes with the wind; where the foot is lower it is the fire's.
        """
        before_m, camera_enu_m = self._camera_enu_m, ray.pose.position_enu_m
        self._camera_enu_m = camera_enu_m
        if math.isnan(self.foot):
            self.foot = ray.foot_tangent
            return False
        was_m, is_m = (max(math.dist(target_enu_m[:2], at_m[:2]), 1.0) for at_m in (before_m, camera_enu_m))
        self.foot = (self.foot * was_m + float(before_m[2] - camera_enu_m[2])) / is_m
        rise = ray.foot_tangent - self.foot
        self.foot += (_RISES if rise > 0.0 else _FALLS) * rise
        least = math.hypot(errors.tilt_bias_rad, _LEVELS * errors.attitude_white_rad)
        return rise > max(_ADRIFT * float(ray.aim_px[0]) * ray.px_rad, least)


class Bearings:
    """At most `MOST` rows, the first `count` of those `held`.

    They are the time, the camera's place east and north, the azimuth, one standard deviation of the frame's own error
    and of the slow one, how often the slow one has forgotten itself by then, and whose that is: twice the platform's
    number, and 1 more where the scenery measured it.
    """

    def __init__(self, rows: FloatArray | None = None) -> None:
        self.held = np.zeros((MOST, COLUMNS))
        self.count, self._stride = 0, 1
        self._slow: dict[int, _Slow] = {}  # by the platform's number
        if rows is not None and len(rows) > 0:
            self.count = min(len(rows), MOST)
            self.held[: self.count] = rows[-self.count :]
            for one in rows:
                slow = self._slow.setdefault(int(one[SOURCE]) // 2, _Slow(0.0))
                slow.stamp_s, slow.age = float(one[TIME]), max(slow.age, float(one[AGE]))

    @property
    def rows(self) -> FloatArray:
        """A copy of those held."""
        return self.held[: self.count].copy()

    def jumped(self, by_rad: float, platform: str) -> None:
        """Its reported azimuths, and so what they err by, are others from now on, by an angle clockwise from above.

        What the scenery measured is not what was reported.
        """
        rows = self.held[: self.count]
        rows[rows[:, SOURCE] == 2 * _number(platform), AZIMUTH] += by_rad

    def forget_error(self, platform: str) -> None:
        """From now on its autopilot's slow error is another; the scenery's stays what it is."""
        number, rows = _number(platform), self.held[: self.count]
        slow = self._slow.get(number)
        if slow is not None:
            slow.age += _ANOTHER
            slow.foot = math.nan  # its tilts are others, too
            rows[rows[:, SOURCE] == 2 * number + 1, AGE] += _ANOTHER

    def add(self, ray: Ray, errors: PoseErrors, white_rad: float, target_enu_m: FloatArray) -> bool:
        """A sighting of a target that is about there (3,), whose azimuth errs by `white_rad` in this frame alone.

        Whether it is held: one of a puff that has left the fire is not, where there are enough without it.
        """
        pose, number = ray.pose, _number(ray.pose.platform)
        slow = self._slow.setdefault(number, _Slow(pose.stamp_s))
        slow.age += max(pose.stamp_s - slow.stamp_s, 0.0) / errors.bias_time_constant_s
        slow.stamp_s = pose.stamp_s
        is_told = ray.detection.root is not None and not ray.is_cut[1]
        if is_told and slow.is_adrift(ray, errors, target_enu_m) and self.count >= ENOUGH:
            return False
        slow.skipped += 1
        if slow.skipped < self._stride:
            return False
        slow.skipped = 0
        if self.count == MOST:
            self._thin()
        east_m, north_m, _ = pose.position_enu_m.tolist()
        along_east, along_north, _ = ray.axes[2].tolist()
        told_rad = errors.heading_bias_rad / errors.heading_scale
        source = 2 * number + (pose.attitude is not None and pose.attitude.source == "scenery")
        azimuth_rad = math.atan2(along_east, along_north)
        row = (pose.stamp_s, east_m, north_m, azimuth_rad, white_rad, told_rad, slow.age, source)
        self.held[self.count] = row
        self.count += 1
        return True

    def _thin(self) -> None:
        """Keep every other one of each platform's, which look in turns; from now on every other as often."""
        whose = self.held[:, SOURCE] // 2
        kept = np.sort(np.concatenate([np.flatnonzero(whose == one)[::2] for one in set(whose.tolist())]))
        self.held[: kept.size] = self.held[kept]
        self.count, self._stride = kept.size, 2 * self._stride


def _number(platform: str) -> int:
    """The same wherever and whenever it is asked, and another for each name: a snapshot's bearings go on with it."""
    return zlib.crc32(platform.encode())


def jumps_rad2(rows: FloatArray, is_held: BoolArray, place_m: FloatArray) -> FloatArray:
    """The variances (k,) by which bearings of rows (k, m, 8) jump about, seen of targets at about (k, 2).

    By the covariance of one change with the next: of what is each frame's own that is minus its variance, minus half
    the changes' own, and of what wanders, as a compass does, 0. Nearer to this it says nothing, nor where they are so
    seldom that a compass changes as much.
    """
    offset_m = place_m[:, None] - rows[:, :, [EAST, NORTH]]
    off = (rows[:, :, AZIMUTH] - np.arctan2(offset_m[..., 0], offset_m[..., 1]) + np.pi) % (2.0 * np.pi) - np.pi
    is_next = is_held[:, 1:] & (rows[:, 1:, SOURCE] == rows[:, :-1, SOURCE])
    is_next &= np.diff(rows[:, :, AGE], axis=1) < _SOON
    change = np.diff(off, axis=1) * is_next
    is_pair = is_next[:, 1:] & is_next[:, :-1]
    before, after = change[:, :-1] * is_pair, change[:, 1:] * is_pair
    own, mutual = (np.square(before) + np.square(after)).sum(axis=1) / 2.0, (before * after).sum(axis=1)
    return np.where(mutual < _JUMPS * own, -mutual / np.maximum(is_pair.sum(axis=1), 1), 0.0)


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
    is_scenery = source % 2.0 == 1.0
    times = np.where(is_scenery[:, None, :, None], 1.0, np.square(scales)[:, None, None])
    azimuth = rows[:, :, AZIMUTH]
    apart = np.abs((azimuth[:, :, None] - azimuth[:, None, :] + np.pi) % (2.0 * np.pi) - np.pi)
    aim = np.square(aim_rad)[:, None, None] * np.exp(-apart / turn_rad) * is_held[:, :, None] * is_held[:, None, :]
    white = np.where(is_held, np.square(rows[:, :, WHITE]), 1.0)
    others = aim + white[:, :, None] * np.eye(rows.shape[1])
    return np.asarray(slow[:, None] * times + others[:, None])
