"""The errors of several platforms in one bank: whose is where, what each forgets, and what none of it may change."""

from dataclasses import replace

import numpy as np
import pytest

from distloc.filter.calibrated_filter import CalibratedFilter
from distloc.filter.densities import whitening
from distloc.filter.platforms import Names
from distloc.filter.turning import Views, ViewsByPlatform, covariances_m2
from distloc.sights.sight import Sight
from distloc.sights.sights import axes_along
from distloc.types import AttitudeError, CameraPose, FloatArray, PoseErrors

ERRORS = PoseErrors(0.05, 0.01, 0.002, 1.0, 100.0)
PLACE_ENU_M = np.array([0.0, 5000.0, 100.0])


def sight_from(camera_enu_m: FloatArray, stamp_s: float) -> Sight:
    along = PLACE_ENU_M - camera_enu_m
    return Sight(stamp_s, camera_enu_m, axes_along(along[None] / np.linalg.norm(along))[0], 4e-6 * np.eye(2))


def seen_by_two() -> CalibratedFilter:
    one = CalibratedFilter.alone(4096, np.random.default_rng(0), platforms=3)
    one.clear("a")
    one.start(sight_from(np.zeros(3), 0.0), ERRORS, aim_sigma_rad=np.array([0.002, 0.002]))
    one.board("b")
    one.predict(1.0, ERRORS)
    one.update(sight_from(np.array([5000.0, 0.0, 0.0]), 1.0))
    return one


def test_another_platform_s_error_is_all_of_it_and_once() -> None:
    one = CalibratedFilter.alone(500, np.random.default_rng(0), platforms=2)
    one.clear("a")
    one.start(sight_from(np.zeros(3), 0.0), ERRORS)
    known = one.bank.P[0, :3, :3].copy()
    one.board("b")
    one.predict(1.0, ERRORS)
    assert one.bank.P[0, :3, :3] == pytest.approx(ERRORS.bias_variance)
    assert one.bank.P[0, 5:, 5:] == pytest.approx(known)  # and that of the first is as it was
    assert (one.bank.P[0, :3, 3:] == 0.0).all() and (one.cloud.bias_rad == 0.0).all()


def test_one_that_is_followed_comes_with_what_is_told_of_it() -> None:
    one = CalibratedFilter.alone(500, np.random.default_rng(0), platforms=2)
    one.clear("a")
    one.start(sight_from(np.zeros(3), 0.0), ERRORS)
    one.board("b")
    told = AttitudeError(4.0 * np.eye(3), 0.9 * np.eye(3), 0.1 * np.eye(3), "scenery", np.array([0.3, 0.2, 0.1]))
    assert one.follow(1.0, told)
    assert one.bank.P[0, :3, :3] == pytest.approx(told.covariance)


def test_to_board_and_back_changes_nothing() -> None:
    one = seen_by_two()
    bank = one.bank
    before = [bank.particles.x.copy(), bank.P.copy(), bank.particles.scale.copy(), bank.stamp_s.copy()]
    mean_enu_m, bias_rad = one.mean_enu_m, one.cloud.bias_rad
    one.board("a")
    assert bank.stamp_s[0] == 0.0
    assert not np.allclose(one.cloud.bias_rad, bias_rad) and one.mean_enu_m == pytest.approx(mean_enu_m)
    one.board("b")
    after = [bank.particles.x, bank.P, bank.particles.scale, bank.stamp_s]
    assert all(np.array_equal(one, other) for one, other in zip(before, after, strict=True))


def test_who_does_not_look_forgets_when_it_looks_again() -> None:
    """By the time since its own last look, whatever the others did in between."""
    one = seen_by_two()
    before = one.bank.P[0].copy()
    one.predict(51.0, ERRORS)
    one.board("a")
    kept = np.exp(-2.0 * 51.0 / ERRORS.bias_time_constant_s)
    one.predict(51.0, ERRORS)
    own = kept * before[5:8, 5:8] + (1.0 - kept) * ERRORS.bias_variance
    assert one.bank.P[0, :3, :3] == pytest.approx(own)


