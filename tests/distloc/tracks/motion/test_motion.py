"""What is said of a target's motion, by its looks and its bearings; and what that makes of its place."""

import numpy as np
import pytest

from distloc.tracks.motion.motion import Motion, judge, mixed
from tests.distloc.tracks.motion.test_fit import looking, orbit, straight

AIM_RAD = np.array([0.002])
ABOUT_M = np.array([[0.0, 1500.0]])
AS_TOLD = np.array([[0.96, 0.03, 0.01]])
SMOKE_M, DUST_M = 200.0, 40.0


def judged(motion: Motion, height_m: float) -> Motion:
    motion.stamp_s = float(motion.bearings.held[motion.bearings.count - 1, 0])
    judge([motion], ABOUT_M, AIM_RAD, looking(height_m / 1500.0), AS_TOLD)
    return motion


def test_on_one_course_smoke_stands_and_dust_is_unresolved() -> None:
    for height_m, speed_mps, verdict in (
        (SMOKE_M, 0.0, "fixed"),
        (DUST_M, 0.0, "unresolved"),
        (DUST_M, 5.0, "unresolved"),
        (0.0, 0.0, "fixed"),  # of a size that nobody knows nothing is said
    ):
        motion = Motion()
        motion.bearings = straight((speed_mps, 0.0))
        assert judged(motion, height_m).verdict == verdict


def test_a_low_fire_that_was_circled_stands() -> None:
    motion = Motion()
    motion.bearings = orbit((0.0, 0.0))
    assert judged(motion, 50.0).verdict == "fixed"


@pytest.mark.parametrize("probability", [(0.92, 0.0, 0.08), (0.3, 0.0, 0.7), (0.9, 0.1, 0.0), (0.2, 0.3, 0.5)])
def test_each_thing_that_is_likely_enough_is_in_the_ellipse(probability: tuple[float, float, float]) -> None:
    motion = Motion()
    motion.is_judged = True
    motion.probability[:3] = probability
    motion.place_m[:3] = [[0.0, 0.0], [150.0, 80.0], [900.0, -500.0]]
    motion.place_m2[:] = np.eye(2)
    known_m2 = np.diag([40.0**2, 20.0**2])
    shift, added = mixed([motion], 0.0, np.zeros((1, 2)), known_m2[None])
    for likely, place_m in zip(probability, motion.place_m[:3], strict=True):
        off_m = place_m - shift[0]
        assert likely < 0.05 or off_m @ np.linalg.solve(known_m2 + added[0], off_m) < 5.99


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
    back, _ = mixed([creeps], now_s - 3600.0, ABOUT_M, known_m2[:1])  # not where it would have been an hour before
    assert back[0] == pytest.approx(shift[1], abs=1e-6)


def test_a_motion_goes_on_from_its_bearings() -> None:
    motion = Motion()
    motion.bearings = orbit((1.0, 0.0))
    judged(motion, SMOKE_M)
    again = Motion(motion.bearings.rows, motion.first_s)
    assert again.is_due
    judged(again, SMOKE_M)
    assert again.probability == pytest.approx(motion.probability)


def test_a_filter_that_began_anew_and_contradicts_all_bearings_is_not_believed_alone() -> None:
    motion = Motion()
    motion.bearings = orbit((0.0, 0.0))
    judged(motion, SMOKE_M)
    truth_m, known_m2 = np.array([0.0, 1500.0]), np.array([np.eye(2) * 20.0**2])
    for off_m, is_wider in ((10.0, False), (400.0, True)):
        shift, added = mixed([motion], motion.stamp_s, truth_m[None] + off_m, known_m2)
        assert (np.trace(added[0]) > np.trace(known_m2[0])) == is_wider
        for place_m in (truth_m, truth_m + off_m):
            away_m = place_m - (truth_m + off_m + shift[0])
            assert away_m @ np.linalg.solve(known_m2[0] + added[0], away_m) < 5.99
