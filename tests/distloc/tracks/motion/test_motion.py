"""What is said of a target's motion, by its looks and its bearings; and what that makes of its place."""

import numpy as np
import pytest

from distloc.tracks.motion.motion import Motion, dust_odds, judge, mixed
from tests.distloc.tracks.motion.test_fit import orbit, straight

AIM_RAD = np.array([0.002])
ABOUT_M = np.array([[0.0, 1500.0]])
SMOKE_M, DUST_M = np.array([[120.0, 200.0]]), np.array([[90.0, 45.0]])


def judged(motion: Motion, size_m: np.ndarray) -> Motion:
    motion.stamp_s = float(motion.bearings.held[motion.bearings.count - 1, 0])
    judge([motion], ABOUT_M, AIM_RAD, size_m)
    return motion


def test_dust_is_low_and_drawn_out_and_of_no_size_nothing_is_said() -> None:
    assert dust_odds(DUST_M[0]) > 1.0
    assert dust_odds(SMOKE_M[0]) < 0.01
    assert dust_odds(np.array([100.0, 100.0])) < 0.05  # a box of 100 m
    assert dust_odds(np.zeros(2)) == 0.0


def test_on_one_course_smoke_stands_and_dust_is_unresolved() -> None:
    for size_m, verdict in ((SMOKE_M, "fixed"), (DUST_M, "unresolved")):
        motion = Motion()
        motion.bearings = straight((0.0, 0.0))
        assert judged(motion, size_m).verdict == verdict


def test_a_low_fire_that_was_circled_stands() -> None:
    motion = Motion()
    motion.bearings = orbit((0.0, 0.0))
    assert judged(motion, np.array([[60.0, 50.0]])).verdict == "fixed"


def test_what_stands_is_left_where_it_is_and_what_creeps_is_moved_and_widened() -> None:
    still, creeps = Motion(), Motion()
    still.bearings, creeps.bearings = orbit((0.0, 0.0)), orbit((1.0, 0.0))
    for motion in (still, creeps):
        judged(motion, SMOKE_M)
    now_s, known_m2 = creeps.stamp_s, np.array([np.eye(2) * 400.0] * 2)
    shift, added = mixed([still, creeps], now_s, np.repeat(ABOUT_M, 2, axis=0), known_m2)
    assert np.abs(shift[0]).max() < 5.0
    assert shift[1] == pytest.approx([now_s, 0.0], abs=60.0) and creeps.verdict == "fixed"
    assert np.linalg.eigvalsh(added)[1].max() > 0.0
    later, _ = mixed([creeps], now_s + 30.0, ABOUT_M, known_m2[:1])
    assert later[0, 0] == pytest.approx(shift[1, 0] + 30.0, abs=6.0)  # it goes on between two judgements


def test_a_motion_goes_on_from_its_bearings() -> None:
    motion = Motion()
    motion.bearings = orbit((1.0, 0.0))
    judged(motion, SMOKE_M)
    again = Motion(motion.bearings.rows, motion.first_s)
    assert again.is_due
    judged(again, SMOKE_M)
    assert again.probability == pytest.approx(motion.probability)
