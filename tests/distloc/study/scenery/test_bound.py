"""The bound with corners: against the bound without, against all unknowns at once by finite differences, its order."""

from dataclasses import replace

import numpy as np
import pytest

from distloc.geometry.rotations import matrix_from_rotation_vector
from distloc.simulation.corners import corners_along
from distloc.simulation.flights import Flight, Geometry, flight_past
from distloc.study.bound import NoiseModel, position_bound
from distloc.study.scenery.bound import Followed, followed_on, scenery_bound
from distloc.types import CameraPose, FloatArray
from tests.support.cube_samples import CAMERA

TARGET = np.array([30.0, 1000.0, 150.0])
NOISE = NoiseModel(
    pixel_px=0.5,
    rotation_white_rad=float(np.radians(0.1)),
    translation_white_m=0.3,
    heading_bias_rad=float(np.radians(2.0)),
    tilt_bias_rad=float(np.radians(0.5)),
    tau_s=120.0,
    position_drift_m=1.5,
)
NOBODY = Followed(np.zeros(0, dtype=np.intp), np.zeros(0, dtype=np.intp), np.zeros((0, 3)))


def flown(geometry: Geometry, step_m: float = 50.0) -> Flight:
    return flight_past(geometry, TARGET, 1000.0, 1000.0, step_m, height_m=120.0, wobble_rad=0.02)


def poses_of(flight: Flight) -> list[CameraPose]:
    return [flight.pose_at(float(stamp_s)) for stamp_s in flight.stamps_s]


def map_error_m(covariance_m2: FloatArray) -> FloatArray:
    return np.sqrt(covariance_m2[..., 0, 0] + covariance_m2[..., 1, 1])


@pytest.mark.parametrize("geometry", ["perpendicular", "orbit"])
def test_without_corners_it_is_the_bound_of_smoke_alone(geometry: Geometry) -> None:
    poses = poses_of(flown(geometry))
    expected, found = position_bound(CAMERA, poses, TARGET, NOISE), scenery_bound(CAMERA, poses, TARGET, NOISE, NOBODY)
    assert not np.isfinite(found[0]).all()
    np.testing.assert_allclose(found[4:, :2, :2], expected[4:, :2, :2], rtol=2e-3)


def test_it_is_the_inverse_of_the_information_of_all_unknowns_at_once() -> None:
    poses = poses_of(flown("perpendicular", 250.0))  # 5 frames
    places = np.array([[-200.0, 600.0, 10.0], [50.0, 700.0, 0.0], [100.0, 300.0, 20.0], [0.0, 1500.0, 30.0]])
    frames, corners = (one.reshape(-1) for one in np.meshgrid(np.arange(5), np.arange(4), indexing="ij"))
    shown = [CAMERA.project((poses[k].R_cam_from_enu @ (places[i] - poses[k].position_enu_m))[:, None])[1][0]
             for k, i in zip(frames, corners, strict=True)]  # fmt: skip
    frames, corners = frames[shown], corners[shown]
    found = scenery_bound(CAMERA, poses, TARGET, NOISE, Followed(frames, corners, places[corners]))[-1]

    def residuals(unknown: FloatArray) -> FloatArray:
        points, errors = unknown[:15].reshape(5, 3), unknown[15:].reshape(5, 6)
        seen = [(4, k, NOISE.pixel_px) for k in range(5)] + [(i, k, 0.7) for k, i in zip(frames, corners, strict=True)]
        rows = []
        for point, k, sigma_px in seen:
            R = poses[k].R_cam_from_enu @ matrix_from_rotation_vector(errors[k, :3])
            rows.append(CAMERA.project((R @ (points[point] - poses[k].position_enu_m - errors[k, 3:]))[:, None])[0])
            rows[-1] = rows[-1][:, 0] / sigma_px
        return np.concatenate(rows)

    at = np.concatenate([places.reshape(-1), TARGET, np.zeros(30)])
    steps = np.array([1e-2] * 15 + [*[1e-6] * 3, *[1e-3] * 3] * 5)
    J = np.stack(
        [(residuals(at + h * e) - residuals(at - h * e)) / (2 * h) for h, e in zip(steps, np.eye(45), strict=True)], 1
    )
    stamps_s = np.array([pose.stamp_s for pose in poses])
    kept = np.exp(-np.abs(stamps_s[:, None] - stamps_s) / NOISE.tau_s)
    slow = np.array([NOISE.tilt_bias_rad, NOISE.tilt_bias_rad, NOISE.heading_bias_rad, *[NOISE.position_drift_m] * 3])
    white = np.array([NOISE.rotation_white_rad] * 3 + [NOISE.translation_white_m] * 3)
    prior = np.kron(kept, np.diag(slow**2)) + np.kron(np.eye(5), np.diag(white**2))
    information = J.T @ J
    information[:12, :12] += np.eye(12) / 1e8
    information[15:, 15:] += np.linalg.inv(prior)
    scale = 1.0 / np.sqrt(np.diag(information))
    expected = (np.linalg.inv(information * np.outer(scale, scale)) * np.outer(scale, scale))[12:15, 12:15]
    np.testing.assert_allclose(found, expected, rtol=2e-3)
    assert map_error_m(found) < 0.8 * map_error_m(position_bound(CAMERA, poses, TARGET, NOISE)[-1])


@pytest.mark.parametrize("geometry", ["perpendicular", "orbit"])
def test_corners_help_and_never_more_than_exact_poses_would(geometry: Geometry) -> None:
    flight = flown(geometry)
    poses = poses_of(flight)
    followed = followed_on(poses, corners_along(CAMERA, flight, np.random.default_rng(5)))
    found = map_error_m(scenery_bound(CAMERA, poses, TARGET, NOISE, followed))
    alone = map_error_m(position_bound(CAMERA, poses, TARGET, NOISE))
    exact = map_error_m(position_bound(CAMERA, poses, TARGET, NoiseModel(pixel_px=NOISE.pixel_px)))
    assert (found[5:] < 0.6 * alone[5:]).all() and (found[5:] > exact[5:]).all()
    assert (np.diff(found[3:]) < 1e-6).all()  # another frame never takes anything away
    worse = map_error_m(scenery_bound(CAMERA, poses, TARGET, NOISE, followed, corner_px=2.0))
    assert (found[5:] < worse[5:]).all() and (worse[5:] < alone[5:]).all()


def test_errors_that_it_can_not_take_are_refused() -> None:
    poses = poses_of(flown("perpendicular", 250.0))
    for noise in (
        replace(NOISE, time_offset_s=0.1),
        replace(NOISE, position_bias_m=1.0),
        replace(NOISE, missed=0.1),
        replace(NOISE, rotation_about="origin"),
    ):
        with pytest.raises(ValueError, match="must be 0 and rotation_about 'camera'"):
            scenery_bound(CAMERA, poses, TARGET, noise, NOBODY)
