"""Landmarks of known place beside the corners: what they gain, and that a wrong one does no harm."""

from dataclasses import dataclass, replace

import numpy as np
import pytest

from distloc.geometry.rotations import matrix_from_rotation_vector
from distloc.scenery.compass import Compass
from distloc.scenery.corners import KnownCorners
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


def run(frames: list[Keyframe], most: int = 1) -> Run:
    compass = Compass(CAMERA, 5.0, 1.0, landmark_sigma_m=np.tile(SIGMA_M, (most, 1)))
    off, sigma, used = [], [], []
    for frame in frames:
        pose = compass.step(frame.pose, TOLD, frame.corners)
        wrong = pose.R_cam_from_enu.T @ frame.pose.R_cam_from_enu @ matrix_from_rotation_vector(frame.error[:3])
        off.append([wrong[2, 1] - wrong[1, 2], wrong[0, 2] - wrong[2, 0], wrong[1, 0] - wrong[0, 1]])
        assert pose.attitude is not None
        sigma.append(np.sqrt(np.diag(pose.attitude.covariance)))
        used.append(0 if compass.state is None else compass.state.landmarks)
    return Run(np.array(off[20:]) / 2.0, np.array(sigma[20:]), np.array(used[20:], dtype=np.float64), compass)


@pytest.mark.parametrize("geometry", ["perpendicular", "orbit"])
def test_a_landmark_makes_the_heading_surer_and_what_is_told_is_what_is_found(geometry: Geometry) -> None:
    alone, with_it, shares = [], [], []
    for seed in range(40, 43):
        frames = flown(seed, geometry, steps=70)
        place = MAST + SIGMA_M[0] * np.random.default_rng(seed).standard_normal(3)
        alone.append(run(frames))
        with_it.append(run(with_mast(frames, seed, MAST, place)))
        shares.append(with_it[-1].used.mean())
    rms = [float(np.sqrt(np.mean([one.heading_rms_deg**2 for one in runs]))) for runs in (alone, with_it)]
    off = np.concatenate([one.off_rad[:, 2] / one.sigma_rad[:, 2] for one in with_it])
    print(
        rms,
        shares,
        np.sqrt(np.square(off).mean()),
        [np.degrees(o.sigma_rad[:, 2].mean()) for o in with_it],
        [np.degrees(o.sigma_rad[:, 2].mean()) for o in alone],
    )
    print(
        np.sqrt(np.mean([np.square(o.off_rad / o.sigma_rad).mean(0) for o in with_it], 0)),
        np.degrees(np.mean([o.sigma_rad.mean(0) for o in with_it], 0)),
    )
    assert np.mean(shares) > 0.5


@pytest.mark.parametrize("off_m", [30.0, 100.0, 300.0])
def test_a_landmark_whose_place_is_wrong_does_not_count(off_m: float) -> None:
    for seed in range(50, 54):
        frames = flown(seed, steps=70)
        wrong = MAST + off_m * np.array([1.0, 0.0, 0.0])
        found = run(with_mast(frames, seed, wrong, MAST))
        alone = run(frames)
        print(
            off_m,
            seed,
            found.heading_rms_deg,
            alone.heading_rms_deg,
            found.used.mean(),
            np.abs(found.off_rad / found.sigma_rad).max(0),
            np.abs(alone.off_rad / alone.sigma_rad).max(0),
            found.compass.aided.misfits,
        )
