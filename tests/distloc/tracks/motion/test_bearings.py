"""Whose error a bearing has, and that of all that look in turns some stay."""

from dataclasses import replace

import numpy as np

from distloc.sights.sights import Ray, ray_of
from distloc.tracks.motion.bearings import AGE, AZIMUTH, EAST, ENOUGH, MOST, SOURCE, Bearings, correlated
from distloc.types import AttitudeError, CameraPose, Detection, PoseErrors, Root
from tests.support.cube_samples import CAMERA, R_NORTH

TARGET_M = np.array([0.0, 2000.0, 0.0])
ERRORS = PoseErrors(np.radians(2.0), np.radians(0.5), np.radians(0.1), 1.0, 100.0)


def ray(stamp_s: float, platform: str = "") -> Ray:
    """Of what is in the middle of a picture that a camera took so far in the east."""
    pose = CameraPose(stamp_s, np.array([stamp_s, 0.0, 100.0]), R_NORTH, platform=platform)
    return ray_of(CAMERA, pose, Detection.from_point(CAMERA.cx, CAMERA.cy, 1.0), "centre")


def smoke(stamp_s: float, east_m: float, up_m: float, north_m: float = 0.0, platform: str = "") -> Ray:
    """Of smoke with a root of 40 m that begins so far beside and over the target, from 100 m up."""
    pose = CameraPose(stamp_s, np.array([0.0, north_m, 100.0]), R_NORTH, platform=platform)
    pixels, _ = CAMERA.project(R_NORTH @ (TARGET_M + np.array([east_m, 0.0, up_m]) - pose.position_enu_m)[:, None])
    px_a_m = CAMERA.fx / (TARGET_M[1] - north_m)
    size_px, base_px = 100.0 * px_a_m, pixels[:, 0]
    return ray_of(
        CAMERA,
        pose,
        Detection(
            centre_px=base_px - np.array([0.0, size_px / 2.0]),
            base_px=base_px,
            covariance_px2=np.eye(2) * size_px**2 / 12.0,
            area_px=size_px**2,
            width_px=size_px,
            height_px=size_px,
            sigma_px=1.0,
            touches_border=False,
            is_cut=(False, False),
            is_base_cut=(False, False),
            root=Root(40.0 * px_a_m, 1.0, 0.0),
        ),
        "base",
    )


def in_turns(steps: int, *platforms: str) -> Bearings:
    bearings = Bearings()
    for step in range(steps):
        bearings.add(ray(float(step), platforms[step % len(platforms)]), ERRORS, 0.002, TARGET_M)
    return bearings


def test_a_slow_error_is_of_one_platform() -> None:
    bearings = in_turns(8, "a", "b")
    rows = bearings.rows
    assert len(set(rows[:, SOURCE])) == 2
    # each forgets itself in its own time, from its own first sighting
    assert np.allclose(rows[::2, AGE], [0.0, 0.02, 0.04, 0.06]) and np.allclose(rows[1::2, AGE], rows[::2, AGE])
    covariance = correlated(rows[None], np.ones((1, 8), np.bool_), np.zeros(1), 0.1, np.ones(1))[0, 0]
    assert (covariance[::2, 1::2] == 0.0).all() and covariance[0, 2] > 0.9 * np.radians(2.0) ** 2


def test_what_begins_anew_or_jumps_is_that_of_one_platform() -> None:
    bearings = in_turns(4, "a", "b")
    bearings.jumped(0.1, "b")
    assert np.allclose(bearings.rows[:, AZIMUTH], [0.0, 0.1, 0.0, 0.1])
    bearings.forget_error("b")
    bearings.forget_error("c")  # which never looked
    for stamp_s, name in ((4.0, "a"), (5.0, "b")):
        bearings.add(ray(stamp_s, name), ERRORS, 0.002, TARGET_M)
    first, second = bearings.rows[-2:, AGE]
    assert first < 0.1 and second > 5.0


