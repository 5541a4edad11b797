"""How slow errors of a heading change as the craft turns, and what that can have moved a target by.

Iron that turns with the craft makes its compass err by a sinusoid of the heading, and levels that are off by an angle
are off to other sides once it has turned. So slow errors are forgotten in turns as well as in time. That is not enough
where a craft comes back to its headings: around a target the sinusoid looks like one that stands elsewhere, by its
amplitude times the range, however often it goes round; in a loiter of radius c beside a target at r by r^2 / c, along
the line of sight. On straight flights it is constant, and the filter knows of that.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from distloc.types import CameraPose, FloatArray, PoseErrors

_SMOOTH_S = 5.0  # a craft that rocks does not turn
_SHARE = 0.5**0.5  # of the heading's slow error: half of its variance changes with the heading
_MOST_VIEWS = 64
_TURNED_RAD = float(np.radians(30.0))  # less is a camera that rocks, or one that is steered a little


class HeadingOrAzimuth:
    """A pose's heading; where nobody gives one, the camera's azimuth once that has turned by over 30 degrees.

    Who gives poses without headings may still fly round a target with a compass: to take its error as constant then
    makes the ellipse too small, to take it as one that turns with a gimbal at worst too large. The localizer has one.
    """

    def __init__(self) -> None:
        self._azimuth_rad: float | None = None
        self._turned_rad = self._least_rad = self._most_rad = 0.0  # about up, since the first pose

    def take(self, pose: CameraPose) -> CameraPose:
        """The pose with that heading, or as it is."""
        if pose.heading_rad is not None:
            return pose
        azimuth_rad = camera_azimuth_rad(pose.R_cam_from_enu)
        if self._azimuth_rad is not None:
            self._turned_rad += (azimuth_rad - self._azimuth_rad + np.pi) % (2.0 * np.pi) - np.pi
        self._azimuth_rad = azimuth_rad
        self._least_rad = min(self._least_rad, self._turned_rad)
        self._most_rad = max(self._most_rad, self._turned_rad)
        if self._most_rad - self._least_rad <= _TURNED_RAD:
            return pose
        return replace(pose, heading_rad=azimuth_rad)


def camera_azimuth_rad(R_cam_from_enu: FloatArray) -> float:
    """Where a camera (3, 3) looks, clockwise from north; the further down or up, the more the image's top counts.

    With the horizon level both have one azimuth, and so it is known straight down as well.
    """
    forward_enu, top_enu = R_cam_from_enu[2], -R_cam_from_enu[1]
    east, north, _ = forward_enu - forward_enu[2] * top_enu
    return float(np.arctan2(east, north))


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
        turns_hz = abs(self._rate_rps) / errors.bias_turn_rad
        if turns_hz == 0.0:
            return errors
        return replace(errors, bias_time_constant_s=1.0 / (1.0 / errors.bias_time_constant_s + turns_hz))


class Views:
    """From where, and with which headings, a target was seen: at most 64 views, spread evenly over all sightings.

    A track has one for each platform. `rows` (k, 4), the first `count` of those `held`, each for `stride` sightings,
    are the craft's place east and north in metres, its heading, and one standard
    deviation of what it errs by that changes with the heading, in radians: none where the scenery measured it.
    """

    def __init__(self, rows: FloatArray | None = None) -> None:
        self.held = np.zeros((_MOST_VIEWS, 4))
        self.count, self.stride, self._skipped = 0, 1, 0
        if rows is not None:
            self.count = min(len(rows), _MOST_VIEWS)
            self.held[: self.count] = rows[-_MOST_VIEWS:]

    @property
    def rows(self) -> FloatArray:
        """A copy of the views."""
        return self.held[: self.count].copy()

    def add(self, pose: CameraPose, errors: PoseErrors) -> None:
        """A sighting; nothing for a pose without a heading, and where no error changes with it."""
        if pose.heading_rad is None or not np.isfinite(errors.bias_turn_rad):
            return
        self._skipped += 1
        if self._skipped < self.stride:
            return
        self._skipped = 0
        if self.count == _MOST_VIEWS:  # from now on every other as often
            self.held[: _MOST_VIEWS // 2] = self.held[::2].copy()
            self.count, self.stride = _MOST_VIEWS // 2, 2 * self.stride
        east_m, north_m = pose.position_enu_m[:2]
        self.held[self.count] = east_m, north_m, pose.heading_rad, turning_sigma_rad(pose, errors)
        self.count += 1

    def with_more(self, rows: FloatArray, counts: FloatArray) -> "Views":
        """The same and views (k, 4) more, each of so many sightings (k,)."""
        times = np.maximum(np.rint(counts / self.stride), 0.0).astype(np.intp)
        both, stride = np.concatenate([self.rows, np.repeat(rows, times, axis=0)]), self.stride
        while len(both) > _MOST_VIEWS:
            both, stride = both[::2], 2 * stride
        views = Views(both)
        views.stride = stride
        return views

    def covariance_m2(self, target_enu_m: FloatArray, errors: PoseErrors) -> FloatArray:
        """Of the error on the map (2, 2) that a sinusoid of the heading makes at about a place (3,)."""
        return np.asarray(covariances_m2([[self]], target_enu_m[None], errors)[0])


def turning_sigma_rad(pose: CameraPose, errors: PoseErrors) -> float:
    """One standard deviation of what the heading errs by that changes with it: none where the scenery measured it."""
    is_measured = pose.attitude is not None and pose.attitude.source == "scenery"
    return 0.0 if is_measured else _SHARE * errors.heading_bias_rad


class ViewsByPlatform:
    """The views of each platform that saw a target: what changes with the heading is each craft's own."""

    def __init__(self, rows: FloatArray | None = None, platform: str = "") -> None:
        self._last = Views(rows)  # of the platform that saw it last
        self._views = {platform: self._last} if self._last.count else {}

    @property
    def rows(self) -> FloatArray:
        """A copy of the views of the platform that saw it last."""
        return self._last.rows

    @property
    def all(self) -> list[Views]:
        """Those of each platform."""
        return list(self._views.values())

    def add(self, pose: CameraPose, errors: PoseErrors) -> None:
        """A sighting."""
        if pose.platform not in self._views:
            self._views[pose.platform] = Views()
        self._last = self._views[pose.platform]
        self._last.add(pose, errors)


