"""The bench runs and says what it measured; the paper's update by brute force is the one that the filter makes."""

import json

import cv2
import numpy as np
import pytest

from distloc.bootstrap_filter import BootstrapFilter
from distloc.types import CameraPose
from service import bench as bench_module
from service.bench import bench, brute_force_weights, run_bench
from tests.cube_samples import CAMERA, R_NORTH, cube_mask, empty_mask, pose_at


def test_json_has_every_figure(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(bench_module, "N_PARTICLES", 500)
    said: list[str] = []
    run_bench(True, said.append)
    result = json.loads(said[0])
    assert result["schema"] == "distloc/bench/1"
    assert result["n_particles"] == 500
    for contender in ("calibrated", "bootstrap", "brute_force_update"):
        assert all(value > 0 for value in result[contender].values()), contender
    assert result["calibrated_with_resampling_ms"] > 0
    assert result["calibrated_without_resampling_ms"] > 0
    assert 0 < result["resampled_steps"] < result["calibrated"]["steps"] == 100
    assert result["brute_force_update"]["particles"] == 500


def test_table_names_the_contenders_and_a_sample_that_was_scaled_up(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(bench_module, "N_PARTICLES", 2000)
    monkeypatch.setattr(bench_module, "_BRUTE_BUDGET_S", 1e-6)
    said: list[str] = []
    run_bench(False, said.append)
    for words in ("calibrated", "with resampling", "bootstrap", "brute force", "timed on 500 particles and scaled up"):
        assert words in said[0]
    assert bench(2000).brute_force_update.particles == 500


def test_brute_force_agrees_with_the_bootstrap_filter() -> None:
    rng = np.random.default_rng(1)
    pose = pose_at(100.0)
    mask = cube_mask(pose)
    left, top, width, height = cv2.boundingRect(mask)
    low, high = np.array([left, top]) - 4.0, np.array([left + width, top + height]) + 4.0
    pixels = rng.uniform(low[:, None], high[:, None], (2, 4000))
    followed = BootstrapFilter(CAMERA, 4000, 5.0, rng)
    followed.particles_enu_m[:] = pose.R_cam_from_enu.T @ CAMERA.rays(pixels) * 2000.0 + pose.position_enu_m[:, None]
    brute = brute_force_weights(CAMERA, followed.particles_enu_m, pose, mask)
    differences = np.abs(followed._weights(pose, mask, 1, cv2.boundingRect(mask)) - brute)
    assert 0.3 < np.mean(brute > 0.5) < 0.98  # both inside and outside are tried
    assert np.mean(differences > 0.02) < 0.002  # a chamfer transform's nearest pixel is not always the nearest
    assert differences.max() < 0.06


def test_brute_force_by_hand() -> None:
    mask = empty_mask()
    mask[540, 960] = 255
    pose = CameraPose(0.0, np.zeros(3), R_NORTH)
    pixels = np.array([[960.0, 961.0, 962.0], [540.0, 540.0, 541.0]])
    particles = np.hstack([R_NORTH.T @ CAMERA.rays(pixels) * 500.0, [[0.0], [-500.0], [0.0]]])
    expected = [1.0, np.exp(-1.0), np.exp(-5.0), 0.0]  # the last is behind the camera
    assert brute_force_weights(CAMERA, particles, pose, mask) == pytest.approx(expected, abs=1e-9)
    assert brute_force_weights(CAMERA, particles, pose, empty_mask()).tolist() == [0.0] * 4
