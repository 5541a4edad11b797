"""The compass: what it hands on, when it stands back, and what may come in."""

from dataclasses import replace

import numpy as np
import pytest

from distloc.geometry.camera import Camera
from distloc.geometry.rotations import matrix_from_rotation_vector
from distloc.scenery.compass import Compass, SceneryReason
from distloc.scenery.corners import Corners, seen_from
from distloc.types import CameraPose, FloatArray
from tests.distloc.scenery.flown import CAMERA, TOLD, Keyframe, flown


def compass() -> Compass:
    return Compass(CAMERA, 5.0, 1.0)


def stepped(made: Compass, frames: list[Keyframe]) -> list[CameraPose]:
    return [made.step(frame.pose, TOLD, frame.corners) for frame in frames]


def off_rad(pose: CameraPose, frame: Keyframe) -> FloatArray:
    """What a pose's attitude is still wrong by (3,)."""
    true = frame.pose.R_cam_from_enu @ matrix_from_rotation_vector(frame.error[:3])
    wrong = pose.R_cam_from_enu.T @ true
    return np.array([wrong[2, 1] - wrong[1, 2], wrong[0, 2] - wrong[2, 0], wrong[1, 0] - wrong[0, 1]]) / 2.0


def heading_rms_deg(poses: list[CameraPose], frames: list[Keyframe]) -> float:
    off = [off_rad(pose, frame)[2] for pose, frame in zip(poses, frames, strict=True)]
    return float(np.degrees(np.sqrt(np.square(off).mean())))


def test_without_corners_a_pose_stays_as_it_is() -> None:
    frames = flown(1, steps=6)
    made = compass()
    for frame in frames:
        pose = made.step(frame.pose, TOLD, None)
        assert pose == replace(frame.pose, errors=TOLD) and pose.attitude is None
    assert not made.is_used and made.state is None


@pytest.mark.parametrize("heading_deg", [2.0, 5.0])
def test_the_heading_comes_out_whatever_was_told(heading_deg: float) -> None:
    errors, sigmas = [], []
    for seed in range(30, 36):
        frames = flown(seed, heading_deg=heading_deg)
        poses = stepped(compass(), frames)
        errors.append(heading_rms_deg(poses[20:], frames[20:]))
        sigmas.append(np.degrees(np.sqrt(np.mean([pose.attitude.covariance[2, 2] for pose in poses[20:]]))))  # type: ignore[union-attr]
        assert all(pose.attitude is not None and pose.attitude.source == "scenery" for pose in poses[20:])
    assert np.median(errors) < 0.35
    least = 0.5 if heading_deg == 2.0 else 0.1  # on one course what is over three told sigmas is told a third of it
    assert least < np.mean(errors) / np.mean(sigmas) < 1.5


def test_what_is_handed_on_fits_together() -> None:
    frames = flown(2)
    before = None
    taken_over = 0
    for pose in stepped(compass(), frames):
        attitude = pose.attitude
        assert attitude is not None
        assert np.linalg.eigvalsh(attitude.new)[0] >= 0.0
        assert np.linalg.norm(attitude.kept, ord=2) <= 1.0 + 1e-9
        if attitude.found_rad is not None:  # what it keeps is then the autopilot's
            taken_over += 1
            assert before is not None and before.source == "autopilot"
            assert np.linalg.eigvalsh(before.covariance - attitude.covariance)[0] > -1e-6
        elif before is not None and before.source == attitude.source == "scenery":
            made = attitude.kept @ before.covariance @ attitude.kept.T + attitude.new
            np.testing.assert_allclose(made, attitude.covariance, rtol=1e-6, atol=1e-12)
        before = attitude
    assert taken_over == 1 and before is not None and before.source == "scenery"


def test_a_step_of_the_heading_that_nobody_reported_is_seen() -> None:
    frames = flown(3)
    turned = matrix_from_rotation_vector(np.array([0.0, 0.0, np.radians(4.0)]))
    after = [
        replace(
            frame,
            pose=replace(frame.pose, R_cam_from_enu=frame.pose.R_cam_from_enu @ turned),
            error=frame.error - [0.0, 0.0, np.radians(4.0), 0.0, 0.0, 0.0],
        )
        for frame in frames[25:]
    ]
    made = compass()
    poses = stepped(made, [*frames[:25], *after])
    assert heading_rms_deg(poses[25:], after) < 0.5
    assert made.state is not None and made.state.jumps == 1


