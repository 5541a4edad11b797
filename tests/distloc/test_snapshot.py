"""Snapshots: what goes on after a restart is what was there before, in other axes and on another clock too."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from distloc.filter.calibrated_filter import CalibratedFilter
from distloc.filter.uncertainty import ellipse_holds, weighted_ellipse
from distloc.geometry.geodesy import LocalFrame
from distloc.geometry.rotations import matrix_from_rotation_vector
from distloc.localizer import Localizer, LocalizerConfig
from distloc.sights.aspect import Aspect
from distloc.simulation.targets import Box
from distloc.snapshot import Axes, FilterSnapshot, LocalizerSnapshot
from distloc.tracks.tracker import Tracker
from distloc.types import CameraPose, FloatArray, TargetEstimate, TargetState
from tests.distloc.filter.test_calibrated_filter import ERRORS, reported, sight, weighted_positions
from tests.support.cube_samples import CAMERA, CUBE_ENU_M, R_NORTH, cube_mask, empty_mask, pose_at

CONFIG = LocalizerConfig(n_particles=20_000)
EAST_CUBE = Box(CUBE_ENU_M + np.array([500.0, 0.0, 0.0]))


def localizer(seed: int = 0, config: LocalizerConfig = CONFIG) -> Localizer:
    return Localizer(CAMERA, config, rng=np.random.default_rng(seed))


def flown(located: Localizer, steps: range, axes: Axes | None = None) -> list[TargetEstimate]:
    """The last estimates of a flight past the cube, a step each 10 m and second; poses as other axes have them.

    The nose turns, so that a compass may err otherwise from step to step.
    """
    estimates: list[TargetEstimate] = []
    for k in steps:
        pose = replace(pose_at(10.0 * k), heading_rad=0.01 * k)
        estimates = located.step(pose if axes is None else in_axes(pose, axes), cube_mask(pose))
    return estimates


def in_axes(pose: CameraPose, axes: Axes) -> CameraPose:
    return CameraPose(
        pose.stamp_s + axes.later_s,
        axes.place(pose.position_enu_m),
        np.ascontiguousarray(pose.R_cam_from_enu @ axes.R.T),
        heading_rad=None if pose.heading_rad is None else pose.heading_rad + np.arctan2(axes.R[0, 1], axes.R[1, 1]),
    )


def restarted(located: Localizer, seed: int = 100, config: LocalizerConfig = CONFIG) -> Localizer:
    after = localizer(seed, config)
    after.restore(located.snapshot())
    return after


def told_of(located: Localizer, pose: CameraPose) -> TargetEstimate:
    """What is told of the one target, from a pose."""
    tracker = located._tracker
    assert isinstance(tracker, Tracker)
    (one,) = tracker._estimates(tracker._tracks, {}, pose, CONFIG.pose_errors)
    return one


@pytest.mark.parametrize("n_particles", [4096, 6000])
@pytest.mark.parametrize("steps", [6, 12, 40])
def test_the_ellipse_is_as_it_was(n_particles: int, steps: int) -> None:
    config = LocalizerConfig(n_particles=n_particles, aim="centre")
    before, ratios = localizer(1, config), []
    flown(before, range(steps))
    pose = pose_at(10.0 * (steps - 1))
    was = told_of(before, pose)
    for seed in range(5):
        now = told_of(restarted(before, seed, config), pose)
        ratios.append(
            (
                now.ellipse95.semi_major_m / was.ellipse95.semi_major_m,
                now.ellipse95.semi_minor_m / was.ellipse95.semi_minor_m,
                now.vertical95_m / was.vertical95_m,
                np.sqrt(np.linalg.det(now.covariance_enu_m2[:2, :2]) / np.linalg.det(was.covariance_enu_m2[:2, :2])),
            )
        )
        offset_m = now.position_enu_m - was.position_enu_m
        assert offset_m @ np.linalg.solve(was.covariance_enu_m2, offset_m) < 0.1**2
        turned_rad = (now.ellipse95.azimuth_rad - was.ellipse95.azimuth_rad + np.pi / 2) % np.pi - np.pi / 2
        assert abs(turned_rad) < np.radians(2.0)
    # both are measured from 2048 particles: their quantiles have a standard error of 2 to 3 % by themselves
    assert np.array(ratios) == pytest.approx(1.0, abs=0.12)
    assert np.mean(ratios, axis=0) == pytest.approx(1.0, abs=0.08)  # one sample for all five


def test_what_the_root_and_the_bearings_told_comes_back_too() -> None:
    before = localizer(1)
    flown(before, range(40))
    pose = pose_at(390.0)
    was, now = told_of(before, pose), told_of(restarted(before, 0), pose)
    assert now.aim == "base" and now.motion == was.motion
    assert now.plume is not None and was.plume is not None
    assert (now.plume.lean_rad, now.plume.drift_rad) == pytest.approx((was.plume.lean_rad, was.plume.drift_rad))
    offset_m = now.position_enu_m - was.position_enu_m
    assert offset_m @ np.linalg.solve(was.covariance_enu_m2, offset_m) < 0.1**2
    assert now.ellipse95.semi_major_m == pytest.approx(was.ellipse95.semi_major_m, rel=0.12)


def test_no_two_particles_are_one_afterwards() -> None:
    before = localizer()
    flown(before, range(20))
    (track,) = restarted(before)._tracker._tracks  # type: ignore[union-attr]
    assert len(np.unique(track.filter.bank.particles.x[track.filter.place, :3], axis=1).T) > 0.99 * CONFIG.n_particles
    (saved,) = before.snapshot().tracks
    assert len(np.unique(saved.filter.positions_m, axis=1).T) <= 2048


def end_of_flight(seed: int, restarts: tuple[int, ...]) -> tuple[float, bool]:
    """NEES on the map and whether the ellipse holds the point, of a filter restarted with ten steps lost each time."""
    rng = np.random.default_rng([7, seed])
    one = CalibratedFilter.alone(20_000, rng)
    point_m, sights = reported(seed)
    one.start(sights[0], ERRORS)
    last = sights[0]
    lost = {step + k for step in restarts for k in range(10)}
    for step, seen in enumerate(sights[1:], start=1):
        if step in restarts:
            saved, one = one.snapshot(), CalibratedFilter.alone(20_000, rng)
            along = saved.origin_enu_m + saved.positions_m.mean(axis=1) - last.position_enu_m
            one.restore(saved, sight(along, last.position_enu_m))
        if step not in lost:
            one.predict(seen.stamp_s, ERRORS)
            one.update(seen)
            last = seen
    offset_m = (point_m - one.cloud.mean_enu_m)[:2]
    covariance_m2 = one.cloud.covariance_enu_m2[:2, :2]
    points_m, weights = weighted_positions(one)
    ellipse = weighted_ellipse(points_m[:2] - one.cloud.mean_enu_m[:2, None], weights, covariance_m2, 0.95)
    return float(offset_m @ np.linalg.solve(covariance_m2, offset_m)), ellipse_holds(ellipse, offset_m)


@pytest.mark.thorough
def test_it_stays_calibrated_over_three_restarts() -> None:
    nees, holds = np.array([end_of_flight(seed, (10, 25, 45)) for seed in range(100)]).T
    # 3 standard errors of a mean of chi-squares with 2 degrees of freedom, 3.5 of a binomial
    assert 2.0 - 3 * 0.2 < nees.mean() < 2.0 + 3.5 * 0.2
    assert 0.95 - 3.5 * np.sqrt(0.95 * 0.05 / 100) < holds.mean() <= 1.0


def test_it_coasts_until_it_is_seen_again() -> None:
    before = localizer()
    (was,) = flown(before, range(60))
    assert was.state is TargetState.CONFIRMED
    after = restarted(before)
    away = CameraPose(61.0, pose_at(610.0).position_enu_m, R_NORTH * np.array([[-1.0], [1.0], [-1.0]]))  # looks south
    (unseen,) = after.step(away, empty_mask())
    assert (unseen.id, unseen.state, unseen.observations) == (was.id, TargetState.COASTING, was.observations)
    assert (unseen.first_seen_s, unseen.last_seen_s) == (was.first_seen_s, was.last_seen_s)
    assert (unseen.baseline_m, unseen.existence, unseen.extent) == (was.baseline_m, was.existence, was.extent)
    (seen,) = flown(after, range(62, 63))
    assert (seen.id, seen.state, seen.observations) == (was.id, TargetState.CONFIRMED, was.observations + 1)


def test_what_was_tentative_is_confirmed_no_sooner() -> None:
    before, through = localizer(), localizer()
    flown(before, range(6))
    flown(through, range(6))
    after = restarted(before)
    states = [flown(after, range(k, k + 1))[0].state for k in range(6, 20)]
    assert states[0] is TargetState.TENTATIVE
    assert states == [flown(through, range(k, k + 1))[0].state for k in range(6, 20)]


def test_what_burnt_out_meanwhile_is_dismissed_and_its_id_not_given_again() -> None:
    before = localizer()
    flown(before, range(30))
    after, states, ids = restarted(before), [], set()
    for k in range(40, 85):
        pose = pose_at(10.0 * k)
        mask = empty_mask()
        if k > 45:
            EAST_CUBE.draw(mask, CAMERA, pose)
        for one in after.step(pose, mask):
            states.append((one.id, one.state))
            ids.add(one.id)
    assert [state for id_, state in states if id_ == 1][-1] is TargetState.DISMISSED
    assert ids == {1, 2}


def test_ids_are_not_given_again_when_nothing_was_left() -> None:
    before = localizer()
    flown(before, range(30))
    for k in range(30, 60):
        before.step(replace(pose_at(400.0), stamp_s=float(k)), empty_mask())
    saved = before.snapshot()
    assert (saved.tracks, saved.next_id) == ((), 2)
    after = restarted(before)
    assert {one.id for one in flown(after, range(60, 80))} == {2}


def test_a_snapshot_changes_nothing() -> None:
    asked, left_alone = localizer(), localizer()
    for k in range(30):
        estimates = [flown(one, range(k, k + 1)) for one in (asked, left_alone)]
        asked.snapshot()
        assert [one.position_enu_m.tolist() for one in estimates[0]] == [
            one.position_enu_m.tolist() for one in estimates[1]
        ]


def test_the_attitudes_error_forgets_itself_over_the_time_lost() -> None:
    one, other = (CalibratedFilter.alone(5000, np.random.default_rng(seed)) for seed in range(2))
    _, sights = reported(0)
    one.start(sights[0], ERRORS)
    for seen in sights[1:30]:
        one.predict(seen.stamp_s, ERRORS)
        one.update(seen)
    saved = one.snapshot()
    other.restore(saved, sights[29])
    lost_s = 600.0
    kept = np.exp(-lost_s / ERRORS.bias_time_constant_s)
    other.predict(saved.stamp_s + lost_s, ERRORS)
    full = np.diag(np.square([ERRORS.tilt_bias_rad, ERRORS.tilt_bias_rad, ERRORS.heading_bias_rad]))
    expected = kept**2 * saved.nuisance_covariance[:3, :3] + (1.0 - kept**2) * full
    assert other.bank.P[0, :3, :3] == pytest.approx(expected, rel=1e-6, abs=1e-12)
    assert np.trace(expected) > np.trace(saved.nuisance_covariance[:3, :3])


def axes_between(lat_deg: float, lon_deg: float) -> Axes:
    """From a frame at 47 N 8.5 E to one elsewhere, and 5000 s later."""
    R, shift_m = LocalFrame(lat_deg, lon_deg, 300.0).from_other(LocalFrame(47.0, 8.5, 430.0))
    return Axes(R, shift_m, 5000.0)


@pytest.mark.parametrize("place", [(47.0, 8.5), (47.08, 8.4), (46.0, 10.0)])
def test_in_other_axes_it_goes_on_as_it_would_have(place: tuple[float, float]) -> None:
    axes = axes_between(*place)
    before, here, there = localizer(), localizer(5), localizer(5)
    flown(before, range(25))
    here.restore(before.snapshot())
    there.restore(before.snapshot().moved(axes))
    (one,), (other,) = flown(here, range(28, 45)), flown(there, range(28, 45), axes)
    # the same random numbers: only rounding, to float32 about other points, tells them apart
    assert other.position_enu_m == pytest.approx(axes.place(one.position_enu_m), abs=0.1 * one.ellipse95.semi_minor_m)
    assert axes.R.T @ other.covariance_enu_m2 @ axes.R == pytest.approx(
        one.covariance_enu_m2, abs=0.1 * float(np.trace(one.covariance_enu_m2))
    )
    assert other.first_seen_s - one.first_seen_s == other.last_seen_s - one.last_seen_s == 5000.0
    assert (other.state, other.observations) == (one.state, one.observations)
    assert other.baseline_m == pytest.approx(one.baseline_m, abs=1e-3)


@settings(deadline=None, max_examples=40)
@given(
    st.floats(-80.0, 80.0), st.floats(-180.0, 180.0), st.floats(-0.2, 0.2), st.floats(-0.2, 0.2),
    st.tuples(*[st.floats(-2e4, 2e4)] * 3),
)  # fmt: skip
def test_frames_lead_into_each_other(
    lat_deg: float, lon_deg: float, north_deg: float, east_deg: float, enu: tuple[float, float, float]
) -> None:
    old, new = (
        LocalFrame(lat_deg, lon_deg, 430.0),
        LocalFrame(lat_deg + north_deg, lon_deg * 0.999 + east_deg * 0.5, 0.0),
    )
    R, shift_m = new.from_other(old)
    there = new.enu_from_geodetic(*old.geodetic_from_enu(np.array(enu)))
    assert R @ np.array(enu) + shift_m == pytest.approx(there, abs=1e-3)
    assert pytest.approx(np.eye(3), abs=1e-12) == R @ R.T


def test_turned_axes_turn_every_part_of_the_filter() -> None:
    """A sight, and what is expected of it, are the same in axes that are turned by a lot and far away."""
    one = CalibratedFilter.alone(5000, np.random.default_rng(0))
    _, sights = reported(3)
    one.start(sights[0], ERRORS, aim_sigma_rad=np.array([0.02, 0.01]))
    for seen in sights[1:20]:
        one.predict(seen.stamp_s, ERRORS)
        one.update(seen)
    saved = one.snapshot()
    R = matrix_from_rotation_vector(np.array([0.0, 0.0, 1.0]))  # about up: level stays level
    axes = Axes(R, np.array([3000.0, -7000.0, 50.0]), 0.0)
    turned = replace(sights[20], position_enu_m=axes.place(sights[20].position_enu_m), axes=sights[20].axes @ R.T)
    plain, moved = (CalibratedFilter.alone(2048, np.random.default_rng(1)) for _ in range(2))
    plain.restore(saved, sights[20])
    moved.restore(saved.moved(axes), turned)
    assert moved.bank.aim_sigma_rad[0] == pytest.approx([0.02, 0.01])
    assert moved.log_likelihood(turned) == pytest.approx(plain.log_likelihood(sights[20]), abs=1e-2)
    moved.update(turned)
    plain.update(sights[20])
    assert axes.R.T @ moved.cloud.bias_rad == pytest.approx(plain.cloud.bias_rad, abs=1e-5)
    assert moved.cloud.mean_enu_m == pytest.approx(axes.place(plain.cloud.mean_enu_m), abs=1.0)


@pytest.mark.parametrize("degrees", [0.0, 0.3, 90.0, 200.0])
def test_the_sides_that_were_seen_are_known_afterwards(degrees: float) -> None:
    """To and fro past a target: each look is the visit, and keeps the share of the error, that it would have been."""
    target_m = np.array([0.0, 1000.0, 100.0])
    R = matrix_from_rotation_vector(np.array([0.0, 0.0, np.radians(degrees)]))
    axes = Axes(R, np.array([3000.0, -7000.0, 50.0]), 0.0)
    legs_m = [np.array([east_m, 0.0, 100.0]) for east_m in (*range(-400, 401, 100), *range(400, -401, -100))]
    before = Aspect(target_m, legs_m[0])
    for camera_m in legs_m[1:12]:
        before.turned(target_m, camera_m)
    after = Aspect.restored(before.snapshot().moved(axes))
    for camera_m in legs_m[12:]:
        was, now = before.turned(target_m, camera_m), after.turned(axes.place(target_m), axes.place(camera_m))
        assert now.kept == pytest.approx(was.kept, rel=1e-9)
        assert now.visit == was.visit == 2


def test_sides_that_do_not_fit_raise() -> None:
    sound = Aspect(np.array([0.0, 1000.0, 0.0]), np.zeros(3)).snapshot()
    none = np.zeros_like(sound.visits)
    for wrong in (
        {"camera_enu_m": np.full(3, np.nan)},
        {"side": -1},
        {"side": sound.visits.size},
        {"visits": sound.visits + 5},
        {"visits": -sound.visits},
        {"visits": none},
        {"visits": sound.visits[:-1]},
        {"sightings": sound.sightings.astype(np.float64)},
    ):
        with pytest.raises(ValueError):
            replace(sound, **wrong)
    with pytest.raises(ValueError, match="sides"):
        Aspect.restored(replace(sound, visits=np.ones(3, np.int64), sightings=np.ones(3, np.int64), side=0))


def test_the_bootstrap_filter_is_not_kept() -> None:
    located = localizer(config=LocalizerConfig(filter="bootstrap", n_particles=500))
    with pytest.raises(ValueError, match="bootstrap"):
        located.snapshot()
    with pytest.raises(ValueError, match="bootstrap"):
        located.restore(LocalizerSnapshot(1, ()))


def test_only_before_the_first_step_and_where_there_is_room() -> None:
    before = localizer()
    flown(before, range(10))
    with pytest.raises(ValueError, match="no step before it"):
        before.restore(before.snapshot())
    (track,) = before.snapshot().tracks
    two = LocalizerSnapshot(8, (track, replace(track, life=replace(track.life, id=7))))
    with pytest.raises(ValueError, match="2 targets"):
        localizer(config=LocalizerConfig(n_particles=500, max_targets=1)).restore(two)


def filter_snapshot(**changes: Any) -> FilterSnapshot:
    one = CalibratedFilter.alone(300, np.random.default_rng(0))
    one.start(reported(0)[1][0], ERRORS)
    return replace(one.snapshot(), **changes)


def with_nan(array: FloatArray) -> FloatArray:
    return np.where(np.arange(array.size).reshape(array.shape) == 1, np.nan, array).astype(array.dtype)


@pytest.mark.parametrize(
    "name",
    [
        "origin_enu_m",
        "positions_m",
        "nuisances",
        "nuisance_covariance",
        "bias_variance",
        "widest_variance",
        "aim_sigma_rad",
    ],
)
def test_unsound_numbers_raise(name: str) -> None:
    sound = filter_snapshot()
    array = getattr(sound, name)
    for wrong in (with_nan(array), array[..., :-1] if array.ndim == 1 else array[:-1], np.zeros(0), np.zeros(())):
        with pytest.raises(ValueError, match=name):
            filter_snapshot(**{name: wrong})
    if name.endswith("variance") and not name.startswith("nuisances"):
        with pytest.raises(ValueError, match="covariance"):
            filter_snapshot(**{name: -array})


def test_unsound_lives_raise() -> None:
    before = localizer()
    flown(before, range(10))
    saved = before.snapshot()
    (track,) = saved.tracks
    for life in ({"id": 0}, {"misses": -1}, {"first_seen_s": np.nan}, {"first_position_enu_m": np.full(3, np.inf)}):
        with pytest.raises(ValueError):
            replace(track.life, **life)
    for wrong in (
        {"highest_m": np.nan},
        {"sizes_px": np.zeros(3)},
        {"unseen_steps": -1},
    ):
        with pytest.raises(ValueError):
            replace(track, **wrong)
    with pytest.raises(ValueError, match="next_id"):
        replace(saved, next_id=track.life.id)
    with pytest.raises(ValueError, match="differ"):
        replace(saved, tracks=(track, track))
