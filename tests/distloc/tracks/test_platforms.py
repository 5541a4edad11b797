"""Several cameras, each with an attitude error of its own, and one map of targets."""

import math
from dataclasses import replace

import numpy as np
import pytest

from distloc.filter.uncertainty import ellipse_holds
from distloc.localizer import Localizer, LocalizerConfig
from distloc.simulation.targets import Box
from distloc.types import CameraPose, Detection, Extent, TargetEstimate, TargetState
from tests.support.cube_samples import CAMERA as CUBE_CAMERA
from tests.support.cube_samples import CUBE_ENU_M, cube_mask, empty_mask, pose_at
from tests.support.towers import CAMERA, FIRE_ENU_M, Towers, area_m2, looking_at, placed

LOOKS = 5
TWO_PLACES = placed([-10e3, -17.3e3, 500.0], [10e3, -17.3e3, 600.0])  # 20 km away and apart


def is_inside(one: TargetEstimate) -> bool:
    return ellipse_holds(one.ellipse95, (FIRE_ENU_M - one.position_enu_m)[:2])


def told_area_m2(one: TargetEstimate) -> float:
    return math.pi * one.ellipse95.semi_major_m * one.ellipse95.semi_minor_m


def told_of_sets(count: int, name: str | None = None) -> tuple[list[bool], list[float]]:
    """Of tower sets: whether the ellipse holds the fire, and its area by that of the bound."""
    inside, shares = [], []
    for seed in range(count):
        rng = np.random.default_rng([1, seed])
        towers = Towers.drawn(rng, 4)
        estimates = towers.watched(towers.localizer(seed), rng, LOOKS, name)
        one = max(estimates, key=lambda one: one.observations)
        inside.append(is_inside(one))
        shares.append(told_area_m2(one) / area_m2(towers.bound_m2(LOOKS)))
    return inside, shares


def test_each_tower_errs_in_its_own_way() -> None:
    rng = np.random.default_rng(4)
    towers = Towers.drawn(rng, 4)
    towers.biases_rad[:] = 0.0
    towers.biases_rad[:, 2] = np.radians([1.5, -1.4, 4.5, 1.6])
    (one,) = towers.watched(towers.localizer(0), rng, LOOKS)
    assert one.state is TargetState.CONFIRMED and is_inside(one)
    assert 0.7 < told_area_m2(one) / area_m2(towers.bound_m2(LOOKS)) < 1.3
    # with one error for all of them it is sure of what is wrong
    blind = towers.watched(towers.localizer(0), np.random.default_rng(4), LOOKS, name="all")
    assert not any(is_inside(one) for one in blind)


def test_the_ellipse_is_as_large_as_the_batch_bound_s() -> None:
    inside, shares = told_of_sets(12)
    assert sum(inside) >= 9
    assert 0.8 < float(np.median(shares)) < 1.3


@pytest.mark.thorough
def test_of_200_sets_of_towers_nine_in_ten_hold_the_fire() -> None:
    inside, shares = told_of_sets(200)
    assert 0.90 <= float(np.mean(inside)) <= 1.0
    assert 0.8 < float(np.median(shares)) < 1.3


@pytest.mark.parametrize("tilt_deg", [0.5, 2.0, 5.0])
@pytest.mark.parametrize("order", [(0, 1), (1, 0)])
def test_two_views_of_one_place_are_one_target(tilt_deg: float, order: tuple[int, int]) -> None:
    for seed in range(5):
        rng = np.random.default_rng(seed)
        biases_rad = rng.standard_normal((2, 3)) * np.radians([tilt_deg, tilt_deg, 3.0])
        towers = Towers(TWO_PLACES, biases_rad, tilt_deg, 3.0)
        located = towers.localizer(seed)
        for number, tower in enumerate(order):
            located.step_detections(*towers.seen(tower, 60.0 * number, rng))
        assert len(located.explain().tracks) == 1