def covariances_m2(views: Sequence[Sequence[Views]], targets_enu_m: FloatArray, errors: PoseErrors) -> FloatArray:
    """Of the errors on the map (k, 2, 2) that a sinusoid of the heading makes at about k targets' places (k, 3).

    A target has the views of each platform that saw it, and each platform a sinusoid of its own.

    To the first order: the least squares of all bearings, with an error that stays as a third unknown, solved for
    the sinusoid's cosine and sine parts (a "consider" covariance, Schmidt 1966).
    """
    found = np.zeros((len(views), 2, 2))
    of = [index for index, some in enumerate(views) for one in some if one.count >= 2]
    if not of:
        return found
    all_views = [one for some in views for one in some if one.count >= 2]
    normal, before, by_sinusoid = _equations(all_views, targets_enu_m[of], errors)
    if len(set(of)) == len(of):
        moved = np.linalg.solve(normal + before, by_sinusoid)[:, :2]
        found[of] = moved @ moved.swapaxes(1, 2)
        return found
    # what stays is another for each platform: solved for, then all platforms' bearings tell of one place
    share = (normal + before)[:, :2, 2:] / (normal + before)[:, 2:, 2:]
    told = normal[:, :2, :2] - share @ normal[:, 2:, :2]
    by_sinusoid = by_sinusoid[:, :2] - share @ by_sinusoid[:, 2:]
    of_all = np.zeros((len(views), 2, 2))
    np.add.at(of_all, of, told)
    farthest = np.full((len(views), 2, 2), np.inf)
    np.minimum.at(farthest, of, before[:, :2, :2])
    moved = np.linalg.solve((of_all + farthest)[of], by_sinusoid)
    np.add.at(found, of, moved @ moved.swapaxes(1, 2))
    return found


def _equations(
    views: Sequence[Views], targets_enu_m: FloatArray, errors: PoseErrors
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """The least squares of each one's bearings of a target (k, 3), for its place and the error that stays.

    The normal equations' matrix (k, 3, 3), what is known before (k, 3, 3), and what a sinusoid adds (k, 3, 2).
    """
    rows = np.array([one.held for one in views])  # (k, 64, 4)
    counts = np.array([one.count for one in views])
    is_held = np.arange(_MOST_VIEWS) < counts[:, None]
    lines_m = targets_enu_m[:, None, :2] - rows[:, :, :2]
    squared_m2 = np.maximum(np.square(lines_m).sum(axis=2), 1.0)
    east, north = lines_m[:, :, 0], lines_m[:, :, 1]
    by_autopilot = rows[:, :, 3] > 0.0
    # where the scenery measured any, today's is the scenery's
    is_mixed = (is_held & ~by_autopilot).any(axis=1, keepdims=True)
    sigma_rad = np.where(is_mixed & by_autopilot, rows[:, :, 3] / _SHARE, errors.heading_bias_rad)
    strides = np.array([[one.stride] for one in views])
    told = is_held * strides / np.maximum(sigma_rad, 1e-4) ** 2  # by each view: what stays is forgotten in turns
    # the error that stays is the autopilot's alone
    by_all = np.stack([north / squared_m2, -east / squared_m2, by_autopilot], axis=2)
    by_sinusoid = rows[:, :, 3:] * np.stack([np.cos(rows[:, :, 2]), np.sin(rows[:, :, 2])], axis=2)
    before = np.zeros((len(views), 3, 3))  # as far as the range; nothing of what stays
    before[:, [0, 1], [0, 1]] = (counts / (squared_m2 * is_held).sum(axis=1))[:, None]
    before[:, 2, 2] = 1e-6
    weighed = (by_all * told[:, :, None]).swapaxes(1, 2)
    return weighed @ by_all, before, weighed @ by_sinusoid