def test_a_step_of_the_heading_that_was_reported_is_taken_off() -> None:
    frames = flown(4)
    by_rad = float(np.radians(20.0))  # clockwise
    turned = matrix_from_rotation_vector(np.array([0.0, 0.0, by_rad]))
    made = compass()
    stepped(made, frames[:25])
    made.heading_jumped(by_rad)
    after = [
        replace(frame, pose=replace(frame.pose, R_cam_from_enu=frame.pose.R_cam_from_enu @ turned))
        for frame in frames[25:]
    ]
    after = [replace(frame, error=frame.error - [0.0, 0.0, by_rad, 0.0, 0.0, 0.0]) for frame in after]
    assert heading_rms_deg(stepped(made, after), after) < 0.5
    assert made.state is not None and made.state.jumps == 0


def test_a_place_that_jumps_by_60_m_does_not_turn_the_heading() -> None:
    frames = flown(5)
    after = [
        replace(frame, pose=replace(frame.pose, position_enu_m=frame.pose.position_enu_m + np.array([0.0, 60.0, 0.0])))
        for frame in frames[25:]
    ]
    poses = stepped(compass(), [*frames[:25], *after])
    off_m = [
        np.linalg.norm(pose.position_enu_m - frame.pose.position_enu_m)
        for pose, frame in zip(poses, frames, strict=True)
    ]
    assert max(off_m) < 5.0, "as it was before"
    assert [pose.errors.position_bias_m > 25.0 for pose in poses if pose.errors] == [k >= 25 for k in range(len(poses))]
    off = np.array([off_rad(pose, frame)[2] for pose, frame in zip(poses[25:], after, strict=True)])
    sigma = np.array([pose.errors.heading_bias_rad for pose in poses[25:] if pose.errors])
    assert np.abs(off / sigma).max() < 3.5


def test_few_corners_leave_the_autopilots_attitude() -> None:
    made = compass()
    frames = [replace(frame, corners=Corners.none()) for frame in flown(6)]
    for pose, frame in zip(stepped(made, frames), frames, strict=True):
        assert pose.attitude is not None and pose.attitude.source == "autopilot"
        np.testing.assert_array_equal(pose.R_cam_from_enu, frame.pose.R_cam_from_enu)
        np.testing.assert_allclose(np.sqrt(pose.attitude.covariance[2, 2]), TOLD.heading_bias_rad)
    assert made.reasons[SceneryReason.FEW_CORNERS] == len(frames)


def test_scenery_that_is_lost_is_remembered_for_a_while_and_then_is_not() -> None:
    frames = flown(7)
    made = compass()
    stepped(made, frames[:30])
    assert made.is_used
    dark = [replace(frame, corners=Corners.none()) for frame in frames[30:]]
    sigma = [pose.errors.heading_bias_rad for pose in stepped(made, dark) if pose.errors]
    assert sigma[0] < TOLD.heading_bias_rad / 3.0
    assert (np.diff(sigma) > -1e-4).all()


def test_corners_that_do_not_belong_together_are_refused() -> None:
    rng = np.random.default_rng(8)
    frames = flown(8)
    made = compass()
    for frame in frames:
        pixels = rng.uniform([[20.0], [20.0]], [[1260.0], [700.0]], (2, 40))
        pose = made.step(frame.pose, TOLD, Corners(np.arange(40), pixels, np.full(40, 0.5)))
        assert pose.attitude is not None and pose.attitude.source == "autopilot"
    assert made.reasons[SceneryReason.MISFIT] + made.reasons[SceneryReason.UNSOLVED] > 10


def test_a_hover_tells_nothing_of_the_heading_and_says_so() -> None:
    frames = flown(9)
    still = [
        replace(frames[0].pose, stamp_s=float(second), position_enu_m=frames[0].pose.position_enu_m)
        for second in range(30)
    ]
    made = compass()
    for pose in still:
        given = made.step(pose, TOLD, frames[0].corners)
        assert given.attitude is not None and given.attitude.source == "autopilot"
    assert made.reasons[SceneryReason.NOT_SURER] > 20


