"""Which segments a target can be: the gate spares work and loses nothing that would have counted."""

from dataclasses import replace

import numpy as np

from distloc.filter.bank import Bank
from distloc.filter.settings import LocalizerConfig
from distloc.geometry.camera import Camera
from distloc.sights.sight import Sights
from distloc.sights.sights import Expected, rays_of, sights_of
from distloc.tracks.expected import may_be
from distloc.types import CameraPose, Detection
from tests.support.cube_samples import CAMERA, CUBE_ENU_M, R_NORTH, pose_at

ERRORS = LocalizerConfig().pose_errors
WIDE = replace(CAMERA, fx=700.0, fy=700.0, distortion=(-0.2, 0.03, 0.0, 0.0))


def grid(camera: Camera) -> list[Detection]:
    """Segments all over an image."""
    places = [(u, v) for u in np.linspace(40.0, camera.width - 40.0, 24) for v in np.linspace(40.0, 1000.0, 12)]
    return [Detection.from_point(float(u), float(v), 2.0) for u, v in places]


def seen_once(camera: Camera, pose: CameraPose, steps: int) -> Bank:
    """A bank of two targets, seen from a straight flight in so many steps before a pose."""
    bank, places = Bank(2, 2000, np.random.default_rng(5), (50.0, 30_000.0)), np.arange(2)
    for k in range(steps):
        camera_m = pose.position_enu_m - np.array([10.0 * (steps - k), 0.0, 0.0])
        points = (CUBE_ENU_M + np.array([shift_m, 0.0, 0.0]) - camera_m for shift_m in (0.0, 700.0))
        pixels, _ = camera.project(R_NORTH @ np.array(list(points)).T)
        found = [Detection.from_point(float(u), float(v), 2.0) for u, v in pixels.T]
        rays = rays_of(camera, CameraPose(float(k), camera_m, R_NORTH), found, "centre")
        expected = Expected(np.full(2, 2000.0), np.full((2, 2), 2.0), np.zeros((2, 2)), np.full((2, 3), np.nan))
        sights = sights_of(rays, expected, ERRORS, 1.0)
        if k == 0:
            for place in (0, 1):
                bank.start(place, sights.one(place), ERRORS)
            continue
        bank.predict(places, float(k), ERRORS)
        bank.update(places, Sights.of([sights.one(0), sights.one(1)]))
    return bank


def test_what_the_gate_leaves_out_would_not_have_counted() -> None:
    for camera in (CAMERA, WIDE):
        for steps in (1, 3, 20):
            pose = pose_at(300.0)
            bank, rays = seen_once(camera, pose, steps), rays_of(camera, pose, grid(camera), "centre")
            sigma_rad = np.array([[2.3 * ray.px_rad for ray in rays]] * 2) + ERRORS.attitude_white_rad
            can_be = may_be(bank, np.arange(2), pose, rays, sigma_rad)
            for place in (0, 1):
                k = len(rays)
                unknown = np.full((k, 3), np.nan)
                expected = Expected(np.full(k, 2000.0), np.full((k, 2), 2.0), np.zeros((k, 2)), unknown)
                fit = bank.compare(np.full(len(rays), place), sights_of(rays, expected, ERRORS, 1.0))
                assert not ((fit.log_likelihood > 0.0) & ~can_be[place]).any()
            assert can_be.mean() < 0.6  # it spares something
