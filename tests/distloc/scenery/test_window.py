"""The window's mathematics: derivatives, what leaves it, and whether what it tells is what is found."""

import numpy as np
import pytest

from distloc.scenery.corners import seen_from
from distloc.scenery.information import Chain
from distloc.scenery.landmarks import Landmarks, exponentials
from distloc.scenery.window import Window
from distloc.types import FloatArray
from tests.distloc.scenery.flown import CAMERA, TOLD, Keyframe, flown

SLOW = np.square([TOLD.tilt_bias_rad] * 2 + [TOLD.heading_bias_rad] + [TOLD.position_bias_m] * 3)
WHITE = np.square([TOLD.attitude_white_rad] * 3 + [TOLD.position_m] * 3)


def chain(elapsed_s: float, slow: FloatArray = SLOW) -> Chain:
    kept = np.full(6, np.exp(-elapsed_s / TOLD.bias_time_constant_s))
    return Chain(kept, (1.0 - kept**2) * slow, WHITE, np.zeros(6))


def solved(
    frames: list[Keyframe], keyframes: int, lens_sigma: tuple[float, float] = (0.0, 0.0)
) -> tuple[Window, list[FloatArray]]:
    """The window after all frames, and after each (7,): the attitude's error left, its sigma, and squared distance."""
    window = Window(keyframes, 900, lens_sigma)
    told = []
    for number, frame in enumerate(frames):
        elapsed_s = 0.0 if number == 0 else frame.pose.stamp_s - frames[number - 1].pose.stamp_s
        link = chain(elapsed_s) if number else Chain(np.zeros(6), SLOW, WHITE, np.zeros(6))
        forward = frame.pose.R_cam_from_enu[2]
        window.add(frame.pose.position_enu_m, forward, link, seen_from(CAMERA, frame.pose, frame.corners))
        covariance = window.solve()[-6:]
        off = (frame.error - window.x[window.count - 1])[:3]
        P = covariance[:3, :3]
        told.append(np.concatenate([off, np.sqrt(np.diag(P)), [off @ np.linalg.solve(P, off)]]))
    return window, told


def test_the_derivatives_are_those_of_the_residuals(monkeypatch: pytest.MonkeyPatch) -> None:
    frames = flown(1, steps=6)
    pool = Landmarks(100, 6)
    places = np.stack([frame.pose.position_enu_m for frame in frames[:6]])
    forward = np.stack([frame.pose.R_cam_from_enu[2] for frame in frames[:6]])
    for k, frame in enumerate(frames[:6]):
        pool.add(k, seen_from(CAMERA, frame.pose, frame.corners), np.eye(3), places[k])
    sightings = pool.sightings(pool.counts() >= 2, 6)
    rng = np.random.default_rng(2)
    errors = rng.normal(0.0, 1.0, (6, 6)) * [0.02, 0.02, 0.05, 1.0, 1.0, 1.0]

    def residuals(state: FloatArray) -> FloatArray:
        return pool.normals(sightings, state[:-2].reshape(6, 6), state[-2:], places, forward).residuals

    seen: dict[str, FloatArray] = {}

    def eliminated(_: object, *args: FloatArray) -> None:
        seen.update(zip(("ki", "Jk", "Jc", "weighted", "residuals"), (args[2], *args[4:6], *args[7:9]), strict=True))

    state = np.append(errors.reshape(-1), [0.01, -0.05])
    with monkeypatch.context() as patch:
        patch.setattr(Landmarks, "_eliminated", eliminated)
        pool.normals(sightings, errors, state[-2:], places, forward)
    root = np.linalg.norm(seen["weighted"], axis=1) / np.linalg.norm(seen["residuals"], axis=1)
    for k, axis in ((0, 0), (1, 1), (2, 2), (3, 3), (4, 4), (5, 5), (6, 0), (6, 1)):
        step = 1e-6 * np.eye(38)[6 * k + axis]
        numeric = (residuals(state + step) - residuals(state - step)) / 2e-6
        told = seen["Jc"][:, :, axis] if k == 6 else np.where((seen["ki"] == k)[:, None], seen["Jk"][:, :, axis], 0.0)
        np.testing.assert_allclose(told / root[:, None], numeric, rtol=1e-5, atol=1e-5 * np.abs(numeric).max())


def test_what_leaves_the_window_leaves_what_it_knew() -> None:
    frames = flown(3)
    short, _ = solved(frames, 26)
    whole, _ = solved(frames, 60)
    assert short.count == 26 and whole.count == len(frames) == 46
    np.testing.assert_allclose(short.x[25, :3], whole.x[45, :3], atol=3e-4)
    np.testing.assert_allclose(short.x[25, 3:], whole.x[45, 3:], atol=0.2)


