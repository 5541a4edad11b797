"""Landmarks of known place beside the corners: what they gain, and that a wrong one does no harm."""

from dataclasses import dataclass, replace

import numpy as np
import pytest

from distloc.geometry.rotations import matrix_from_rotation_vector
from distloc.scenery.compass import Compass
from distloc.scenery.corners import KnownCorners, seen_from
from distloc.scenery.known_places import KnownPlaces
from distloc.simulation.flights import Geometry
from distloc.types import FloatArray
from tests.distloc.scenery.flown import CAMERA, TOLD, Keyframe, flown

SIGMA_M = np.array([[2.0, 2.0, 3.0]])
SIGMA_PX = 0.7
MAST = np.array([60.0, 1900.0, 40.0])


def with_mast(frames: list[Keyframe], seed: int, told_m: FloatArray, seen_m: FloatArray) -> list[Keyframe]:
    """Each frame sees what stands at `seen_m` and takes it for the landmark, which is told to stand at `told_m`."""
    rng, out = np.random.default_rng(1000 + seed), []
    for frame in frames:
        R = frame.pose.R_cam_from_enu @ matrix_from_rotation_vector(frame.error[:3])
        line_m = seen_m - (frame.pose.position_enu_m - frame.error[3:])
        pixels, in_view = CAMERA.project((R @ line_m)[:, None])
        noisy = pixels + SIGMA_PX * rng.standard_normal((2, 1))
        known = KnownCorners(np.zeros(1, np.int64), noisy, np.full(1, SIGMA_PX), told_m[None])
        corners = replace(frame.corners, known=known if in_view[0] else KnownCorners())
        out.append(replace(frame, corners=corners))
    return out


@dataclass(frozen=True)
class Run:
    """Of each keyframe from the 20th: what the attitude is still wrong by (n, 3), its sigma (n, 3), landmarks used."""

    off_rad: FloatArray
    sigma_rad: FloatArray
    used: FloatArray
    compass: Compass

    @property
    def heading_rms_deg(self) -> float:
        return float(np.degrees(np.sqrt(np.square(self.off_rad[:, 2]).mean())))


def run(frames: list[Keyframe]) -> Run:
    compass = Compass(CAMERA, 5.0, 1.0, landmark_sigma_m=SIGMA_M)
    off, sigma, used = [], [], []
    for frame in frames:
        pose = compass.step(frame.pose, TOLD, frame.corners)
        wrong = pose.R_cam_from_enu.T @ frame.pose.R_cam_from_enu @ matrix_from_rotation_vector(frame.error[:3])
        off.append([wrong[2, 1] - wrong[1, 2], wrong[0, 2] - wrong[2, 0], wrong[1, 0] - wrong[0, 1]])
        assert pose.attitude is not None
        sigma.append(np.sqrt(np.diag(pose.attitude.covariance)))
        used.append(0 if compass.state is None else compass.state.landmarks)
    return Run(np.array(off[20:]) / 2.0, np.array(sigma[20:]), np.array(used[20:], dtype=np.float64), compass)


@pytest.mark.parametrize("geometry", ["perpendicular", pytest.param("orbit", marks=pytest.mark.thorough)])
def test_a_landmark_makes_the_heading_surer_and_what_is_told_is_what_is_found(geometry: Geometry) -> None:
    alone, with_it = [], []
    for seed in range(40, 42):
        frames = flown(seed, geometry, steps=70)
        place = MAST + SIGMA_M[0] * np.random.default_rng(seed).standard_normal(3)
        alone.append(run(frames))
        with_it.append(run(with_mast(frames, seed, MAST, place)))
    late = slice(25, None)  # it has agreed for long enough by then
    assert np.mean([one.used[late] for one in with_it]) > 0.8
    by_corners, by_both = (np.concatenate([one.off_rad[late] for one in runs]) for runs in (alone, with_it))
    told = np.concatenate([one.sigma_rad[late] for one in with_it])
    assert np.square(by_both[:, 2]).mean() < 0.5 * np.square(by_corners[:, 2]).mean()
    assert told[:, 2].mean() < 0.7 * np.concatenate([one.sigma_rad[late] for one in alone])[:, 2].mean()
    ratio = np.sqrt(np.square(by_both / told).mean(axis=0))
    assert (ratio > 0.2).all() and (ratio < 1.6).all() and ratio[2] > 0.4, ratio


