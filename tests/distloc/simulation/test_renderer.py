import numpy as np
import pytest

from distloc.geometry.camera import Camera
from distloc.geometry.rotations import R_cam_from_enu, matrix_from_euler
from distloc.simulation.renderer import Plume, Renderer
from distloc.types import CameraPose

CAMERA = Camera(640, 360, 450.0, 450.0, 320.0, 180.0, (-0.1, 0.02, 0.0, 0.0, 0.0))


def pose_at(east_m: float, north_m: float, yaw_rad: float = 0.0, stamp_s: float = 300.0) -> CameraPose:
    R = R_cam_from_enu(matrix_from_euler(yaw_rad, np.radians(-5.0), 0.0), np.eye(3))
    return CameraPose(stamp_s, np.array([east_m, north_m, 120.0]), R)


def plume(north_m: float = 2000.0) -> Plume:
    return Plume(np.array([0.0, north_m, 0.0]), 160.0, 120.0, np.array([2.0, 0.0, 0.0]))


@pytest.mark.parametrize(("east_m", "yaw_rad"), [(0.0, 0.0), (300.0, -0.1), (-500.0, 0.0), (400.0, 0.3)])
def test_the_mask_lies_where_the_camera_sees_the_plume(east_m: float, yaw_rad: float) -> None:
    pose = pose_at(east_m, 0.0, yaw_rad)
    image, mask = Renderer(CAMERA, [plume()], np.random.default_rng(1)).render(pose)
    assert image.shape == (360, 640, 3) and image.dtype == np.uint8 == mask.dtype
    assert set(np.unique(mask)) == {0, 255}
    rows, columns = np.nonzero(mask)
    pixel, visible = CAMERA.project(pose.R_cam_from_enu @ (plume().centre_enu_m - pose.position_enu_m)[:, None])
    assert visible[0]
    assert columns.mean() == pytest.approx(pixel[0, 0], abs=3.0) and rows.mean() == pytest.approx(pixel[1, 0], abs=3.0)
    height_px = 450.0 * 160.0 / np.hypot(2000.0, east_m)
    assert 0.7 * height_px < np.ptp(rows) < 1.3 * height_px


def test_the_same_seed_draws_the_same_and_the_ground_stays_with_the_earth() -> None:
    first, again = (Renderer(CAMERA, [plume()], np.random.default_rng(4)).render(pose_at(0, 0))[0] for _ in range(2))
    assert np.array_equal(first, again)
    moved, _ = Renderer(CAMERA, [plume()], np.random.default_rng(4)).render(pose_at(40.0, 0))
    assert np.abs(first.astype(int) - moved)[200:].mean() > 2.0


def test_no_plume_no_mask_and_the_sky_is_brighter_than_the_land() -> None:
    image, mask = Renderer(CAMERA, [], np.random.default_rng(0)).render(pose_at(0, 0))
    assert not mask.any()
    assert image[:100].mean() > image[250:].mean() + 40.0
    _, behind = Renderer(CAMERA, [plume(-2000.0)], np.random.default_rng(0)).render(pose_at(0, 0))
    assert not behind.any()


def test_a_plume_grows_and_a_near_one_is_larger() -> None:
    renderer = Renderer(
        CAMERA, [Plume(np.array([0, 2000.0, 0]), 160.0, 120.0, np.zeros(3), start_share=0.4)], np.random.default_rng(2)
    )
    early, late = (np.count_nonzero(renderer.render(pose_at(0, 0, stamp_s=t))[1]) for t in (0.0, 300.0))
    near = np.count_nonzero(renderer.render(pose_at(0, 1000.0))[1])
    assert early < 0.5 * late
    assert 2.5 * late < near < 6.0 * late


def test_inside_the_plume_and_on_the_ground_are_drawn_without_failing() -> None:
    renderer = Renderer(CAMERA, [plume(100.0)], np.random.default_rng(2))
    image, _ = renderer.render(pose_at(0.0, 95.0))
    assert image.any()
    ground = CameraPose(0.0, np.zeros(3), pose_at(0, 0).R_cam_from_enu)
    assert renderer.render(ground)[0].shape == (360, 640, 3)


def test_a_plume_without_size_is_refused() -> None:
    with pytest.raises(ValueError, match="sizes"):
        Plume(np.zeros(3), 0.0, 10.0, np.zeros(3))