@pytest.mark.parametrize("geometry", ["perpendicular", "orbit", "lawnmower"])
def test_what_is_told_is_what_is_found(geometry: str) -> None:
    told = np.concatenate([np.array(solved(flown(seed, geometry), 25)[1])[12:] for seed in range(20, 26)])  # type: ignore[arg-type]
    nees = told[:, 6].mean() / 3.0
    assert 0.5 < nees < 1.5, nees
    heading_deg = float(np.degrees(np.sqrt(np.square(told[:, 2]).mean())))
    assert heading_deg < 0.5


def test_the_focal_length_is_found() -> None:
    window, told = solved(flown(5, "orbit", focal=0.02), 25, lens_sigma=(0.02, 0.0))
    assert window.lens_sigma[0] < 0.009
    assert abs(window.lens[0] - 0.02) < 3.0 * window.lens_sigma[0]
    assert np.abs(told[-1][:3] / told[-1][3:6]).max() < 3.0
    other, _ = solved(flown(5, "orbit"), 25, lens_sigma=(0.02, 0.0))
    assert abs(other.lens[0]) < 3.0 * other.lens_sigma[0]


@pytest.mark.parametrize("radial", [-0.05, 0.03])
def test_a_distortion_that_was_not_told_is_found_and_turns_no_heading(radial: float) -> None:
    window, told = solved(flown(5, "perpendicular", radial=radial), 25, lens_sigma=(0.02, 0.03))
    assert abs(window.lens[1] - radial) < 3.0 * window.lens_sigma[1]
    assert np.abs(told[-1][:3] / told[-1][3:6]).max() < 3.0
    assert window.lens_sigma[1] < 0.02
    _, blind = solved(flown(5, "perpendicular", radial=radial), 25, lens_sigma=(0.02, 0.0))
    assert np.abs(blind[-1][2] / blind[-1][5]) > 3.0


@pytest.mark.parametrize("radial", [0.0, -0.04])
def test_noise_of_the_corners_bends_no_lens_that_looks_along_the_flight(radial: float) -> None:
    """There the lens is told least: what errs alike in each sighting is a bias of many sigmas."""
    off = []
    for seed in range(30, 38):
        window, _ = solved(flown(seed, "head-on", radial=radial, steps=40), 25, lens_sigma=(0.02, 0.03))
        assert 0.002 < window.lens_sigma[1] < 0.02  # it is found, and hardly
        off.append((window.lens - [0.0, radial]) / window.lens_sigma)
    assert np.abs(np.mean(off, axis=0)).max() < 1.0, off
    assert 0.3 < np.sqrt(np.square(off).mean(axis=0))[1] < 1.6, off


def test_nothing_grows() -> None:
    frames = flown(6, steps=90)
    window, told = solved(frames, 10)
    held = [value.nbytes for value in vars(window.landmarks).values() if isinstance(value, np.ndarray)]
    again, _ = solved(frames[:12], 10)
    assert held == [value.nbytes for value in vars(again.landmarks).values() if isinstance(value, np.ndarray)]
    assert window._prior_H.shape == again._prior_H.shape
    assert np.isfinite(told).all()


def test_a_full_pool_says_so() -> None:
    frames = flown(7, steps=5)
    window = Window(10, 16)
    seen = seen_from(CAMERA, frames[0].pose, frames[0].corners)
    first = Chain(np.zeros(6), SLOW, WHITE, np.zeros(6))
    left = window.add(frames[0].pose.position_enu_m, frames[0].pose.R_cam_from_enu[2], first, seen)
    assert left == seen.names.size - 16


def test_exponentials_are_rotations_and_their_derivatives() -> None:
    rng = np.random.default_rng(8)
    vectors = np.concatenate([rng.normal(0.0, 0.3, (5, 3)), np.zeros((1, 3)), rng.normal(0.0, 1e-5, (2, 3))])
    exp, left = exponentials(vectors)
    np.testing.assert_allclose(exp @ exp.transpose(0, 2, 1), np.broadcast_to(np.eye(3), exp.shape), atol=1e-12)
    step = 1e-6 * rng.normal(size=3)
    moved, _ = exponentials(vectors + step)
    np.testing.assert_allclose(moved, exponentials(left @ step)[0] @ exp, atol=1e-10)


def test_corners_that_stray_more_than_usual_are_doubted_by_as_much() -> None:
    window, _ = solved(flown(3, steps=12), 10)
    assert window.used > 25
    assert window.doubt == pytest.approx(1.0, abs=0.3)  # as told, and as usual
    window.usual = 0.25  # of what was told: these stray by twice as much
    assert window.doubt == pytest.approx(4.0, rel=0.25)
