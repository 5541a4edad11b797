"""How large a target's ellipse will be after a way: a Kalman filter over the sights to expect, without their values.

Where the target truly is decides how much a sight tells, so it is foretold for each of the ranges that the target may
be at, all ways and ranges at once. The state is that of an `Outlook`: the range's logarithm, two tangents, the
attitude's slow error and the aim's. The slow error is forgotten in time and in turns, or as the scenery measures it.
"""

import numpy as np

from distloc.advice.ways import STOPS, Craft, Ways
from distloc.filter.turning import covariances_m2, turning_sigma_rad
from distloc.filter.uncertainty import CHI2_95
from distloc.tracks.estimates.outlook import Outlook
from distloc.types import AttitudeError, BoolArray, FloatArray

_AIM_TURN_RAD = 0.1  # by which a view must turn for another error of the aim: distloc/sights/aspect.py
_STEP_M, _STEP_S = 10.0, 1.0  # between the filter's sights, whichever comes first
_LEAST_RANGE_M = 30.0
_ROUGHER = 1.05  # the particles' ellipse than this one: of 72 flights, seeds 0 to 71
_SETTLES = 0.75  # the power of the sights so far over those then by which the scenery's errors fall
_SETTLED_RAD = float(np.radians(0.12))


def half_lengths_m(outlook: Outlook, ways: Ways, craft: Craft) -> FloatArray:
    """Of the 95 % ellipse after each of n ways, if the target is at each of the outlook's ranges: (n, 5)."""
    run = _Run(outlook, ways, craft)
    for stop in range(STOPS):
        run.fly(stop)
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
        self._flown_steps = np.zeros(n)
        self._range_m, self._larger = ranges_m, np.ones((n, m))
        self._leg_s = ways.length_m / STOPS / craft.speed_mps
        self._seen: list[tuple[FloatArray, FloatArray, FloatArray]] = []  # from where, headings, how many sights

    def fly(self, stop: int) -> None:
        """To a stop, the sights on the way taken as if all were from there."""
        self._at_m[:, :2] = self._ways.places_m[:, stop]
        course = self._ways.courses_rad[:, stop]
        self._forget(self._leg_s, course if self._craft.is_nose_along else self._bearing() - self._craft.camera_yaw_rad)
        is_seen = np.ones(self._P.shape[:2], np.bool_)
        if not self._craft.keeps_target:
            is_seen = self._craft.sees(self._bearings() - course[:, None])
        flown_m = self._ways.length_m / STOPS
        self._see(np.maximum(flown_m / _STEP_M, self._leg_s / _STEP_S), is_seen)

    def half_lengths_m(self) -> FloatArray:
        """(n, m)."""
        D = self._by_state[:, :, :2].swapaxes(1, 2)  # east and north by the state
        map_m2 = D @ self._P[:, :, :3, :3] @ D.swapaxes(1, 2) + self._also_m2() + self._turning_m2()[:, None]
        return np.asarray(_ROUGHER * np.sqrt(CHI2_95 * np.linalg.eigvalsh(map_m2)[:, :, 1]))

    def _also_m2(self) -> FloatArray:
        """What the ellipse has beside (n, m, 2, 2): the craft's place, and the lens, which the scenery measures."""
        outlook = self._outlook
        now_m, then_m = self._points_m[None, :, :2], (self._points_m[None] - self._at_m[:, None])[:, :, :2]
        focal_m2 = outlook.errors.focal_sigma**2
        fixed_m2 = (
            outlook.also_m2
            - focal_m2 * now_m[:, len(self._range_m) // 2, :, None] * now_m[:, len(self._range_m) // 2, None]
        )
        lens_m2 = focal_m2 * np.square(self._surer())[:, None, None, None] * then_m[..., None] * then_m[..., None, :]
        return np.asarray(np.maximum(np.trace(fixed_m2[0]) / 2.0, 0.0) * np.eye(2) + lens_m2)

    def _turning_m2(self) -> FloatArray:
        """What errors that turn with the heading make of it (n, 2, 2), by the views so far and those to come."""
        outlook, middle = self._outlook, len(self._outlook.ranges_m) // 2
        if not np.isfinite(outlook.errors.bias_turn_rad) or outlook.pose.heading_rad is None:
            return np.zeros((len(self._ways), 2, 2))
        start_m = outlook.pose.position_enu_m
        at_m, headings, counts = (np.stack([one[part] for one in self._seen], axis=1) for part in range(3))
        rows = np.zeros((*headings.shape, 4))  # (n, stops, 4)
        rows[:, :, :2], rows[:, :, 2] = start_m[:2] + at_m[:, :, :2], headings
        rows[:, :, 3] = turning_sigma_rad(outlook.pose, outlook.errors)
        all_views = [[outlook.views.with_more(*one)] for one in zip(rows, counts, strict=True)]
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
        kept = np.exp(-angle / _AIM_TURN_RAD)
        # what looks twice as large is aimed at four times as badly: `aim_sigma_rad` of distloc/sights/aspect.py
        larger = np.square(self._range_m / np.maximum(np.linalg.norm(offset_m, axis=2), _LEAST_RANGE_M))
        grown = kept * larger / self._larger
        self._larger = larger
        P[:, :, 6:] *= grown[:, :, None, None]
        P[:, :, :, 6:] *= grown[:, :, None, None]
        fresh = (1.0 - np.square(kept)) * np.square(larger)
        for axis in range(2):
            P[:, :, 6 + axis, 6 + axis] += fresh * self._outlook.aim_sigma_rad[axis] ** 2

    def _kept(self, elapsed_s: FloatArray, turned: FloatArray) -> tuple[FloatArray, FloatArray]:
        """What the attitude's slow error keeps (n, 3, 3) and what is new of it (n, 3, 3)."""
        attitude, errors = self._outlook.pose.attitude, self._outlook.errors
        if attitude is not None and attitude.source == "scenery":
            return self._kept_by_scenery(attitude, elapsed_s)
        share = np.exp(-elapsed_s / errors.bias_time_constant_s - turned / errors.bias_turn_rad)
        kept = share[:, None, None] * np.eye(3)
        return kept, (1.0 - np.square(share))[:, None, None] * errors.bias_variance

    def _kept_by_scenery(self, attitude: AttitudeError, elapsed_s: FloatArray) -> tuple[FloatArray, FloatArray]:
        """The same where the scenery measures the attitude: surer with every keyframe, until its window is full."""
        before, steps = self._surer(), self._steps(elapsed_s)
        self._flown_steps = self._flown_steps + steps
        after = self._surer()
        share = float(np.clip(np.trace(attitude.kept) / 3.0, 0.0, 1.0)) ** steps
        kept = (share * after / before)[:, None, None] * np.eye(3)
        return kept, ((1.0 - np.square(share)) * np.square(after))[:, None, None] * attitude.covariance

    def _steps(self, elapsed_s: FloatArray) -> FloatArray:
        return elapsed_s * max(1.0 / _STEP_S, self._craft.speed_mps / _STEP_M)

    def _surer(self) -> FloatArray:
        """By what the scenery's errors are smaller (n,) than now: `_SETTLES` is how they were in simulated flights."""
        attitude, so_far = self._outlook.pose.attitude, max(self._outlook.sightings, 10)
        if attitude is None or attitude.source != "scenery":
            return np.ones(len(self._ways))
        least = min(_SETTLED_RAD / max(float(np.sqrt(np.trace(attitude.covariance) / 3.0)), 1e-6), 1.0)
        return np.asarray(np.maximum((so_far / (so_far + self._flown_steps)) ** _SETTLES, least))

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
        shown = count * is_seen[:, len(self._points_m) // 2]
        self._seen.append((self._at_m.copy(), self._heading.copy(), shown))


def _azimuth(direction: FloatArray) -> float:
    return float(np.arctan2(direction[0], direction[1]))