def test_gaps_and_stamps_that_stand_or_go_back_begin_anew() -> None:
    frames = flown(10)
    made = compass()
    stepped(made, frames[:20])
    assert made.is_used
    for stamp_s in (frames[19].pose.stamp_s + 100.0, 5.0, 5.0, 5.0):
        pose = made.step(replace(frames[20].pose, stamp_s=stamp_s), TOLD, frames[20].corners)
        assert np.isfinite(pose.R_cam_from_enu).all()
    assert made.reasons[SceneryReason.GAP] == 2


def test_an_attitude_that_is_doubted_is_measured_anew() -> None:
    frames = flown(11)
    made = compass()
    stepped(made, frames[:25])
    made.doubt_attitude()
    tilted = matrix_from_rotation_vector(np.radians([0.0, 0.0, 3.0]))
    after = [
        replace(
            frame,
            pose=replace(frame.pose, R_cam_from_enu=frame.pose.R_cam_from_enu @ tilted),
            error=frame.error - [0.0, 0.0, np.radians(3.0), 0.0, 0.0, 0.0],
        )
        for frame in frames[25:]
    ]
    assert heading_rms_deg(stepped(made, after), after) < 0.6


@pytest.mark.parametrize(
    "camera",
    [
        Camera(1280, 720, 900.0, 900.0, 639.5, 359.5, (0.1, 0.0, 0.0, 0.0), "fisheye"),
        Camera(1280, 720, 700.0, 700.0, 639.5, 359.5, (-0.4, 0.15, 0.001, 0.001, 0.0)),
        Camera(1280, 720, 900.0, 900.0, 639.5, 359.5, (-1.2, 0.0, 0.0, 0.0)),  # folds back inside the image
    ],
    ids=["fisheye", "barrel", "folding"],
)
def test_any_lens_and_what_it_cannot_invert(camera: Camera) -> None:
    pose = flown(12, steps=3)[0].pose
    u, v = np.meshgrid(np.linspace(0.0, 1279.0, 9), np.linspace(0.0, 719.0, 7))
    pixels = np.stack([u, v]).reshape(2, -1)
    pixels[0, 0] = np.nan
    corners = Corners(np.arange(63), pixels, np.full(63, 0.5))
    seen = seen_from(camera, pose, corners)
    assert 10 <= seen.names.size <= 62 and 0 not in seen.names
    back_px, _ = camera.project(pose.R_cam_from_enu @ seen.rays.T)
    assert np.abs(back_px - pixels[:, seen.names]).max() < 0.5
    assert np.isfinite(seen.whiten).all() and (seen.depth_m > 0.0).all()
    # an error of half a pixel is one standard deviation
    ray = pose.R_cam_from_enu.T @ camera.rays(pixels[:, seen.names] + [[0.5], [0.0]])
    off = np.einsum("nij,jn->ni", seen.whiten, ray)
    np.testing.assert_allclose(np.linalg.norm(off, axis=1), 1.0, atol=0.05)


@pytest.mark.parametrize("turns", [False, True])
def test_a_heading_beyond_what_is_told_is_sure_once_it_was_the_same_on_two_courses(turns: bool) -> None:
    frames = flown(3, "lawnmower" if turns else "perpendicular", steps=80)
    turned = matrix_from_rotation_vector(np.array([0.0, 0.0, np.radians(-15.0)]))
    made = compass()
    for frame in frames:
        made.step(replace(frame.pose, R_cam_from_enu=frame.pose.R_cam_from_enu @ turned), TOLD, frame.corners)
    state = made.state
    assert state is not None and made.is_used
    assert abs(np.degrees(state.error_rad[2])) > 10.0
    assert np.degrees(state.fit_sigma_rad) < 0.5
    share = float(state.sigma_rad[2] / abs(state.error_rad[2]))
    assert share < 0.1 if turns else share == pytest.approx(1.0 / 3.0, rel=1e-6)


def test_it_is_waited_for_but_not_for_ever() -> None:
    """Corners that fit nothing begin the window anew all the time: what is about to tell need not ever."""
    rng = np.random.default_rng(8)
    made = compass()
    awaited = []
    for frame in flown(9, steps=80):
        mixed = replace(frame.corners, pixels=frame.corners.pixels[:, rng.permutation(frame.corners.names.size)])
        pose = made.step(frame.pose, TOLD, mixed)
        assert pose.attitude is not None
        awaited.append(pose.attitude.is_about_to_tell)
    assert sum(awaited) <= 15 and not any(awaited[40:])
