"""The paper's update taken literally is the one that the bootstrap filter makes."""

import cv2
import numpy as np
import pytest

from distloc.filter.bootstrap_filter import BootstrapFilter
from distloc.types import CameraPose
from service.commands.bench.filters import literal_update
from service.commands.bench.filters.literal_update import literal_weights, measure_literal
from tests.support.cube_samples import CAMERA, R_NORTH, cube_mask, empty_mask, pose_at


def test_literal_agrees_with_the_bootstrap_filter() -> None:
    rng = np.random.default_rng(1)
    pose = pose_at(100.0)
    mask = cube_mask(pose)
    left, top, width, height = cv2.boundingRect(mask)
    low, high = np.array([left, top]) - 4.0, np.array([left + width, top + height]) + 4.0
    pixels = rng.uniform(low[:, None], high[:, None], (2, 4000))
    followed = BootstrapFilter(CAMERA, 4000, 5.0, rng)
    followed.particles_enu_m[:] = pose.R_cam_from_enu.T @ CAMERA.rays(pixels) * 2000.0 + pose.position_enu_m[:, None]
    literal = literal_weights(CAMERA, followed.particles_enu_m, pose, mask)
    differences = np.abs(followed._weights(pose, mask, 1, cv2.boundingRect(mask)) - literal)
    assert 0.3 < np.mean(literal > 0.5) < 0.98  # both inside and outside are tried
    assert np.mean(differences > 0.02) < 0.002  # a chamfer transform's nearest pixel is not always the nearest
    assert differences.max() < 0.06


def test_literal_by_hand() -> None:
    mask = empty_mask()
    mask[540, 960] = 255
    pose = CameraPose(0.0, np.zeros(3), R_NORTH)
    pixels = np.array([[960.0, 961.0, 962.0], [540.0, 540.0, 541.0]])
    particles = np.hstack([R_NORTH.T @ CAMERA.rays(pixels) * 500.0, [[0.0], [-500.0], [0.0]]])
    expected = [1.0, np.exp(-1.0), np.exp(-5.0), 0.0]  # the last is behind the camera
    assert literal_weights(CAMERA, particles, pose, mask) == pytest.approx(expected, abs=1e-9)
    assert literal_weights(CAMERA, particles, pose, empty_mask()).tolist() == [0.0] * 4


def test_a_sample_that_was_scaled_up_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(literal_update._Literal, "_timed_s", lambda literal, seen, number: 1e-3 * number)
    small = measure_literal(2000, number=5, budget_s=1e-6)
    assert small.timed_particles == 500
    whole = measure_literal(2000, number=5)
    assert whole.timed_particles == 2000
    assert whole.positive_pixels > 3000
    assert small.literal.median_ms == whole.literal.median_ms == 2000.0  # scaled, not a quarter of it