def test_a_first_look_with_a_choice_starts_tracks_of_its_own() -> None:
    rng = np.random.default_rng(0)
    towers = Towers(TWO_PLACES, np.zeros((2, 3)), 5.0, 3.0)
    located = towers.localizer(0)
    located.step_detections(*towers.seen(0, 0.0, rng))
    pose, seen = towers.seen(1, 60.0, rng)
    u_px, v_px = seen[0].centre_px.tolist()
    located.step_detections(pose, [*seen, Detection.from_point(u_px - 300.0, v_px, 3.0)])
    assert len(located.explain().tracks) == 3


def test_one_tower_alone_never_confirms() -> None:
    rng = np.random.default_rng(0)
    towers = Towers.drawn(rng, 1)
    located = towers.localizer(0, platforms=4)
    for look in range(40):
        told = located.step_detections(*towers.seen(0, 60.0 * look, rng))
        assert all(one.state is TargetState.TENTATIVE for one in told)
    assert len(told) == 1


def test_towers_that_look_in_turn_keep_what_one_of_them_sees() -> None:
    """Eleven others see nothing in between: it is neither a miss of theirs nor forgotten."""
    rng = np.random.default_rng(0)
    towers = Towers.drawn(rng, 12)
    located = towers.localizer(0)
    for look in range(8):
        for tower in range(12):
            pose, seen = towers.seen(tower, 60.0 * look + tower, rng)
            told = located.step_detections(pose, seen if tower == 0 else [])
    assert [one.misses for one in told] == [0] and told[0].observations == 8


def test_towers_at_the_same_moment_each_have_their_step() -> None:
    rng = np.random.default_rng(0)
    towers = Towers.drawn(rng, 3)
    located = towers.localizer(0)
    for tower in range(3):
        located.step_detections(*towers.seen(tower, 5.0, rng))
        assert [one.sightings for one in located.explain().tracks] == [tower + 1]


def test_a_point_is_never_dirt_on_the_lens() -> None:
    """A camera that is made to look along each bearing has all of them in its middle."""
    fire = np.array([0.0, 3000.0, 100.0])
    located = Localizer(CAMERA, LocalizerConfig(), rng=np.random.default_rng(0))
    for k in range(60):
        place = np.array([40.0 * k - 1200.0, 0.0, 100.0])
        pose = CameraPose(2.0 * k, place, looking_at(place, fire), heading_rad=math.pi / 2.0)
        told = located.step_detections(pose, [Detection.from_point(960.0, 540.0, 2.0)])
    assert [one.state for one in told] == [TargetState.CONFIRMED]


def test_a_size_is_expected_of_the_camera_that_saw_it() -> None:
    """Two drones see one column, which no dust is, from 600 and from 2,000 m: nothing of it is a part or another."""
    located = Localizer(CUBE_CAMERA, LocalizerConfig(platforms=2), rng=np.random.default_rng(0))
    extents: list[Extent] = []
    for k in range(30):
        for name, ahead_m in (("near", 1400.0), ("far", 0.0)):
            pose = replace(pose_at(10.0 * k + 350.0), platform=name)
            pose = replace(pose, position_enu_m=pose.position_enu_m + np.array([0.0, ahead_m, 0.0]))
            mask = empty_mask()
            Box(CUBE_ENU_M, size_m=(40.0, 40.0, 100.0)).draw(mask, CUBE_CAMERA, pose)
            told = located.step(pose, mask)
            extents += [one.extent for one in told]
    (one,) = told
    assert one.state is TargetState.CONFIRMED and one.observations == 60
    assert all(abs(one.width_m - 40.0) < 10.0 and one.width_sigma_m < 6.0 for one in extents[-20:])


