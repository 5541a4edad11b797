"""How large a target's ellipse will be after a way: a Kalman filter over the sights to expect, without their values.

Where the target truly is decides how much a sight tells, so it is foretold for each of the ranges that the target may
be at, all ways and ranges at once. The state is that of an `Outlook`: the range's logarithm, two tangents, the
attitude's slow error and the aim's. The slow error is forgotten in time and in turns, or as the scenery measures it.
"""

import numpy as np

from distloc.advice.ways import STOPS, Craft, Ways
from distloc.filter.turning import covariances_m2
from distloc.filter.uncertainty import CHI2_95
from distloc.tracks.estimates.outlook import Outlook
from distloc.types import AttitudeError, BoolArray, CameraPose, FloatArray

_AIM_TURN_RAD = 0.1  # by which a view must turn for another error of the aim: distloc/sights/aspect.py
_STEP_M, _STEP_S = 10.0, 1.0  # between the filter's sights, whichever comes first
_LEAST_RANGE_M = 30.0


def half_lengths_m(outlook: Outlook, ways: Ways, craft: Craft) -> FloatArray:
    """Of the 95 % ellipse after each of n ways, if the target is at each of the outlook's ranges: (n, 5)."""
    run = _Run(outlook, ways, craft)
    for stop in range(STOPS):
        run.fly(stop)
    run.look()
    return run.half_lengths_m()