def test_what_the_scenery_measured_stays_what_it_is() -> None:
    measured = AttitudeError(np.eye(3) * 1e-4, np.eye(3), np.zeros((3, 3)), "scenery")
    bearings = Bearings()
    for step in range(6):
        one = ray(float(step))
        by_scenery = replace(one, pose=replace(one.pose, attitude=measured))
        bearings.add(by_scenery if step % 2 else one, ERRORS, 0.002, TARGET_M)
    was = bearings.rows
    bearings.jumped(0.1, "")
    bearings.forget_error("")
    bearings.add(ray(6.0), ERRORS, 0.002, TARGET_M)
    again = Bearings(bearings.rows)
    for held in (bearings, again):
        one = ray(7.0)
        held.add(replace(one, pose=replace(one.pose, attitude=measured)), ERRORS, 0.002, TARGET_M)
        rows = held.rows
        assert np.allclose(rows[1:6:2, AZIMUTH], was[1::2, AZIMUTH])
        assert np.allclose(rows[:6:2, AZIMUTH], was[::2, AZIMUTH] + 0.1)
        assert np.allclose(np.diff(rows[1::2, AGE]), 0.02)  # its error goes on
        assert rows[6, AGE] - rows[4, AGE] > 5.0  # the autopilot's is another


def test_of_all_platforms_that_look_in_turns_bearings_stay() -> None:
    for platforms in (("a",), ("a", "b"), tuple("abcdefghijklmnop")):
        for steps in (33, 200, 1000):
            rows = in_turns(steps, *platforms).rows
            of_each = [int((rows[:, SOURCE] == one).sum()) for one in np.unique(rows[:, SOURCE])]
            assert MOST // 4 <= len(rows) <= MOST and len(of_each) == len(platforms)
            assert max(of_each) - min(of_each) <= 1
            assert (np.diff(rows[:, EAST]) > 0.0).all() and rows[0, EAST] < len(platforms)


def test_they_go_on_from_their_rows() -> None:
    bearings = in_turns(9, "a", "b")
    again = Bearings(bearings.rows)
    for one in (bearings, again):
        one.add(ray(9.0, "b"), ERRORS, 0.002, TARGET_M)
    assert again.rows.tolist() == bearings.rows.tolist()


def test_a_puff_that_has_left_the_fire_tells_no_bearing() -> None:
    bearings = Bearings()
    heights_m = [0.0, 4.0, -4.0, 2.0, 1.0, 3.0, 35.0, 45.0, 65.0, 0.0, 3.0]
    told = [bearings.add(smoke(float(k), up_m, up_m), ERRORS, 0.002, TARGET_M) for k, up_m in enumerate(heights_m)]
    assert told == [True] * 6 + [False] * 3 + [True] * 2
    assert bearings.count == 8 and np.abs(bearings.rows[:, AZIMUTH]).max() < 0.003


def test_there_are_bearings_to_judge_by_whatever_the_foot_does() -> None:
    bearings = Bearings()
    told = [bearings.add(smoke(float(k), 0.0, 40.0 * k), ERRORS, 0.002, TARGET_M) for k in range(9)]
    assert told == [True] * ENOUGH + [False] * 3


def test_an_autopilot_that_begins_anew_sees_the_foot_elsewhere() -> None:
    bearings = Bearings()
    for k in range(ENOUGH):
        bearings.add(smoke(float(k), 0.0, 0.0), ERRORS, 0.002, TARGET_M)
    bearings.forget_error("")
    assert all(bearings.add(smoke(6.0 + k, 0.0, 70.0), ERRORS, 0.002, TARGET_M) for k in range(3))


def test_a_foot_that_stays_high_is_where_the_smoke_begins() -> None:
    bearings = Bearings()
    for k in range(ENOUGH):
        bearings.add(smoke(float(k), 0.0, 0.0), ERRORS, 0.002, TARGET_M)
    told = [bearings.add(smoke(6.0 + k, 0.0, 40.0), ERRORS, 0.002, TARGET_M) for k in range(35)]
    assert not any(told[:5]) and all(told[16:])


def test_a_camera_that_flies_away_or_another_one_sees_no_puff() -> None:
    for far in (1.0, 4.0):  # times as far as it is: what is taken for its place hardly matters
        bearings = Bearings()
        for k in range(MOST):
            one = smoke(float(k), 0.0, 0.0, north_m=-40.0 * k)  # flown away from: the foot comes up
            assert bearings.add(one, ERRORS, 0.002, far * TARGET_M)
    bearings = Bearings()
    for k in range(12):  # two whose tilts differ by two degrees
        up_m = 70.0 * (k % 2)
        assert bearings.add(smoke(float(k), 0.0, up_m, platform="ab"[k % 2]), ERRORS, 0.002, TARGET_M)
