import cv2
import numpy as np
import pytest

from distloc.filter.bootstrap_filter import BootstrapFilter
from distloc.geometry.camera import Camera
from distloc.geometry.metrics import horizontal_error_m, share_inside
from distloc.types import CameraPose
from tests.support.cube_samples import CAMERA, CUBE_ENU_M, R_NORTH, cube_mask, empty_mask, mask_elsewhere, pose_at


def started(seed: int = 0, n_particles: int = 20_000, steps: int = 1) -> BootstrapFilter:
    followed = BootstrapFilter(CAMERA, n_particles, 5.0, np.random.default_rng(seed))
    for step in range(steps):
        assert followed.step(pose_at(10.0 * step), cube_mask(pose_at(10.0 * step)))
    return followed


@pytest.mark.parametrize("scale", [1, 2])
@pytest.mark.parametrize("shape", ["box", "disc"])
def test_weights_against_brute_force(shape: str, scale: int) -> None:
    camera = Camera(160, 120, 100.0, 100.0, 80.0, 60.0)
    mask = np.zeros((120 // scale, 160 // scale), dtype=np.uint8)
    if shape == "box":
        mask[40 // scale : 60 // scale, 60 // scale : 90 // scale] = 255
    else:
        cv2.circle(mask, (80 // scale, 60 // scale), 15 // scale, 255, -1)
    rng = np.random.default_rng(1)
    pixels = np.vstack([rng.uniform(50.0, 110.0, 4000), rng.uniform(30.0, 90.0, 4000)])
    followed = BootstrapFilter(camera, 4000, 5.0, rng)
    followed.particles_enu_m[:] = R_NORTH.T @ camera.rays(pixels) * 1000.0
    rows, columns = np.nonzero(mask)
    centres = np.vstack([columns, rows]) * scale + (scale - 1) / 2.0
    squared = np.square(pixels[:, :, None] - centres[:, None, :]).sum(axis=0).min(axis=1)
    pose = CameraPose(0.0, np.zeros(3), R_NORTH)
    weights = followed._weights(pose, mask, scale, cv2.boundingRect(mask))
    differences = np.abs(weights - np.exp(-squared))
    assert np.mean(differences > 0.02) < 0.002  # a chamfer transform's nearest pixel is not always the nearest
    assert differences.max() < 0.06


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_converges_on_the_papers_cube(seed: int) -> None:
    followed = BootstrapFilter(CAMERA, 20_000, 5.0, np.random.default_rng(seed))
    errors_m = []
    for east_m in np.arange(0.0, 1001.0, 10.0):
        assert followed.step(pose_at(east_m), cube_mask(pose_at(east_m)))
        errors_m.append(float(np.linalg.norm(followed.particles_enu_m.mean(axis=1) - CUBE_ENU_M)))
    assert 1.0 < np.mean(errors_m[20:]) < 100.0
    inside = (np.abs(followed.particles_enu_m - CUBE_ENU_M[:, None]) <= 50.0).all(axis=0)
    assert 0.2 < share_inside(followed.particles_enu_m, inside) < 1.0


def test_starts_along_the_ray_over_the_whole_range() -> None:
    followed = BootstrapFilter(CAMERA, 20_000, 5.0, np.random.default_rng(0))
    followed.start(pose_at(0.0), np.array([959.5, 539.5]))
    ranges_m = np.linalg.norm(followed.particles_enu_m, axis=0)
    assert followed.particles_enu_m[[0, 2]] == pytest.approx(0.0, abs=1e-6)
    assert (ranges_m.min(), ranges_m.max()) == pytest.approx((50.0, 30_000.0), abs=20.0)
    assert ranges_m.mean() == pytest.approx(15_025.0, rel=0.02)


def test_mask_elsewhere_counts_misses_until_dismissal() -> None:
    followed = started(steps=5)
    matched = [followed.step(pose_at(50.0 + 10.0 * i), mask_elsewhere()) for i in range(5)]
    assert matched == [False] * 5
    assert followed.misses == 5


def test_a_match_ends_the_misses() -> None:
    followed = started(steps=5)
    followed.step(pose_at(50.0), mask_elsewhere())
    assert followed.misses == 1
    assert followed.step(pose_at(60.0), cube_mask(pose_at(60.0)))
    assert followed.misses == 0


def test_empty_mask_does_not_update() -> None:
    followed = started()
    before = followed.particles_enu_m.copy()
    assert followed.update(pose_at(10.0), empty_mask()) is None
    assert followed.particles_enu_m.tolist() == before.tolist()
    assert followed.misses == 0
    fresh = BootstrapFilter(CAMERA, 10, 5.0, np.random.default_rng(0))
    assert fresh.step(pose_at(0.0), empty_mask()) is None
    assert not fresh.is_started


def test_predict_spreads_by_sigma() -> None:
    followed = BootstrapFilter(CAMERA, 20_000, 5.0, np.random.default_rng(0))
    followed.predict()
    assert followed.particles_enu_m.std(axis=1) == pytest.approx([5.0] * 3, rel=0.03)


def test_ratio_and_error_by_hand() -> None:
    assert share_inside(np.zeros((3, 4)), np.array([True, False, False, False])) == 0.25
    assert horizontal_error_m(np.array([3.0, 4.0, 99.0]), np.zeros(3)) == 5.0


@pytest.mark.parametrize(
    ("n", "sigma_m", "range_m"), [(0, 5.0, (1.0, 2.0)), (1, -1.0, (1.0, 2.0)), (1, 5.0, (2.0, 1.0))]
)
def test_impossible_settings_raise(n: int, sigma_m: float, range_m: tuple[float, float]) -> None:
    with pytest.raises(ValueError, match="n_particles"):
        BootstrapFilter(CAMERA, n, sigma_m, np.random.default_rng(0), range_m)
