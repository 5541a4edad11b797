"""What a frame's tracks tell of its attitude together, and what that says of each, by hand."""

import numpy as np
import pytest

from distloc.filter.bank import Fit
from distloc.filter.settings import LocalizerConfig
from distloc.tracks.assignment.shift import Pairs, carried, drift_of, judged
from distloc.types import CameraPose, FloatArray
from tests.support.cube_samples import R_NORTH

OWN_RAD, COMMON_RAD = 0.003, 0.03
COMMON = COMMON_RAD**2 * np.eye(2)
TO_RIGHT_AND_UP = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0]])  # of a level ray to the north, by the bias


def pairs_of(at_rad: FloatArray, segments_rad: FloatArray, own_rad: float = OWN_RAD) -> Pairs:
    """Tracks that are expected at (t,), each with all segments at (d,), right of the picture's middle."""
    track, ray = (one.ravel() for one in np.indices((at_rad.size, segments_rad.size)))
    innovation = np.stack([at_rad[track] - segments_rad[ray], np.zeros(track.size)], axis=1)
    covariance = np.tile(COMMON + own_rad**2 * np.eye(2), (track.size, 1, 1))
    squared = (np.square(innovation[:, :, None]) / covariance.diagonal(axis1=1, axis2=2)[:, :, None]).sum(axis=(1, 2))
    likely = -0.5 * (squared + np.log(np.linalg.det(2.0 * np.pi * covariance)))
    return Pairs(track, ray, Fit(likely, innovation, covariance, squared), likely)


def room(at_rad: FloatArray, half_rad: float = 1.0) -> FloatArray:
    """Of a picture that reaches so far to each side."""
    up = np.full(at_rad.size, half_rad)
    return np.stack([np.stack([at_rad + half_rad, up], axis=1), np.stack([half_rad - at_rad, up], axis=1)], axis=1)


def best_of(scores: FloatArray, pairs: Pairs) -> list[int]:
    """Each track's likeliest segment."""
    return [int(pairs.ray[pairs.track == one][scores[pairs.track == one].argmax()]) for one in np.unique(pairs.track)]


@pytest.mark.parametrize("shift_rad", [-0.04, -0.015, 0.015, 0.04])
def test_under_a_shift_of_more_than_their_distance_each_track_finds_its_own(shift_rad: float) -> None:
    at_rad = np.array([-0.05, -0.03, 0.0, 0.02, 0.055])
    pairs = pairs_of(at_rad, at_rad + shift_rad)
    told = judged(pairs, COMMON, room(at_rad))
    assert best_of(told.scores, pairs) == [0, 1, 2, 3, 4]
    assert best_of(pairs.scores, pairs) != [0, 1, 2, 3, 4]  # each by itself
    assert not told.is_open[pairs.track == pairs.ray].any()


def test_a_lone_track_is_judged_as_by_itself() -> None:
    at_rad = np.array([0.0])
    pairs = pairs_of(at_rad, np.array([0.02, -0.05]))
    np.testing.assert_allclose(judged(pairs, COMMON, room(at_rad)).scores, pairs.scores, atol=0.2)


def test_the_first_of_several_that_comes_into_the_picture_may_be_any() -> None:
    at_rad = np.array([0.0, 0.03])
    pairs = pairs_of(at_rad, np.array([0.012]))
    assert judged(pairs, COMMON, room(at_rad, 0.01)).is_open.any()
    both = pairs_of(at_rad, at_rad + 0.012)
    assert not judged(both, COMMON, room(at_rad)).is_open[both.track == both.ray].any()


def test_what_saw_more_of_late_is_not_moved_with_the_others() -> None:
    at_rad = np.array([0.0, 0.02])
    pairs = pairs_of(at_rad, at_rad)
    pairs.fit.covariance[:] = OWN_RAD**2 * np.eye(2)  # less than what they are said to share
    told = judged(pairs, COMMON, room(at_rad))
    assert np.isfinite(told.scores).all() and not told.information.any()


def test_a_turn_is_carried_as_far_as_it_is_new() -> None:
    at_rad = np.array([-0.03, 0.0, 0.04])
    pairs = pairs_of(at_rad, at_rad - 0.02)  # expected to the right of where they are seen
    told = judged(pairs, COMMON, room(at_rad))
    chosen = np.flatnonzero(pairs.track == pairs.ray).tolist()
    drift = np.diag([0.0, 0.0, COMMON_RAD**2])
    turn = carried(told, chosen, COMMON, drift, TO_RIGHT_AND_UP)
    np.testing.assert_allclose(turn.turn_rad, [0.0, 0.0, 0.02], rtol=0.03)
    assert 0.95 * COMMON_RAD**2 < turn.variance[2, 2] < COMMON_RAD**2
    old = carried(told, chosen, COMMON, 0.01 * drift, TO_RIGHT_AND_UP)
    np.testing.assert_allclose(old.turn_rad, 0.01 * turn.turn_rad)


def test_what_is_new_of_the_attitude_since_a_time() -> None:
    errors = LocalizerConfig().pose_errors
    pose = CameraPose(10.0, np.zeros(3), R_NORTH)
    assert not drift_of(10.0, pose, errors).any()
    np.testing.assert_allclose(drift_of(-np.inf, pose, errors), errors.bias_variance)
    since = drift_of(10.0 - errors.bias_time_constant_s, pose, errors)
    np.testing.assert_allclose(since, (1.0 - np.exp(-2.0)) * errors.bias_variance)