def test_looks_again_leave_the_cloud_where_two_looks_put_it() -> None:
    """What the first told is as exact after the particles were spread about the second camera."""
    one = seen_by_two()
    errors, places = replace(ERRORS, bias_time_constant_s=1e9), (np.zeros(3), np.array([5000.0, 0.0, 0.0]))
    spread_m = np.sqrt(np.linalg.det(one.cloud.covariance_enu_m2[:2, :2]))
    for look in range(30):
        one.board("ab"[look % 2])
        one.predict(2.0 + look, errors)
        one.update(sight_from(places[look % 2], 2.0 + look))
    again_m = np.sqrt(np.linalg.det(one.cloud.covariance_enu_m2[:2, :2]))
    assert 0.8 < again_m / spread_m < 1.1


def test_a_place_begins_anew_with_all_errors_unknown() -> None:
    one = seen_by_two()
    one.start(sight_from(np.zeros(3), 9.0), ERRORS)
    assert (one.bank.P[0, 5:] == 0.0).all() and (one.bank.particles.x[0, 8:] == 0.0).all()
    one.board("a")
    one.predict(9.0, ERRORS)
    assert one.bank.P[0, :3, :3] == pytest.approx(ERRORS.bias_variance)


def test_names_are_numbered_as_they_come() -> None:
    names = Names(2)
    assert [names.number(one) for one in ("x", "", "x")] == [0, 1, 0] and len(names) == 2
    with pytest.raises(ValueError, match=r"^CameraPose.platform 'y' is one name too many after 'x', ''"):
        names.number("y")


def circled(platform: str, centre_m: tuple[float, float]) -> list[CameraPose]:
    """A loiter of 200 m about a point."""
    turns_rad = np.linspace(0.0, 2.0 * np.pi, 40)
    east_m, north_m = centre_m[0] + 200.0 * np.sin(turns_rad), centre_m[1] + 200.0 * np.cos(turns_rad)
    return [
        CameraPose(
            float(k), np.array([east_m[k], north_m[k], 0.0]), np.eye(3), heading_rad=turns_rad[k], platform=platform
        )
        for k in range(40)
    ]


def test_each_craft_s_compass_has_a_sinusoid_of_its_own() -> None:
    errors = replace(ERRORS, bias_turn_rad=2.0)
    one, both, same = ViewsByPlatform(), ViewsByPlatform(), ViewsByPlatform()
    for pose in circled("a", (0.0, 0.0)):
        one.add(pose, errors)
        both.add(pose, errors)
        same.add(pose, errors)
    for pose in circled("b", (5000.0, 5000.0)):
        both.add(pose, errors)
        same.add(replace(pose, platform="a"), errors)
    places = np.repeat(PLACE_ENU_M[None], 3, axis=0)
    alone_m2, both_m2, same_m2 = covariances_m2([one.all, both.all, same.all], places, errors)
    # two errors that have nothing to do with each other, of the same size, weigh half as much
    assert np.trace(both_m2) == pytest.approx(np.trace(alone_m2) / 2.0, rel=0.1)
    assert (np.linalg.eigvalsh(both_m2) > 0.0).all()
    assert not np.allclose(both_m2, same_m2)
    (mirrored,) = covariances_m2([both.all[::-1]], places[:1], errors)
    assert mirrored == pytest.approx(both_m2)


def test_views_of_one_platform_are_as_without_a_name() -> None:
    errors, alone, named = replace(ERRORS, bias_turn_rad=2.0), Views(), ViewsByPlatform()
    for pose in circled("a", (0.0, 0.0)):
        alone.add(pose, errors)
        named.add(pose, errors)
    (told,) = covariances_m2([named.all], PLACE_ENU_M[None], errors)
    assert (told == alone.covariance_m2(PLACE_ENU_M, errors)).all() and (named.rows == alone.rows).all()
    assert (ViewsByPlatform(named.rows, "a").rows == alone.rows).all()


def test_a_flat_covariance_is_whitened_to_numbers() -> None:
    """Particles beside a camera that never saw them spread over tangents that rounding makes one line."""
    flat = np.array([[[1e6, 1e6], [1e6, 1e6 - 1e-3]]])
    assert np.isfinite(whitening(flat)).all()