class _Run:
    """n ways times m ranges, the state's covariance of each (n, m, 8, 8)."""

    def __init__(self, outlook: Outlook, ways: Ways, craft: Craft) -> None:
        self._outlook, self._ways, self._craft = outlook, ways, craft
        n, m = len(ways), len(outlook.ranges_m)
        along, right, up = outlook.axes[2], outlook.axes[0], outlook.axes[1]
        ranges_m = outlook.ranges_m
        self._points_m = ranges_m[:, None] * along  # (m, 3) from the camera as it is now
        self._by_state = ranges_m[:, None, None] * np.stack([along, right, up], axis=1)  # (m, 3, 3)
        self._P = np.broadcast_to(outlook.covariance, (n, m, 8, 8)).copy()
        self._at_m = np.zeros((n, 3))
        heading = outlook.pose.heading_rad
        self._heading = np.full(n, _azimuth(along) if heading is None else heading)
        self._towards = np.broadcast_to(along, (n, m, 3)).copy()
        self._leg_s = ways.length_m / STOPS / craft.speed_mps
        self._seen_from: list[tuple[FloatArray, FloatArray, BoolArray]] = []

    def fly(self, stop: int) -> None:
        """To a stop, the sights on the way taken as if all were from there."""
        self._at_m[:, :2] = self._ways.places_m[:, stop]
        course = self._ways.courses_rad[:, stop]
        nose = course if self._craft.has_gimbal or not self._craft.keeps_target else self._bearing()
        self._forget(self._leg_s, nose)
        is_seen = np.ones(self._P.shape[:2], np.bool_)
        if not self._craft.keeps_target:
            off = self._bearings() - nose[:, None] - self._craft.camera_yaw_rad
            is_seen = np.abs((off + np.pi) % (2.0 * np.pi) - np.pi) < self._craft.half_view_rad
        flown_m = self._ways.length_m / STOPS
        self._see(np.maximum(flown_m / _STEP_M, self._leg_s / _STEP_S), is_seen)

    def look(self) -> None:
        """At the end, where the nose was along the way: the craft turns to the target."""
        if self._craft.keeps_target or self._craft.look_s <= 0.0:
            return
        n = len(self._ways)
        self._forget(np.full(n, self._craft.look_s), self._bearing() - self._craft.camera_yaw_rad)
        self._see(np.full(n, self._craft.look_s / _STEP_S), np.ones(self._P.shape[:2], np.bool_))

    def half_lengths_m(self) -> FloatArray:
        """(n, m)."""
        D = self._by_state[:, :, :2].swapaxes(1, 2)  # east and north by the state
        map_m2 = D @ self._P[:, :, :3, :3] @ D.swapaxes(1, 2) + self._outlook.also_m2 + self._turning_m2()[:, None]
        return np.asarray(np.sqrt(CHI2_95 * np.linalg.eigvalsh(map_m2)[:, :, 1]))

    def _turning_m2(self) -> FloatArray:
        """What errors that turn with the heading make of it (n, 2, 2), by the views so far and those to come."""
        outlook, middle = self._outlook, len(self._outlook.ranges_m) // 2
        if not np.isfinite(outlook.errors.bias_turn_rad) or outlook.pose.heading_rad is None:
            return np.zeros((len(self._ways), 2, 2))
        start_m, all_views = outlook.pose.position_enu_m, []
        for i in range(len(self._ways)):
            views = outlook.views.copy()
            for at_m, heading, is_seen in self._seen_from:
                if is_seen[i]:
                    place_m = start_m + at_m[i]
                    views.add(
                        CameraPose(0.0, place_m, np.eye(3), None, float(heading[i]), _attitude(outlook)), outlook.errors
                    )
            all_views.append([views])
        target_m = np.tile(start_m + self._points_m[middle], (len(self._ways), 1))
        return covariances_m2(all_views, target_m, outlook.errors)

    def _bearings(self) -> FloatArray:
        """Of the targets (n, m), clockwise from north."""
        offset_m = self._points_m[None] - self._at_m[:, None]
        return np.asarray(np.arctan2(offset_m[:, :, 0], offset_m[:, :, 1]))

    def _bearing(self) -> FloatArray:
        """Of the likeliest (n,)."""
        return np.asarray(self._bearings()[:, len(self._outlook.ranges_m) // 2])

    def _forget(self, elapsed_s: FloatArray, heading: FloatArray) -> None:
        """So many seconds (n,) pass and the craft turns to headings (n,); seen from elsewhere the aim errs anew."""
        turned = np.abs((heading - self._heading + np.pi) % (2.0 * np.pi) - np.pi)
        self._heading = heading
        kept, new = self._kept(elapsed_s, turned)
        P = self._P
        P[:, :, 3:6] = kept[:, None] @ P[:, :, 3:6]
        P[:, :, :, 3:6] = P[:, :, :, 3:6] @ kept[:, None].swapaxes(2, 3)
        P[:, :, 3:6, 3:6] += new[:, None]
        offset_m = self._points_m[None] - self._at_m[:, None]
        towards = offset_m / np.maximum(np.linalg.norm(offset_m, axis=2, keepdims=True), _LEAST_RANGE_M)
        angle = np.arccos(np.clip(np.einsum("nmi,nmi->nm", towards, self._towards), -1.0, 1.0))
        self._towards = towards
        share = np.exp(-angle / _AIM_TURN_RAD)
        P[:, :, 6:] *= share[:, :, None, None]
        P[:, :, :, 6:] *= share[:, :, None, None]
        fresh = 1.0 - np.square(share)
        for axis in range(2):
            P[:, :, 6 + axis, 6 + axis] += fresh * self._outlook.aim_sigma_rad[axis] ** 2

    def _kept(self, elapsed_s: FloatArray, turned: FloatArray) -> tuple[FloatArray, FloatArray]:
        """What the attitude's slow error keeps (n, 3, 3) and what is new of it (n, 3, 3)."""
        attitude, errors = _attitude(self._outlook), self._outlook.errors
        if attitude is not None and attitude.source == "scenery":
            steps = np.maximum(elapsed_s * np.maximum(1.0 / _STEP_S, self._craft.speed_mps / _STEP_M), 1.0)
            return _of_scenery(attitude, round(float(steps.mean())), len(elapsed_s))
        share = np.exp(-elapsed_s / errors.bias_time_constant_s - turned / errors.bias_turn_rad)
        kept = share[:, None, None] * np.eye(3)
        return kept, (1.0 - np.square(share))[:, None, None] * errors.bias_variance

    def _see(self, count: FloatArray, is_seen: BoolArray) -> None:
        """So many sights (n,) from where the craft is, of the targets (n, m) that are seen."""
        offset_m = self._points_m[None] - self._at_m[:, None]
        range_m = np.maximum(np.linalg.norm(offset_m, axis=2), _LEAST_RANGE_M)
        along = offset_m / range_m[:, :, None]
        right = np.cross(along, [0.0, 0.0, 1.0])
        right /= np.maximum(np.linalg.norm(right, axis=2, keepdims=True), 1e-6)
        up = np.cross(right, along)
        axes = np.stack([right, up], axis=2)  # (n, m, 2, 3)
        G = np.zeros((*range_m.shape, 2, 8))
        G[..., :3] = axes / range_m[:, :, None, None] @ self._by_state.swapaxes(1, 2)
        G[..., 0, 3:6], G[..., 1, 3:6] = -up, right
        G[..., 0, 6] = G[..., 1, 7] = -1.0
        white = self._outlook.white_rad2 / np.maximum(count, 1.0)[:, None, None]
        P = self._P
        S = G @ P @ G.swapaxes(2, 3) + white[:, None]
        gain = P @ G.swapaxes(2, 3) @ np.linalg.inv(S)
        gain *= is_seen[:, :, None, None]
        P -= gain @ G @ P
        self._P = 0.5 * (P + P.swapaxes(2, 3))
        self._seen_from.append((self._at_m.copy(), self._heading.copy(), is_seen[:, len(self._points_m) // 2]))


def _azimuth(direction: FloatArray) -> float:
    return float(np.arctan2(direction[0], direction[1]))


def _attitude(outlook: Outlook) -> AttitudeError | None:
    return outlook.pose.attitude


def _of_scenery(attitude: AttitudeError, steps: int, n: int) -> tuple[FloatArray, FloatArray]:
    """The scenery's error over so many keyframes, as it kept itself at the last one; at most as large as it is."""
    kept, new = np.eye(3), np.zeros((3, 3))
    for _ in range(steps):
        kept, new = attitude.kept @ kept, attitude.kept @ new @ attitude.kept.T + attitude.new
    return np.broadcast_to(kept, (n, 3, 3)), np.broadcast_to(new, (n, 3, 3))