def test_what_is_told_of_a_fire_is_by_the_camera_that_saw_it() -> None:
    """A second drone that looks elsewhere says nothing of how wide the root is, nor has it seen the smoke."""
    config = LocalizerConfig(platforms=2)
    located = Localizer(CUBE_CAMERA, config, rng=np.random.default_rng(0))
    for k in range(40):
        pose = replace(pose_at(10.0 * k + 350.0), platform="sees")
        mask = empty_mask()
        Box(CUBE_ENU_M, size_m=(60.0, 40.0, 100.0)).draw(mask, CUBE_CAMERA, pose)
        estimates = located.step(pose, mask)
    (seen,) = estimates
    away = replace(pose_at(9000.0), stamp_s=pose.stamp_s, platform="away")
    (told,) = located.step(away, empty_mask())
    saved = located.snapshot()
    assert saved.platform == "away" and saved.tracks[0].platform == "sees"
    again = Localizer(CUBE_CAMERA, config, rng=np.random.default_rng(1))
    again.restore(saved)
    (restored,) = again.step(replace(away, stamp_s=away.stamp_s + 1.0), empty_mask())
    for one, tolerance_m in ((told, 1e-3), (restored, 3.0)):
        assert one.position_enu_m == pytest.approx(seen.position_enu_m, abs=tolerance_m)
        assert one.vertical95_m == pytest.approx(seen.vertical95_m, abs=tolerance_m)
    assert seen.plume is not None and told.plume is not None
    assert told.plume.centre_enu_m == pytest.approx(seen.plume.centre_enu_m)


def test_with_one_name_nothing_is_another() -> None:
    """A name changes nothing, nor does room for more names but memory."""

    def flown(name: str, platforms: int) -> list[list[float]]:
        config = LocalizerConfig(platforms=platforms)
        located = Localizer(CUBE_CAMERA, config, rng=np.random.default_rng(3))
        poses = [replace(pose_at(10.0 * k), platform=name) for k in range(25)]
        return [one.position_enu_m.tolist() for pose in poses for one in located.step(pose, cube_mask(pose))]

    alone = flown("", 1)
    assert alone and flown("drone1", 1) == alone
    assert np.allclose(flown("drone1", 3), alone, rtol=0.0, atol=1e-3)


def test_an_attitude_is_doubted_of_one_platform() -> None:
    rng = np.random.default_rng(0)
    towers = Towers.drawn(rng, 3)
    located = towers.localizer(0)
    towers.watched(located, rng, LOOKS)
    bank = located._tracker._bank  # type: ignore[union-attr]
    before = bank.P[0].copy()
    located.doubt_attitude("tower1")
    assert np.trace(bank.P[0]) - np.trace(before) == pytest.approx(float(np.square(towers.sigmas_rad).sum()), rel=1e-3)
    located.heading_jumped(0.1, "tower2")
    assert located.compass is located._platforms[2].compass  # none of the two looked


def test_a_name_too_many_is_one_line() -> None:
    rng = np.random.default_rng(0)
    towers = Towers.drawn(rng, 3)
    located = towers.localizer(0, platforms=2)
    towers.watched(located, rng, 0)
    for tower in (0, 1, 0):
        located.step_detections(*towers.seen(tower, 10.0 * tower, rng))
    with pytest.raises(ValueError, match=r"^CameraPose.platform 'tower2' .*'tower0', 'tower1'.*platforms.* got 2$"):
        located.step_detections(*towers.seen(2, 50.0, rng))


@pytest.mark.parametrize("platforms", [0, 17])
def test_how_many_platforms_there_may_be(platforms: int) -> None:
    with pytest.raises(ValueError, match=f"platforms must be 1 to 16, got {platforms}"):
        LocalizerConfig(platforms=platforms)


def test_after_a_restart_the_others_errors_come_afresh() -> None:
    rng = np.random.default_rng(2)
    towers = Towers.drawn(rng, 3)
    located = towers.localizer(0)
    towers.watched(located, rng, LOOKS)
    saved = located.snapshot()
    assert saved.platform == "tower2"
    again = towers.localizer(1)
    again.restore(saved)
    told = again.step_detections(*towers.seen(0, 400.0, rng))
    assert [one.id for one in told] == [1] and is_inside(told[0])
    for look in range(3):
        for tower in range(3):
            told = again.step_detections(*towers.seen(tower, 500.0 + 10.0 * tower + 60.0 * look, rng))
    assert told[0].observations == 15 + 10 and told[0].misses == 0
