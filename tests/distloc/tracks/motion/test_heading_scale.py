"""A compass that wanders by more than was told: the bearings say so, and whose errors grow by it."""

from dataclasses import replace

import numpy as np
import pytest

from distloc.filter.settings import LocalizerConfig
from distloc.tracks.motion.bearings import AGE, AZIMUTH
from distloc.tracks.motion.fit import MOTIONS, SCALES
from distloc.tracks.motion.heading_scale import HeadingScale
from distloc.tracks.motion.motion import COUNTS, Motion, judge, mixed
from distloc.types import FloatArray
from tests.distloc.tracks.motion.test_fit import HEADING_RAD, TAU_S, looking, orbit
from tests.distloc.tracks.motion.test_motion import ABOUT_M, AIM_RAD

ERRORS = LocalizerConfig().pose_errors


def wandering(seconds: FloatArray, times: float, seed: int) -> FloatArray:
    """A Gauss-Markov error that is so many times as large as told."""
    rng, kept = np.random.default_rng(seed), np.exp(-np.diff(seconds) / TAU_S)
    error = [rng.standard_normal()]
    for one in kept:
        error.append(one * error[-1] + np.sqrt(1.0 - one**2) * rng.standard_normal())
    return times * HEADING_RAD * np.array(error)


def circled(times: float, seed: int, jump_rad: float = 0.0) -> Motion:
    """A fire that was circled with such a compass, which jumps half-way."""
    motion = Motion()
    motion.bearings = orbit((0.0, 0.0))
    seconds = motion.bearings.held[:, 0]
    motion.bearings.held[:, 3] += wandering(seconds, times, seed) + np.where(seconds > 450.0, jump_rad, 0.0)
    motion.stamp_s = motion.first_s = float(seconds[-1])  # of fronts, which creep, nothing here
    return motion


def judged(motions: list[Motion]) -> HeadingScale:
    scale, k = HeadingScale(), len(motions)
    before = np.array([scale.before(one) for one in motions])
    about_m, aim_rad = np.repeat(ABOUT_M, k, axis=0), np.repeat(AIM_RAD, k)
    judge(motions, about_m, aim_rad, looking(200.0 / 1500.0, k=k), before)
    scale.weigh(motions)
    return scale


@pytest.mark.parametrize(("times", "least", "most"), [(1.0, 1.0, 1.0), (2.5, 1.5, 3.5), (5.0, 3.0, 5.0)])
def test_the_bearings_tell_how_much_larger_than_told_the_error_is(times: float, least: float, most: float) -> None:
    for seed in range(6):
        scale = judged([circled(times, seed)])
        assert least <= scale.factor <= most
        errors = scale.scaled(ERRORS)
        assert errors.heading_bias_rad == pytest.approx(scale.factor * ERRORS.heading_bias_rad)
        assert errors.heading_scale == scale.factor


def test_the_ellipse_is_as_wide_as_the_compass_is_bad_and_no_wider_where_it_is_as_told() -> None:
    inside, runs = 0, 20
    for seed in range(runs):
        good, bad = circled(1.0, seed), circled(2.5, seed)
        judged([good, bad])
        known_m2 = np.eye(2) * 15.0**2
        shift, added = mixed([bad], bad.stamp_s, ABOUT_M, known_m2[None])
        off_m = -shift[0]  # the fire is where it was taken to be
        inside += off_m @ np.linalg.solve(known_m2 + added[0], off_m) < 5.99
        assert good.probability[MOTIONS:].max() < COUNTS
    assert inside >= 0.85 * runs


@pytest.mark.parametrize("jump_deg", [3.0, 15.0])
def test_one_jump_as_where_half_a_plume_goes_for_good_is_no_larger_error(jump_deg: float) -> None:
    assert judged([circled(1.0, 1, jump_rad=float(np.radians(jump_deg)))]).factor == 1.0


def test_what_jumps_from_frame_to_frame_is_no_larger_error() -> None:
    rng = np.random.default_rng(4)
    for jumps_rad in (np.radians(2.0) * rng.standard_normal(32), np.radians(1.0) * (-1.0) ** np.arange(32)):
        motion = circled(1.0, 2)
        motion.bearings.held[:, AGE] /= 30.0  # a second apart
        motion.bearings.held[:, AZIMUTH] += jumps_rad
        assert judged([motion]).factor == 1.0


def test_who_was_seen_for_moments_has_no_say() -> None:
    motion = circled(5.0, 0)
    motion.bearings.count = 15
    assert judged([motion]).factor == 1.0


def test_many_targets_are_seen_with_one_compass_and_their_evidence_is_no_more_than_ones() -> None:
    one, many = judged([circled(2.0, 3)]), judged([circled(2.0, 3) for _ in range(6)])
    assert many.probability == pytest.approx(one.probability)


def test_what_was_seen_seldom_does_not_outvote_what_was_seen_often() -> None:
    scale, few = judged([circled(5.0, 2)]), circled(1.0, 0)
    told = scale.probability.copy()
    few.bearings.count = 8
    judge([few], ABOUT_M, AIM_RAD, looking(0.1), scale.before(few)[None])
    scale.weigh([few])
    assert scale.probability == pytest.approx(told)
    assert few.probability.reshape(len(SCALES), -1).sum(axis=1).argmax() > 0  # it goes by what the others say


def test_what_is_told_is_left_alone_before_anything_was_seen() -> None:
    scale = HeadingScale()
    assert scale.factor == 1.0 and scale.scaled(ERRORS) is ERRORS
    scale.weigh([])
    scale.weigh([Motion()])
    assert scale.factor == 1.0


def test_the_bearings_keep_what_was_told_not_what_was_made_of_it() -> None:
    motion = circled(1.0, 0)
    before = judged([motion])
    assert before.factor == 1.0
    larger = replace(ERRORS, heading_bias_rad=2.5 * ERRORS.heading_bias_rad, heading_scale=2.5)
    assert larger.heading_bias_rad / larger.heading_scale == pytest.approx(ERRORS.heading_bias_rad)
