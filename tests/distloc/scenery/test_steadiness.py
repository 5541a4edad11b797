"""What steps: a position that leaps is taken as it was; ground that begins to move is not, nor what steps for ever."""

from dataclasses import replace

import numpy as np
import pytest

from distloc.geometry.rotations import matrix_from_rotation_vector
from distloc.scenery.compass import SceneryReason
from distloc.scenery.information import Chain
from distloc.scenery.steadiness import Leaps, Steadiness, let_go
from tests.distloc.scenery.flown import TOLD, Keyframe, flown
from tests.distloc.scenery.test_compass import compass, stepped

CHAIN = Chain(np.ones(6), np.full(6, 1e-4), np.full(6, 1e-6), np.zeros(6))


def moved(frames: list[Keyframe], at: int, by_m: float) -> list[Keyframe]:
    """The reported positions from a keyframe on are farther north by a number of metres."""
    off_m = np.array([0.0, by_m, 0.0])
    return [
        *frames[:at],
        *(replace(one, pose=replace(one.pose, position_enu_m=one.pose.position_enu_m + off_m)) for one in frames[at:]),
    ]


def test_a_reported_leap_is_taken_off_and_may_be_back() -> None:
    frames = moved(moved(flown(5, steps=60), 25, 60.0), 45, -60.0)
    made = compass()
    off_m = []
    for frame in frames:
        pose = made.step(frame.pose, TOLD, frame.corners)
        off_m.append(float(pose.position_enu_m[1] - frame.pose.position_enu_m[1]))
        assert pose.errors is not None
    assert np.abs(off_m[:25]).max() == 0.0
    assert np.median(off_m[30:45]) == pytest.approx(-60.0, abs=3.0)
    assert np.median(off_m[50:]) == pytest.approx(0.0, abs=3.0)  # both ways are seen, and what is left is small


def test_ground_that_moves_is_no_leap() -> None:
    leaps = Leaps()
    for _ in range(3):
        assert leaps.note(np.array([10.0, 0.0, 0.0]), 1.0) == 0.0
    assert not leaps.let_go(np.array([20.0, 0.0, 0.0])).any()
    assert not leaps.offset_m.any()
    assert leaps.told(TOLD).position_bias_m == TOLD.position_bias_m


def test_tilt_that_steps_again_and_again_is_not_believed_and_a_heading_that_does_is() -> None:
    for which, is_restless in ((0, True), (2, False), (4, True)):
        steadiness = Steadiness()
        for number in range(4):
            assert not steadiness.is_restless or number > 2
            step = np.zeros(6)
            step[which] = 1.0
            jumps = steadiness.jumps(step, CHAIN)
            assert jumps.tolist() == [i == which for i in range(6)]
            assert not steadiness.jumps(step, let_go(CHAIN, step, jumps)).any()
            steadiness.note(jumps)
        assert steadiness.is_restless is is_restless
        for _ in range(30):
            steadiness.note(np.zeros(6, dtype=np.bool_))
        assert not steadiness.is_restless


def test_frames_of_another_moment_are_unsteady() -> None:
    frames = flown(7, steps=60)
    rng = np.random.default_rng(1)
    tilted = [
        replace(one, pose=replace(one.pose, R_cam_from_enu=one.pose.R_cam_from_enu @ matrix_from_rotation_vector(tilt)))
        for one, tilt in zip(frames, rng.normal(0.0, [0.05, 0.05, 0.0], (len(frames), 3)), strict=True)
    ]
    made = compass()
    stepped(made, tilted)
    assert made.reasons[SceneryReason.UNSTEADY] > 20
    assert not made.is_used
