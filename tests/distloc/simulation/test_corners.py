"""Simulated corners: where they are, how they are named, and that their noise is what they tell."""

import numpy as np
import pytest

from distloc.simulation.corners import SimulatedCorners, corners_along
from distloc.simulation.flights import flight_past
from distloc.types import FloatArray
from tests.support.cube_samples import CAMERA

FLIGHT = flight_past("perpendicular", np.array([0.0, 1000.0, 150.0]), 1000.0, 1000.0, 50.0, height_m=120.0)


@pytest.fixture
def followed() -> SimulatedCorners:
    return corners_along(CAMERA, FLIGHT, np.random.default_rng(3))


def test_each_is_seen_where_its_place_is_with_the_noise_that_it_tells(followed: SimulatedCorners) -> None:
    at: dict[int, FloatArray] = {}
    off = []
    for stamp_s in FLIGHT.stamps_s:
        pose = FLIGHT.pose_at(float(stamp_s))
        corners = followed.at(pose)
        places_m = followed.places_enu_m
        assert 20 < corners.names.size <= 40
        pixels, is_inside = CAMERA.project(pose.R_cam_from_enu @ (places_m - pose.position_enu_m[:, None]))
        assert is_inside.all() and (corners.sigma_px == 0.7).all()
        off.append((corners.pixels - pixels) / corners.sigma_px)
        for name, place in zip(corners.names, places_m.T, strict=True):
            assert np.array_equal(at.setdefault(int(name), place), place)  # a name stays with its place
    scaled = np.concatenate(off, axis=1)
    assert 0.9 < scaled.std() < 1.1 and abs(scaled.mean()) < 0.1
    assert 40 < len(at) < 400


def test_the_same_seed_follows_the_same_corners() -> None:
    pose = FLIGHT.pose_at(0.0)
    first, same, other = (corners_along(CAMERA, FLIGHT, np.random.default_rng(seed)).at(pose) for seed in (1, 1, 2))
    assert np.array_equal(first.pixels, same.pixels)
    assert first.pixels.shape != other.pixels.shape or not np.allclose(first.pixels, other.pixels)
