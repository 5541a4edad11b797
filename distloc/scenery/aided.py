"""The compass' window with landmarks of known place as well, once they agree with what the corners alone say.

The compass has one and asks it at each keyframe. Corners alone have a window of their own, that no landmark touches:
by it each sighting is judged, so a wrong place or a wrong match is found out, and then what it told is let go at once.
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from distloc.geometry.rotations import matrix_from_rotation_vector
from distloc.scenery.landmarks import Seen
from distloc.scenery.window import Window
from distloc.types import BoolArray, CameraPose, FloatArray

_AGREES = 6.0  # squared distance of two components: 95 % of good ones
_CONTRADICTS = 13.8  # 0.1 % of good ones
_LEAST_AGREEING = 8  # keyframes in a row, until one counts
_MOST_CONTRADICTING = 3  # in a row
_MOST_AGREEING = 80  # that is asked of one which was wrong again and again
_TELLING_RAD = float(np.radians(0.5))  # what the azimuth must be known to, to judge a landmark by it,
_TELLING = 4.0  # or by how many sigmas of the landmark's place
_BEYOND = 11.3  # squared distance of three components: 1 % of good answers
_SUREST = 0.5  # of the corners' sigma and of what they differ by, however well a landmark fits
_USUAL = 2.0  # standard deviations that two answers may be apart, to be as sure as they seem


@dataclass(frozen=True, slots=True)
class Answer:
    """The attitude's error at the last keyframe, its covariance and that with the one before (3, 3), and by whom.

    `lens` and `lens_sigma` (2,) are the window's; `landmarks` are how many known places helped.
    """

    error_rad: FloatArray
    covariance: FloatArray
    with_last: FloatArray
    lens: FloatArray
    lens_sigma: FloatArray
    landmarks: int = 0


def answer_of(window: Window, covariance: FloatArray, landmarks: int = 0) -> Answer:
    """What a window says, with the `covariance` (6k, 6) that `solve` gave; larger where it fits badly."""
    covariance = covariance * window.doubt
    error_rad = window.x[window.count - 1, :3].copy()
    error_rad[2] = math.remainder(error_rad[2], 2.0 * math.pi)
    P = (covariance[-6:-3, :3] + covariance[-6:-3, :3].T) / 2.0
    return Answer(error_rad, P, covariance[-12:-9, :3].T, window.lens, window.lens_sigma, landmarks)


class Aided:
    """Known places with `sigma_m` (m, 3), one standard deviation of each; `is_trusted` (m,) those that count now.

    `agreed` and `misfits` (m,) count the keyframes in which each was seen where corners expect it, and was not;
    `contradicting` (m,) is in how many it was not since it last was.
    """

    def __init__(self, sigma_m: FloatArray) -> None:
        most = len(sigma_m)
        self.is_trusted: BoolArray = np.zeros(most, dtype=np.bool_)
        self.agreed, self.misfits = np.zeros(most, dtype=np.int64), np.zeros(most, dtype=np.int64)
        self._sigma_m = sigma_m.copy()
        self._window: Window | None = None
        self._agreeing, self.contradicting = np.zeros(most, dtype=np.int64), np.zeros(most, dtype=np.int64)
        self._needed = np.full(most, _LEAST_AGREEING)

    def reset(self) -> None:
        """The corners' window began anew: nothing is trusted before it agrees with that."""
        self._window = None
        self.is_trusted[:] = False
        self._agreeing[:], self.contradicting[:] = 0, 0

    def step(
        self,
        plain: Window,
        covariance: FloatArray,
        pose: CameraPose,
        corners: Seen,
        known: Seen,
        places_m: FloatArray,
    ) -> Answer | None:
        """What the corners and the trusted landmarks say together; None where that is what the corners say.

        `plain` has the keyframe and is solved, with this `covariance`; `known` are the sightings of the known places
        with the indices `known.names`, which are at (n, 3) in ENU.
        """
        if plain.count <= 1:
            self.reset()
        self._judge(plain, covariance, pose, known, places_m)
        if not self.is_trusted.any():
            self._window = None
            return None
        if self._window is None:
            self._window = plain.with_known(self._sigma_m)
        else:
            self._window.add(pose.position_enu_m, pose.R_cam_from_enu[2], plain.last_chain, corners)
        is_used = self.is_trusted[known.names]
        self._window.add_known(_picked(known, is_used), places_m[is_used])
        try:
            together = self._window.solve()
        except np.linalg.LinAlgError:
            self.reset()
            return None
        found = answer_of(self._window, together, int(is_used.sum()))
        return _believed(found, answer_of(plain, covariance))

    def _judge(
        self, plain: Window, covariance: FloatArray, pose: CameraPose, known: Seen, places_m: FloatArray
    ) -> None:
        """Whom to trust from now on."""
        P = covariance[-6:] * plain.doubt
        x, was_trusted = plain.x[plain.count - 1], self.is_trusted.copy()
        for i, which in enumerate(known.names):
            distance, is_telling = self._distance(x, P, pose, known, places_m, i)
            if distance > _CONTRADICTS:
                self.misfits[which] += 1
                self._agreeing[which] = 0
                self.contradicting[which] += 1
                if self.contradicting[which] >= _MOST_CONTRADICTING:
                    self.is_trusted[which] = False
                continue
            self.contradicting[which] = 0
            if distance > _AGREES or not is_telling:
                self._agreeing[which] = 0
                continue
            self.agreed[which] += 1
            self._agreeing[which] += 1
            self.is_trusted[which] |= self._agreeing[which] >= self._needed[which]
        is_wrong = was_trusted & ~self.is_trusted
        self._needed[is_wrong] = np.minimum(2 * self._needed[is_wrong], _MOST_AGREEING)
        if is_wrong.any():  # with all that it told
            self._window = None

    def _distance(
        self, x: FloatArray, P: FloatArray, pose: CameraPose, known: Seen, places_m: FloatArray, i: int
    ) -> tuple[float, bool]:
        """Squared, of a sighting from where the corners expect it, and whether these know that well enough to judge."""
        line_m = places_m[i] - pose.position_enu_m + x[3:]
        range_m = max(float(np.linalg.norm(line_m)), 1.0)
        ray = matrix_from_rotation_vector(x[:3]) @ line_m / range_m
        by_error = np.concatenate([-_cross(ray), (np.eye(3) - np.outer(ray, ray)) / range_m], axis=1)
        by_place = by_error[:, 3:] * self._sigma_m[known.names[i]]
        spread = by_error @ P @ by_error.T + by_place @ by_place.T
        F = known.whiten[i]
        off = F @ (ray / max(float(ray @ known.rays[i]), 1e-3))
        S = np.eye(2) + F @ spread @ F.T
        aside = np.array([ray[1], -ray[0], 0.0]) / max(float(np.hypot(ray[0], ray[1])), 1e-3)
        telling_rad = max(_TELLING_RAD, _TELLING * float(self._sigma_m[known.names[i], :2].max()) / range_m)
        return float(off @ np.linalg.solve(S, off)), bool(aside @ spread @ aside < telling_rad**2)


def _believed(found: Answer, plain: Answer) -> Answer | None:
    """An answer that is far from that of the corners alone may be of a landmark that is wrong: less sure, or none.

    What is found with more measurements differs from what is found with fewer by the difference of their variances
    (Hausman 1978). None where it is beyond what the corners alone leave open. A landmark that is off by less than
    those can tell is not found out: never surer than half of what they are.
    """
    apart = found.error_rad - plain.error_rad
    if apart @ np.linalg.solve(plain.covariance, apart) > _BEYOND:
        return None
    gained, variance = np.diag(plain.covariance - found.covariance), np.diag(found.covariance)
    least = np.square(apart) - _USUAL**2 * np.maximum(gained, 0.0)
    least = np.maximum(least, _SUREST**2 * np.maximum(np.diag(plain.covariance), np.square(apart)))
    return replace(found, covariance=found.covariance + np.diag(np.maximum(least - variance, 0.0)))


def _picked(seen: Seen, which: BoolArray) -> Seen:
    return Seen(seen.names[which], seen.rays[which], seen.whiten[which], seen.depth_m[which])


def _cross(v: FloatArray) -> FloatArray:
    return np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])