@pytest.mark.parametrize("off_m", [30.0, 60.0, 100.0])
@pytest.mark.parametrize("axis", [0, pytest.param(1, marks=pytest.mark.thorough)])
def test_a_landmark_whose_place_is_wrong_does_no_harm(off_m: float, axis: int) -> None:
    """Aside it is soon found out, where the corners tell so much; along the line of sight it hardly matters."""
    for seed in range(50, 52):
        frames = flown(seed, steps=60)
        found = run(with_mast(frames, seed, MAST + off_m * np.eye(3)[axis], MAST))
        assert np.abs(found.off_rad / found.sigma_rad).max() < 4.0
        if axis == 0 and off_m > 30.0:  # that is 3 to 5 of the corners' sigmas
            assert found.compass.aided.misfits[0] > 15
            alone = run(frames)
            assert found.heading_rms_deg < 1.3 * alone.heading_rms_deg


def test_one_that_is_mistaken_for_another_from_some_moment_is_let_go() -> None:
    """What was told by it goes at once, with all that it told: the answer is as that of the corners again."""
    frames, other = flown(53, steps=80), MAST + np.array([90.0, 0.0, 0.0])
    right, wrong = (with_mast(frames, 53, MAST, place) for place in (MAST, other))
    found = run([*right[:55], *wrong[55:]])
    assert found.used[30] == 1.0 and (found.used[40:] == 0.0).all()
    assert np.abs(found.off_rad / found.sigma_rad).max() < 4.0
    after = run(frames)
    np.testing.assert_allclose(found.off_rad[-1], after.off_rad[-1], atol=1e-4)


def test_it_does_not_count_before_the_corners_can_judge_it() -> None:
    """A hover tells nothing of the heading: what is seen where it is expected may be anything."""
    frame = with_mast(flown(9, steps=3), 9, MAST, MAST)[0]
    compass = Compass(CAMERA, 5.0, 1.0, landmark_sigma_m=SIGMA_M)
    for second in range(25):
        compass.step(replace(frame.pose, stamp_s=float(second)), TOLD, frame.corners)
    assert not compass.aided.is_trusted.any() and compass.state is not None and compass.state.landmarks == 0


def test_nothing_grows_and_what_begins_anew_is_judged_anew() -> None:
    frames = flown(54, steps=70)
    seen = with_mast(frames, 54, MAST, MAST)
    compass = Compass(CAMERA, 5.0, 1.0, landmark_sigma_m=SIGMA_M)
    held = []
    for number, frame in enumerate(seen):
        compass.step(frame.pose, TOLD, frame.corners)
        window = compass.aided._window
        if number in (50, 69):
            assert window is not None and window.count == 25
            held.append((window._prior_H.shape, len(window._chains), window.known._rays.shape))
    assert held[0] == held[1]
    compass.step(replace(frames[0].pose, stamp_s=1e4), TOLD, seen[0].corners)
    assert compass.aided._window is None and not compass.aided.is_trusted.any()


def test_the_derivatives_of_a_known_place_are_those_of_its_residuals() -> None:
    rng = np.random.default_rng(2)
    frames = with_mast(flown(1, steps=6), 1, MAST, MAST)[:4]
    known = KnownPlaces(SIGMA_M, 6)
    for k, frame in enumerate(frames):
        known.add(k, seen_from(CAMERA, frame.pose, frame.corners.known), MAST[None])
    cameras_m = np.stack([frame.pose.position_enu_m for frame in frames])
    forward = np.stack([frame.pose.R_cam_from_enu[2] for frame in frames])
    errors = np.stack([frame.error for frame in frames]) + rng.normal(0.0, 1e-3, (4, 6))  # within Huber's weight 1
    state = np.concatenate([errors.reshape(-1), [0.01, -0.05], rng.normal(0.0, 1.0, 3)])

    def residuals(at: FloatArray) -> FloatArray:
        return known.linearised(4, at, 4, cameras_m, forward)[2].residuals.reshape(-1)

    H, g = known.normals(4, state, 4, cameras_m, forward)
    weights = np.minimum(1.0, 2.0 / np.linalg.norm(residuals(state).reshape(-1, 2), axis=1)).repeat(2)
    steps = 1e-6 * np.eye(state.size)
    J = np.stack([(residuals(state + one) - residuals(state - one)) / 2e-6 for one in steps], axis=1)
    np.testing.assert_allclose(H, J.T @ (weights[:, None] * J), rtol=1e-4, atol=1e-5 * np.abs(H).max())
    np.testing.assert_allclose(g, -J.T @ (weights * residuals(state)), rtol=1e-4, atol=1e-5 * np.abs(g).max())
